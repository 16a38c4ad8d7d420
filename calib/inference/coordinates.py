"""Coordinates of the inference: theta = (kappa, r, s), x = (ln kappa, r, s), and the constants."""

from __future__ import annotations

import numpy as np

from fe.response import Array

PARAMETERS = ("kappa", "r", "s")
CONSTANTS = ("C10", "C01", "C11", "mu")


def theta_of(x: Array) -> Array:
    """(..., 3) theta = (kappa [MPa], r, s) from x = (ln kappa, r, s)."""
    theta = np.array(x, dtype=np.float64)
    theta[..., 0] = np.exp(theta[..., 0])
    return theta


def x_of(theta: Array) -> Array:
    """(..., 3) x = (ln kappa, r, s) from theta = (kappa [MPa], r, s); kappa must be positive."""
    x = np.array(theta, dtype=np.float64)
    if not np.all(x[..., 0] > 0):
        raise ValueError(f"theta: kappa must be positive (MPa), got {x[..., 0].min():g}")
    x[..., 0] = np.log(x[..., 0])
    return x


def constants_of(theta: Array) -> Array:
    """(..., 4) constants (C10, C01, C11, mu) in MPa; mu = 2 (C10 + C01) is the shear modulus."""
    kappa, r, s = np.moveaxis(np.asarray(theta), -1, 0)
    return np.stack([(1.0 - r) * kappa, r * kappa, s * kappa, 2.0 * kappa], axis=-1)


def theta_of_constants(c10: float, c01: float, c11: float) -> Array:
    """(3,) theta from Mooney-Rivlin constants in MPa; C10 + C01 must be positive."""
    kappa = c10 + c01
    if not kappa > 0:
        raise ValueError(f"C10 + C01: expected a positive sum in MPa, got {kappa:g}")
    return np.array([kappa, c01 / kappa, c11 / kappa])
