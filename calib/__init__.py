"""Calibration: from measurements to a posterior of the constants, with the FE model in the loop."""

__version__ = "0.2.0"
