"""Bayesian inference of a law's constants from force and field with all errors stated.

InferenceData lives in `calib.inference.inference_data`, which is not imported here: xarray and
ArviZ take seconds to load.
"""

from calib.inference.comparison import (
    Comparison,
    PublishedCheck,
    check_published,
    compare,
    fit_of,
)
from calib.inference.coordinates import (
    CONSTANTS,
    PARAMETERS,
    constants_of,
    theta_of,
    theta_of_constants,
    x_of,
)
from calib.inference.forward import DirectForward, EmulatorForward, ForwardModel, Prediction
from calib.inference.identifiability import SensitivityRow, assumption_study
from calib.inference.likelihood import Likelihood, build_likelihood
from calib.inference.map_estimate import (
    MapPoint,
    MapResult,
    MapStatus,
    emulator_map,
    refine_map,
)
from calib.inference.noise import LOAD_CELL_SD, NoiseSettings
from calib.inference.posterior import Posterior
from calib.inference.prediction import expected_forces, predictive_forces
from calib.inference.prior import Marginal, Prior
from calib.inference.quadrature import Quadrature, integrate
from calib.inference.sampling import (
    SamplerSettings,
    SamplingResult,
    SamplingStatus,
    sample_posterior,
)
from calib.inference.verdict import HypothesisFit

__all__ = [
    "CONSTANTS",
    "LOAD_CELL_SD",
    "PARAMETERS",
    "Comparison",
    "DirectForward",
    "EmulatorForward",
    "ForwardModel",
    "HypothesisFit",
    "Likelihood",
    "MapPoint",
    "MapResult",
    "MapStatus",
    "Marginal",
    "NoiseSettings",
    "Posterior",
    "Prediction",
    "Prior",
    "PublishedCheck",
    "Quadrature",
    "SamplerSettings",
    "SamplingResult",
    "SamplingStatus",
    "SensitivityRow",
    "assumption_study",
    "build_likelihood",
    "check_published",
    "compare",
    "constants_of",
    "emulator_map",
    "expected_forces",
    "fit_of",
    "integrate",
    "predictive_forces",
    "refine_map",
    "sample_posterior",
    "theta_of",
    "theta_of_constants",
    "x_of",
]
