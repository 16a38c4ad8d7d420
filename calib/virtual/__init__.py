"""Virtual experiments: data made by the model, with known constants, as arrays or as files."""

from calib.virtual.experiment import VirtualNoise, virtual_experiment
from calib.virtual.laboratory import SampleTruth, make_laboratory
from calib.virtual.laboratory_settings import (
    Cameras,
    LaboratorySettings,
    Placing,
    Protocol,
    Rubber,
    TestMachine,
)
from calib.virtual.truth import BlockTruth, TruthResponse, solve_truth

__all__ = [
    "BlockTruth",
    "Cameras",
    "LaboratorySettings",
    "Placing",
    "Protocol",
    "Rubber",
    "SampleTruth",
    "TestMachine",
    "TruthResponse",
    "VirtualNoise",
    "make_laboratory",
    "solve_truth",
    "virtual_experiment",
]
