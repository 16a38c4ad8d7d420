"""Surrogates of the FE model: designs, training sets, POD-GP emulators and their diagnostics."""

from surrogate.design import maximin_design, sobol_design, unit_design
from surrogate.diagnostics import EmulatorDiagnostics, diagnose
from surrogate.emulator import Emulator
from surrogate.estimator import GaussianProcessModes
from surrogate.factors import Design, Factor, Levels, design
from surrogate.field_prediction import FieldPrediction
from surrogate.refine import PredictedShift, predicted_shift, propose, spans_inputs
from surrogate.residuals import (
    Errors,
    Residuals,
    held_out_residuals,
    leave_one_out_residuals,
)
from surrogate.run_scale import RunScale, RunScales
from surrogate.simultaneous_band import field_band
from surrogate.symmetry import ScaledEmulator
from surrogate.training_set import TrainingSet, named_gradient

__all__ = [
    "Design",
    "Emulator",
    "EmulatorDiagnostics",
    "Errors",
    "Factor",
    "FieldPrediction",
    "GaussianProcessModes",
    "Levels",
    "PredictedShift",
    "Residuals",
    "RunScale",
    "RunScales",
    "ScaledEmulator",
    "TrainingSet",
    "design",
    "diagnose",
    "field_band",
    "held_out_residuals",
    "leave_one_out_residuals",
    "maximin_design",
    "named_gradient",
    "predicted_shift",
    "propose",
    "sobol_design",
    "spans_inputs",
    "unit_design",
]
