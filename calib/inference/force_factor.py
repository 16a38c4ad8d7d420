"""Forces that a wrong model mistakes by a factor: likely twice as likely as half.

    y = f exp(d) + e,   d ~ N(0, D) over the increments,   e ~ N(0, E)

On the scale of ln y both are normal as long as e is small against y. An error proportional to the
predicted force, f (1 + d), is none of this: at SDs of a half it makes forces negative, and its
density, which falls as 1 / f, pulls the stiffness down.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fe.response import Array


class ForceNormal(NamedTuple):
    """What the normal density of the forces takes."""

    covariance: Array
    """(n_step, n_step, m) N^2"""
    residual: Array
    """(n_step, m) N"""
    shifts: Array
    """(q, n_step, m) N"""


def on_log_scale(
    measured: Array, force: Array, own: Array, model: Array, shifts: Array, factor: Array
) -> ForceNormal:
    """Residuals y ln(y / f) and their covariance, all in N at the measured forces y (n_step,).

    `force` (n_step, m) are predicted, `own` (n_step, n_step, m) is the covariance of measurement,
    `model` of what is proportional to the predicted force (emulator, mesh), `shifts`
    (q, n_step, m) changes by errors shared with the field, `factor` (n_step, n_step, 1 or m) the
    covariance of ln of the factor. The density of y is that of the residuals: the two Jacobians
    cancel.
    Raises ValueError for a measured force that is not positive, which has no logarithm.
    """
    if not measured.min() > 0:
        raise ValueError(f"force: expected positive forces, which err by a factor, got {measured}")
    scale = measured[:, None] / force
    moved = scale[:, None] * scale[None, :] * model
    by_factor = (measured[:, None] * measured[None, :])[:, :, None] * factor
    return ForceNormal(
        covariance=own + moved + by_factor,
        residual=measured[:, None] * np.log(scale),
        shifts=scale * shifts,
    )
