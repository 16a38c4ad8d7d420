"""Scales on which a force is emulated: the force over its mean, or its logarithm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from surrogate.coordinates import Chosen, choose_coordinates, left_out, log_density
from surrogate.pod import fit_pod

Array = npt.NDArray[np.float64]

ERROR = 1e-4
"""of a force, relative: scales are not told apart by what is foretold better than to this"""


@dataclass(frozen=True)
class ForceScale:
    """y = force / mean, or its logarithm; each step counts as much as the others."""

    mean: Array
    """(n_step,) mean training force at kappa = 1 MPa, N"""
    log: bool

    def values(self, force: Array) -> Array:
        """(n, n_step) y of forces (n, n_step) N."""
        relative = force / self.mean
        return np.log(relative) if self.log else relative

    def slopes(self, force: Array, gradient: Array) -> Array:
        """(n, n_step, d) derivatives of y from those of the force (n, n_step, d)."""
        divisor = force if self.log else self.mean
        slopes: Array = gradient / divisor[..., None]
        return slopes

    def force(self, y: Array, covariance: Array) -> tuple[Array, Array]:
        """Force (m, n_step) N and its covariance (m, n_step, n_step) from mean and covariance of y.

        Of a lognormal force the median, whose derivatives are exact, and the covariance that the
        force has over its mean, times the medians: median_i median_j (exp(covariance_ij) - 1).
        This is not the covariance of the force itself, which is larger by
        exp((covariance_ii + covariance_jj) / 2), as its mean is larger by the roots of these
        factors: a Gaussian about the median has the relative spread of the force.
        """
        if not self.log:
            return self.mean * y, self.mean[:, None] * self.mean * covariance
        force = self.mean * np.exp(y)
        return force, np.expm1(covariance) * (force[:, :, None] * force[:, None, :])

    def gradient(self, y: Array, gradient: Array) -> Array:
        """(m, n_step, d) derivative of the force by the inputs from that of y."""
        factor = self.mean * np.exp(y) if self.log else np.broadcast_to(self.mean, y.shape)
        by_input: Array = factor[:, :, None] * gradient
        return by_input


class ChosenScale(NamedTuple):
    """Scale of a force, and coordinates and covariance of its modes on it."""

    scale: ForceScale
    chosen: Chosen


def choose_scale(x: Array, force: Array, gradient: Array | None) -> ChosenScale:
    """The scale on which runs left out of forces (n, n_step) over x (n, d) are more probable."""
    mean, best = force.mean(axis=0), []
    for scale in (ForceScale(mean, False), ForceScale(mean, True)):
        y = scale.values(force)
        pod = fit_pod(y, tolerance=0.0, max_modes=y.shape[1])
        slopes = None
        if gradient is not None:
            slopes = np.matmul(pod.dual.T, scale.slopes(force, gradient))
        chosen = choose_coordinates(x, pod.weights(y), slopes)
        # All directions of the steps count, those too that one scale does not need: a density of
        # the modes that each has would make the numbers of rounding a merit.
        part, here = chosen.part, None if slopes is None else slopes[chosen.part]
        weights = pod.weights(y[part])
        mean_left, variance = left_out(x[part], weights, here, chosen.strength, chosen.family)
        nothing = np.zeros((len(part), y.shape[1] - weights.shape[1]))
        error = np.hstack([weights - mean_left, nothing])
        score = log_density(error, np.hstack([variance, nothing]) + ERROR**2)
        # d log(f) = df / f: a density of the logarithm over f is one of f.
        jacobian = scale.log * np.log(force / mean)[part].sum()
        best.append((score - jacobian, ChosenScale(scale, chosen)))
    return max(best, key=lambda scored: scored[0])[1]
