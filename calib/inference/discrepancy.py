"""What a forward model may err by beyond its mesh: another law, another contact.

Kennedy & O'Hagan, J. R. Stat. Soc. B 63 (2001) 425: a Gaussian error of the model, smooth over the
increments and the front face, apart from the parameters. Its size is relative, one share for
forces and field: the field, of many values, tells by its misfit how wrong the model is, and the
forces, which carry the stiffness, are believed that much less. Were the two sizes free of each
other, a wrong model that fits five forces by a wrong stiffness would be taken for right.

The force is the slope of an energy that is quadratic in the strains, to first order: displacements
wrong by a share make it wrong by twice the share, at all travels alike, and by a factor, since it
stays positive. Such a common factor is the stiffness itself to five forces; it cannot be told from
it, and the stiffness is known no better than that. Beside it an error of the share itself changes
over the travel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from fe.response import Array

LENGTH = 1.5
"""mm over the front face, over which a model's error is correlated: parts of the pin's width"""
TRAVEL_LENGTH = 0.8
"""mm of travel, likewise: the range of the increments"""
COMMON = 2.0
"""SD of the logarithm of the force's factor common to all travels, over the share"""
TYPICAL = 0.1
"""share that a model is as likely to exceed as not, before any data"""
KEPT = 5e-3
"""share of a discrepancy's variance over front face and travels that its patterns may leave out"""


def smooth_over(travel: Array, length: float) -> Array:
    """(n_step, n_step) squared exponential over travels (n_step,) mm."""
    off = (travel[:, None] - travel[None, :]) / length
    correlation: Array = np.exp(-0.5 * off**2)
    return correlation


@dataclass(frozen=True)
class ForceDiscrepancy:
    """A factor exp(d) of the predicted forces, d normal with a part common to all travels."""

    smoothness: Array
    """(n_step, n_step) correlation over the travels of the part that is not common"""
    share: float
    """SD of that part, where it is known"""
    of_force: float = COMMON
    """SD of the common part over it, where that is known"""

    def covariance(self, share: Array | None = None, of_force: Array | None = None) -> Array:
        """(n_step, n_step, 1 or m) of d; at shares and ratios (m,) where these are unknown."""
        own = np.array([self.share]) if share is None else share
        common = np.array([self.of_force]) if of_force is None else of_force
        found: Array = own**2 * (common**2 + self.smoothness[:, :, None])
        return found


def discrepancy_patterns(
    points: Array, travel: Array, size: Array, length: float, travel_length: float
) -> Array:
    """(q, n_step, n_point, 3) patterns of the field's error at a share of 1, each of one SD, mm.

    `size` (n_step,) is the SD at each increment, mm, of every component: a wrong contact moves
    material sideways where the model has it move down. Matern 3/2 over the points (n_point, 2),
    squared exponential over the travels (n_step,) mm, each component by itself. Leading directions
    of both together, the rest left out.

    Not squared exponential over the face: it has next to nothing at short distances, where a wrong
    contact errs too (rows of points that land elsewhere), and takes a share of any size to make up
    for that. Under Matern 3/2 the share found is 0.8 to 1.1 times the root mean square that best
    fits of stuck blocks leave of compressible ones with friction (docs/inference.md); of errors as
    smooth as a squared exponential it is half.
    What the patterns leave out (`KEPT`) belongs to the model: with less left out, shares are
    smaller by up to a quarter.
    """
    of_steps, steps = np.linalg.eigh(smooth_over(travel, travel_length))
    of_points, face = np.linalg.eigh(_matern(cdist(points, points) / length))
    variance = np.maximum(np.outer(of_steps, of_points), 0.0)
    ranked = np.argsort(variance, axis=None, kind="stable")
    left = np.cumsum(variance.ravel()[ranked]) / variance.size
    i, j = np.unravel_index(np.sort(ranked[left > KEPT]), variance.shape)
    shapes = np.sqrt(variance[i, j])[:, None, None] * np.einsum(
        "ik,pk->kip", steps[:, i], face[:, j]
    )
    parts = np.einsum("kip,cd->kcipd", size[:, None] * shapes, np.eye(3))
    patterns: Array = parts.reshape(-1, len(travel), len(points), 3)
    return patterns


def size_of(displacement: Array) -> Array:
    """(n_step,) root mean square over the points of the larger component of a field, mm."""
    size: Array = np.sqrt(np.mean(displacement**2, axis=1)).max(axis=1)
    return size


def _matern(distance: Array) -> Array:
    """Correlation at distances over the length, differentiable once (Matern 3/2)."""
    scaled = np.sqrt(3.0) * distance
    correlation: Array = (1.0 + scaled) * np.exp(-scaled)
    return correlation
