"""Errors of a field of unknown sizes: noise by a factor, a discrepancy by a share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calib.inference.field_noise import FieldCovariance
from calib.inference.field_table import Range
from fe.response import Array


class FieldSizes(NamedTuple):
    """Unknown sizes of the field's errors, (m,) each, or None where they are known."""

    noise: Array | None
    """factor of the SD of the noise"""
    discrepancy: Array | None
    """share by which the model errs"""


@dataclass(frozen=True)
class FieldScales:
    """Between which bounds sizes of the field's errors are unknown."""

    noise: Range | None
    """of the factor of the noise's SD; None where it is 1"""
    discrepancy: Range | None
    """of the share by which the model errs; None where it is known"""
    patterns: Array
    """(q, n_step, n_point, 3) shapes of the discrepancy at a share of 1, mm"""

    def without_step(self, index: int | None) -> FieldScales:
        """The same of all increments but one."""
        if index is None:
            return self
        return replace(self, patterns=np.delete(self.patterns, index, axis=1))

    def covariance(self, known: FieldCovariance, sizes: FieldSizes, row: int) -> FieldCovariance:
        """The covariance at the sizes of one row."""
        found = known
        if sizes.noise is not None:
            found = replace(found, noise_variance=found.noise_variance * sizes.noise[row] ** 2)
        if sizes.discrepancy is not None:
            found = found.with_patterns(sizes.discrepancy[row] * self.patterns)
        return found


def rigid_patterns(points: Array, n_step: int, translation: float, rotation: float) -> Array:
    """(q, n_step, n_point, 3) rigid motions of the front face, each increment by itself, mm.

    One SD each: `translation` mm along x, y, z; `rotation` degrees about these, small, about the
    middle of the points (n_point, 2).
    """
    x, y = (points - points.mean(axis=0)).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    motions = []
    if translation > 0:
        motions += [translation * np.outer(one, axis) for axis in np.eye(3)]
    if rotation > 0:
        turned = ((zero, zero, y), (zero, zero, -x), (-y, x, zero))  # axis x position
        motions += [np.radians(rotation) * np.stack(motion, axis=1) for motion in turned]
    if not motions:
        return np.zeros((0, n_step, len(points), 3))
    single = np.einsum("ts,kpc->ktspc", np.eye(n_step), np.array(motions))
    patterns: Array = single.reshape(-1, n_step, len(points), 3)
    return patterns
