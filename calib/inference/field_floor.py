"""How large a model's errors of unknown shape are: at each increment, and over the face."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.distance import cdist

from fe.response import Array

PROFILE_LENGTH = 0.3
"""mm, over which the size of a difference is averaged to tell how its errors are spread"""
PROFILE_LEAST = 0.3
"""of the profile's root mean square: a small difference at one place is no sign of accuracy"""


@dataclass(frozen=True)
class FieldFloor:
    """SD of a model's errors of unknown shape: `sd` times `profile`."""

    sd: Array
    """(n_step, 3) root mean square over the points, mm"""
    profile: Array | None = None
    """(n_point,) at each point as a share of that; None where it is the same everywhere"""

    @property
    def even(self) -> FieldFloor:
        """The same at all points: for others than those at which the profile is known."""
        return replace(self, profile=None)

    def scaled(self, factor: float) -> FieldFloor:
        """So many times as large."""
        return replace(self, sd=factor * self.sd)


def local_profile(points: Array, differences: Array) -> Array:
    """(n_point,) where differences (n, n_step, n_point, 3) of two models are large; RMS of one.

    What a mesh errs by is uneven over the face: at most 2.7 (stuck) and 4.4 times (sliding) its
    root mean square, half of it at the tenth of the points where it is least; and the difference of
    two meshes is large at much the same places (docs/verification.md, "Where on the face a mesh
    errs"). Each increment and component counts alike, averaged over points (n_point, 2) [mm] within
    `PROFILE_LENGTH`, since errors of finer meshes have not the shape of the difference. One
    everywhere where nothing differs.
    """
    size = np.mean(differences**2, axis=(0, 2), keepdims=True)
    each = np.mean(differences**2 / np.where(size > 0.0, size, 1.0), axis=(0, 1, 3))
    near = np.exp(-0.5 * (cdist(points, points) / PROFILE_LENGTH) ** 2)
    local = near @ each / near.sum(axis=1)
    if not local.mean() > 0.0:
        return np.ones(len(points))
    profile = np.maximum(np.sqrt(local / local.mean()), PROFILE_LEAST)
    found: Array = profile / np.sqrt(np.mean(profile**2))
    return found
