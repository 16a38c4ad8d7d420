"""Posterior integrals by tensor Gauss-Legendre quadrature: independent of any sampler.

ln kappa is integrated inside, on an interval of its own for every point of the other coordinates,
the outer ones, (r, s) say: given these the posterior of ln kappa is a narrow peak whose place moves
with them, and a common box would waste nearly all nodes. A grid of more than three outer
coordinates has too many nodes; there importance sampling gives weighed draws in their place. So it
does where the outer coordinates lie on a ridge that runs between the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, reduce

import numpy as np

from calib.inference.coordinates import Space, theta_of
from calib.inference.importance import N_FIRST, NotReached, importance_sample
from calib.inference.missed_mass import CONVERGED, may_miss
from calib.inference.moments import Moments
from calib.inference.posterior import Posterior
from calib.inference.sampling import Box
from fe.response import Array

DEPTH = 25.0  # log density below the peak at which the box is cut: exp(-25) = 1e-11
N_SCAN = 25  # points of one scan of ln kappa
N_ZOOM = 3  # scans, each around the best point of the one before
N_OUTER_SCAN = 15
MOST_OUTER = 3
"""outer coordinates of a grid; beyond, importance sampling"""
NODES = {1: 36, 2: 36, 3: 18}
"""nodes of each coordinate by the number of outer ones"""

AGREEING = 3.0
"""errors of draws by which the evidence of nodes that may miss a ridge may differ from theirs"""
CLOSE = 0.03
"""posterior SDs, and shares of them, by which moments of such nodes may differ from the draws'"""

QUADRATURE, DRAWS = "quadrature", "importance sampling"


@dataclass(frozen=True)
class Quadrature:
    """Nodes and normalised weights of the posterior, and its evidence."""

    x: Array
    """(n, d) nodes (ln kappa, r, s, ...)"""
    weights: Array
    """(n,) posterior probability of each node, summing to 1"""
    log_evidence: float
    """ln of the integral of prior times likelihood over the prior's box"""
    log_evidence_error: float
    """difference from the same integral with two thirds of the nodes; of draws, an SD"""
    space: Space = field(default_factory=Space)
    """what the coordinates are"""
    method: str = QUADRATURE
    """how the integrals were found"""

    def expect(self, values: Array) -> Array:
        """Posterior expectation of values (n, ...) given at the nodes."""
        expectation: Array = np.tensordot(self.weights, values, axes=1)
        return expectation

    @cached_property
    def mean(self) -> Array:
        """(d,) posterior mean of x"""
        return self.expect(self.x)

    @cached_property
    def covariance(self) -> Array:
        """(d, d) posterior covariance of x"""
        off = self.x - self.mean
        covariance: Array = np.einsum("n,ni,nj->ij", self.weights, off, off)
        return covariance

    @cached_property
    def sd(self) -> Array:
        """(d,) posterior SD of x"""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def constants_mean(self) -> Array:
        """(n_constant + 1,) posterior mean of the law's constants and mu, MPa (exponents: 1)"""
        return self.expect(self.space.constants(theta_of(self.x)))

    @cached_property
    def constants_sd(self) -> Array:
        """(n_constant + 1,) posterior SD of the law's constants and mu, MPa (exponents: 1)"""
        off = self.space.constants(theta_of(self.x)) - self.constants_mean
        return np.sqrt(self.expect(off**2))


def integrate(posterior: Posterior, n_nodes: int | None = None) -> Quadrature:
    """Integrate the posterior with n_nodes Gauss-Legendre nodes a coordinate in an adaptive box.

    Intended for posteriors with one peak in ln kappa for given others, which the scale symmetry
    gives; read `log_evidence_error` before use. With three outer coordinates 18 nodes are the most;
    with more, and where the constants have the priors, whose support is no box, `n_nodes` is not
    used: see `calib.inference.importance`. Draws are the answer, too, where nodes may miss a narrow
    ridge (`calib.inference.missed_mass`) and have not the evidence and the moments of the draws.
    Raises ValueError when the posterior is zero everywhere in the box.
    """
    space = posterior.prior.space
    n_outer = space.size - 1
    if n_outer > MOST_OUTER or posterior.prior.of:
        return _by_draws(posterior)
    if n_nodes is not None and n_nodes < 6:
        raise ValueError(f"n_nodes: expected at least 6, got {n_nodes}")
    most = NODES.get(n_outer, NODES[1])
    n = most if n_nodes is None else n_nodes if n_outer < MOST_OUTER else min(n_nodes, most)
    box = _outer_box(posterior)
    x, log_weights = _nodes(posterior, box, n)
    _, coarse = _nodes(posterior, box, 2 * n // 3)
    log_evidence = _log_sum(log_weights)
    found = Quadrature(
        x=x,
        weights=np.exp(log_weights - log_evidence),
        log_evidence=log_evidence,
        log_evidence_error=abs(log_evidence - _log_sum(coarse)),
        space=space,
    )
    moments = Moments(found.x, found.weights)
    if not may_miss(posterior, moments, box, n, found.log_evidence_error):
        return found
    try:
        drawn = _by_draws(posterior)
    except NotReached:
        # What draws do not reach, nodes that agree among themselves may have.
        if found.log_evidence_error > CONVERGED:
            raise
        return found
    return found if _agree(found, drawn) else drawn


def _agree(found: Quadrature, drawn: Quadrature) -> bool:
    """Whether nodes have the evidence and the moments of independent draws."""
    off = abs(found.log_evidence - drawn.log_evidence)
    if off > AGREEING * drawn.log_evidence_error or found.log_evidence_error > CONVERGED:
        return False
    moments = np.abs([found.mean - drawn.mean, found.sd - drawn.sd])
    return bool(np.all(moments <= CLOSE * drawn.sd))


def _by_draws(posterior: Posterior) -> Quadrature:
    """Weighed draws in place of nodes; the same ones every time."""
    rng = np.random.default_rng(0)
    box = Box(posterior)
    x = posterior.prior.sample(rng, N_FIRST)
    y = box.y_of(x)
    prior = posterior.prior
    drawn_from = prior.log_prob(box.x_of(y)) - prior.log_share + box.log_jacobian(y)
    found = importance_sample(box.log_prob, y, drawn_from, rng)
    log_evidence = _log_sum(found.log_weights)
    return Quadrature(
        x=box.x_of(found.y),
        weights=np.exp(found.log_weights - log_evidence),
        log_evidence=log_evidence,
        log_evidence_error=found.error,
        space=posterior.prior.space,
        method=DRAWS,
    )


def _log_sum(values: Array) -> float:
    peak = values.max()
    if not np.isfinite(peak):
        raise ValueError("posterior: zero at every node; check prior bounds and forward model")
    return float(peak + np.log(np.sum(np.exp(values - peak))))


def _grid(axes: list[Array]) -> Array:
    """(n, d) all combinations of the values of d axes; one without columns for no axis."""
    if not axes:
        return np.zeros((1, 0))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def _outer_box(posterior: Posterior) -> Array:
    """(d, 2) range of the outer coordinates that holds all but exp(-DEPTH) of the peak."""
    box = posterior.prior.bounds[1:].copy()
    for _ in range(3 if len(box) else 0):
        grids = [np.linspace(low, high, N_OUTER_SCAN) for low, high in box]
        outer = _grid(grids)
        _, height, _ = _profile(posterior, outer)
        if not np.isfinite(height.max()):
            break
        kept = outer[height > height.max() - DEPTH]
        spacing = (box[:, 1] - box[:, 0]) / (N_OUTER_SCAN - 1)
        tight = np.column_stack([kept.min(axis=0) - spacing, kept.max(axis=0) + spacing])
        box = np.column_stack(
            [np.maximum(tight[:, 0], box[:, 0]), np.minimum(tight[:, 1], box[:, 1])]
        )
    return box


def _profile(posterior: Posterior, outer: Array) -> tuple[Array, Array, Array]:
    """Best ln kappa, its log posterior and the interval (n, 2) to cut, at outer points (n, d)."""
    low, high = posterior.prior.bounds[0]
    interval = np.tile([low, high], (len(outer), 1))
    for _ in range(N_ZOOM):
        grid, value = _scan(posterior, outer, interval)
        best = value.argmax(axis=1)
        centre = np.take_along_axis(grid, best[:, None], axis=1)[:, 0]
        step = (interval[:, 1] - interval[:, 0]) / (N_SCAN - 1)
        # Widened so that the interval keeps what is above the cut on this scan.
        above = value > value.max(axis=1, keepdims=True) - DEPTH
        first, last = above.argmax(axis=1), N_SCAN - 1 - above[:, ::-1].argmax(axis=1)
        index = np.arange(len(outer))
        interval = np.column_stack([grid[index, first] - step, grid[index, last] + step])
        interval = np.clip(interval, low, high)
    return centre, value.max(axis=1), interval


def _scan(posterior: Posterior, outer: Array, interval: Array) -> tuple[Array, Array]:
    """Log posterior (n, N_SCAN) on an even grid of ln kappa in each point's interval (n, 2)."""
    share = np.linspace(0.0, 1.0, N_SCAN)
    grid = interval[:, :1] + share * (interval[:, 1:] - interval[:, :1])
    value = posterior.log_prob(_joined(grid, outer)).reshape(grid.shape)
    return grid, value


def _joined(ln_kappa: Array, outer: Array) -> Array:
    """(n k, 1 + d) x of ln kappa (n, k) and outer points (n, d)."""
    repeated = np.broadcast_to(outer[:, None, :], (*ln_kappa.shape, outer.shape[1]))
    x = np.concatenate([ln_kappa[:, :, None], repeated], axis=2)
    return x.reshape(-1, 1 + outer.shape[1])


def _nodes(posterior: Posterior, box: Array, n: int) -> tuple[Array, Array]:
    """Nodes (n^(1 + d), 1 + d) and ln(quadrature weight * posterior) of each."""
    unit, weight = np.polynomial.legendre.leggauss(n)
    unit, weight = 0.5 * (unit + 1.0), 0.5 * weight
    sides = box[:, 1] - box[:, 0]
    outer = _grid([low + side * unit for low, side in zip(box[:, 0], sides, strict=True)])
    _, _, interval = _profile(posterior, outer)
    width = interval[:, 1] - interval[:, 0]
    ln_kappa = interval[:, :1] + width[:, None] * unit
    x = _joined(ln_kappa, outer)
    product = reduce(np.multiply.outer, [weight] * len(box), np.ones(())).ravel()
    volume = ((product * sides.prod() * width)[:, None] * weight).ravel()
    return x, posterior.log_prob(x) + np.log(volume)
