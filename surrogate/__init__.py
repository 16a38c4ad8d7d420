"""Surrogates of the FE model: designs, training sets, POD-GP emulators and their diagnostics."""

from surrogate.design import sobol_design
from surrogate.diagnostics import EmulatorDiagnostics, Errors, diagnose
from surrogate.emulator import Emulator
from surrogate.symmetry import ScaledEmulator
from surrogate.training_set import TrainingSet

__all__ = [
    "Emulator",
    "EmulatorDiagnostics",
    "Errors",
    "ScaledEmulator",
    "TrainingSet",
    "diagnose",
    "sobol_design",
]
