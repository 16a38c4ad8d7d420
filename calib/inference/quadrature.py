"""Posterior integrals by tensor Gauss-Legendre quadrature: independent of any sampler.

ln kappa is integrated inside, on an interval of its own for every (r, s): given (r, s) the
posterior of ln kappa is a narrow peak whose place moves with (r, s), and a common box would
waste nearly all nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.inference.coordinates import constants_of, theta_of
from calib.inference.posterior import Posterior
from fe.response import Array

DEPTH = 25.0  # log density below the peak at which the box is cut: exp(-25) = 1e-11
N_SCAN = 25  # points of one scan of ln kappa
N_ZOOM = 3  # scans, each around the best point of the one before
N_OUTER_SCAN = 15


@dataclass(frozen=True)
class Quadrature:
    """Nodes and normalised weights of the posterior, and its evidence."""

    x: Array
    """(n, 3) nodes (ln kappa, r, s)"""
    weights: Array
    """(n,) posterior probability of each node, summing to 1"""
    log_evidence: float
    """ln of the integral of prior times likelihood over the prior's box"""
    log_evidence_error: float
    """difference from the same integral with two thirds of the nodes"""

    def expect(self, values: Array) -> Array:
        """Posterior expectation of values (n, ...) given at the nodes."""
        expectation: Array = np.tensordot(self.weights, values, axes=1)
        return expectation

    @cached_property
    def mean(self) -> Array:
        """(3,) posterior mean of x"""
        return self.expect(self.x)

    @cached_property
    def covariance(self) -> Array:
        """(3, 3) posterior covariance of x"""
        off = self.x - self.mean
        covariance: Array = np.einsum("n,ni,nj->ij", self.weights, off, off)
        return covariance

    @cached_property
    def sd(self) -> Array:
        """(3,) posterior SD of x"""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def constants_mean(self) -> Array:
        """(4,) posterior mean of (C10, C01, C11, mu), MPa"""
        return self.expect(constants_of(theta_of(self.x)))

    @cached_property
    def constants_sd(self) -> Array:
        """(4,) posterior SD of (C10, C01, C11, mu), MPa"""
        off = constants_of(theta_of(self.x)) - self.constants_mean
        return np.sqrt(self.expect(off**2))


def integrate(posterior: Posterior, n_nodes: int = 36) -> Quadrature:
    """Integrate the posterior with n_nodes^3 Gauss-Legendre nodes in an adaptive box.

    Intended for posteriors with one peak in ln kappa for given (r, s), which the scale symmetry
    gives; read `log_evidence_error` before use. Raises ValueError when the posterior is zero
    everywhere in the box.
    """
    if n_nodes < 6:
        raise ValueError(f"n_nodes: expected at least 6, got {n_nodes}")
    box = _outer_box(posterior)
    x, log_weights = _nodes(posterior, box, n_nodes)
    _, coarse = _nodes(posterior, box, 2 * n_nodes // 3)
    log_evidence = _log_sum(log_weights)
    return Quadrature(
        x=x,
        weights=np.exp(log_weights - log_evidence),
        log_evidence=log_evidence,
        log_evidence_error=abs(log_evidence - _log_sum(coarse)),
    )


def _log_sum(values: Array) -> float:
    peak = values.max()
    if not np.isfinite(peak):
        raise ValueError("posterior: zero at every node; check prior bounds and forward model")
    return float(peak + np.log(np.sum(np.exp(values - peak))))


def _outer_box(posterior: Posterior) -> Array:
    """(2, 2) range of r and s that holds all but exp(-DEPTH) of the peak."""
    box = posterior.prior.bounds[1:].copy()
    for _ in range(3):
        grids = [np.linspace(low, high, N_OUTER_SCAN) for low, high in box]
        pairs = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 2)
        _, height, _ = _profile(posterior, pairs)
        if not np.isfinite(height.max()):
            break
        kept = pairs[height > height.max() - DEPTH]
        spacing = (box[:, 1] - box[:, 0]) / (N_OUTER_SCAN - 1)
        tight = np.column_stack([kept.min(axis=0) - spacing, kept.max(axis=0) + spacing])
        box = np.column_stack(
            [np.maximum(tight[:, 0], box[:, 0]), np.minimum(tight[:, 1], box[:, 1])]
        )
    return box


def _profile(posterior: Posterior, pairs: Array) -> tuple[Array, Array, Array]:
    """Best ln kappa, its log posterior and the interval (n, 2) to cut, for (r, s) pairs (n, 2)."""
    low, high = posterior.prior.bounds[0]
    interval = np.tile([low, high], (len(pairs), 1))
    for _ in range(N_ZOOM):
        grid, value = _scan(posterior, pairs, interval)
        best = value.argmax(axis=1)
        centre = np.take_along_axis(grid, best[:, None], axis=1)[:, 0]
        step = (interval[:, 1] - interval[:, 0]) / (N_SCAN - 1)
        # Widened so that the interval keeps what is above the cut on this scan.
        above = value > value.max(axis=1, keepdims=True) - DEPTH
        first, last = above.argmax(axis=1), N_SCAN - 1 - above[:, ::-1].argmax(axis=1)
        index = np.arange(len(pairs))
        interval = np.column_stack([grid[index, first] - step, grid[index, last] + step])
        interval = np.clip(interval, low, high)
    return centre, value.max(axis=1), interval


def _scan(posterior: Posterior, pairs: Array, interval: Array) -> tuple[Array, Array]:
    """Log posterior (n, N_SCAN) on an even grid of ln kappa in each pair's interval (n, 2)."""
    share = np.linspace(0.0, 1.0, N_SCAN)
    grid = interval[:, :1] + share * (interval[:, 1:] - interval[:, :1])
    x = np.concatenate(
        [grid[:, :, None], np.broadcast_to(pairs[:, None, :], (*grid.shape, 2))], axis=2
    )
    value = posterior.log_prob(x.reshape(-1, 3)).reshape(grid.shape)
    return grid, value


def _nodes(posterior: Posterior, box: Array, n: int) -> tuple[Array, Array]:
    """Nodes (n^3, 3) and ln(quadrature weight * posterior) (n^3,)."""
    unit, weight = np.polynomial.legendre.leggauss(n)
    unit, weight = 0.5 * (unit + 1.0), 0.5 * weight
    sides = box[:, 1] - box[:, 0]
    r, s = (box[i, 0] + sides[i] * unit for i in range(2))
    pairs = np.stack(np.meshgrid(r, s, indexing="ij"), axis=-1).reshape(-1, 2)
    _, _, interval = _profile(posterior, pairs)
    width = interval[:, 1] - interval[:, 0]
    ln_kappa = interval[:, :1] + width[:, None] * unit
    x = np.concatenate(
        [ln_kappa[:, :, None], np.broadcast_to(pairs[:, None, :], (n * n, n, 2))], axis=2
    ).reshape(-1, 3)
    outer = np.outer(weight, weight).ravel() * sides.prod() * width
    volume = (outer[:, None] * weight).ravel()
    return x, posterior.log_prob(x) + np.log(volume)
