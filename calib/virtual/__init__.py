"""Virtual experiments: data made by the model, with known constants."""

from calib.virtual.experiment import VirtualNoise, virtual_experiment

__all__ = ["VirtualNoise", "virtual_experiment"]
