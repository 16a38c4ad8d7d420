"""Leave-one-out scores of dependent data, by increment and by block, and stacking of hypotheses.

The density of a block is that given all other data (Buerkner, Gabry, Vehtari, Comput. Stat. 36
(2021) 1243): errors are shared between increments, and a block's density alone would count them as
independent evidence. Weights of the draws are smoothed with their Pareto tail (Vehtari, Simpson,
Gelman, Yao, Gabry, JMLR 25 (2024) 72); a shape k above 0.7 means that the posterior without the
block is too far away for the draws, and the score is not to be relied on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from calib.inference.convergence import smoothed_weights
from calib.inference.coordinates import theta_of, x_of
from calib.inference.data_parts import FieldOnly
from calib.inference.likelihood import Likelihood
from calib.inference.posterior import Posterior
from calib.inference.quadrature import Quadrature, integrate
from fe.response import Array

GOOD_K = 0.7
SURE_K = 0.5
"""above which scores are some of their errors too high where two increments are left out"""
N_BOOTSTRAP = 200
BATCH = 1024
N_NODES = 30


@dataclass(frozen=True)
class Block:
    """What is left out together."""

    name: str
    steps: tuple[int, ...] = ()
    """increments, force and field; none where a kind of data is left out"""
    kind: str = "increments"
    """increments, force or field"""


@dataclass(frozen=True)
class Scores:
    """Leave-one-block-out scores of one hypothesis."""

    names: tuple[str, ...]
    log_density: Array
    """(n_block,) ln predictive density of each block given the others"""
    error: Array
    """(n_block,) Monte Carlo SD of each, from the effective size of the smoothed weights"""
    pareto_k: Array
    """(n_block,)"""
    refit: tuple[bool, ...] = ()
    """(n_block,) whether the score is that of the posterior without the block, integrated anew;
    none was when empty"""

    @property
    def total(self) -> float:
        """Sum over the blocks, elpd"""
        return float(self.log_density.sum())

    @property
    def total_error(self) -> float:
        """SD of the sum over other data of the same kind: sqrt(n) SD over the blocks.

        NaN for a single block. With five increments it is itself rough.
        """
        n = self.log_density.size
        return float(np.sqrt(n) * self.log_density.std(ddof=1)) if n > 1 else float("nan")

    @property
    def unreliable(self) -> tuple[str, ...]:
        """Blocks with a Pareto k above 0.7 that were not integrated anew."""
        refit = self.refit or (False,) * len(self.names)
        found = zip(self.names, self.pareto_k, refit, strict=True)
        return tuple(name for name, k, anew in found if k > GOOD_K and not anew)


@dataclass(frozen=True)
class Difference:
    """Score of one hypothesis minus that of the best, over the same blocks."""

    mean: float
    error: float
    """SD by the spread of the differences over the blocks"""


@dataclass(frozen=True)
class Stacking:
    """Weights of the mixture that predicts the blocks best, and how sure they are."""

    weights: Array
    """(n_hypothesis,) summing to 1"""
    low: Array
    """(n_hypothesis,) 5 % quantile over Bayesian bootstraps of the blocks"""
    high: Array
    """(n_hypothesis,) 95 % quantile"""


def increment_blocks(travel: Array) -> tuple[Block, ...]:
    """Each increment on its own."""
    return tuple(Block(f"{value:g} mm", (i,)) for i, value in enumerate(travel))


def wider_blocks(likelihood: Likelihood, travel: Array) -> tuple[Block, ...]:
    """First and last two increments for forces; force and field where there are both.

    The last two ask for a prediction beyond what was measured, the first two for one below it.
    """
    if likelihood.field is not None:
        return Block("all forces", kind="force"), Block("whole field", kind="field")
    if travel.size < 4:
        return ()
    n = travel.size
    first, last = (0, 1), (n - 2, n - 1)
    return tuple(Block(f"{travel[a]:g} and {travel[b]:g} mm", (a, b)) for a, b in (first, last))


def block_log_density(likelihood: Likelihood, x: Array, blocks: tuple[Block, ...]) -> Array:
    """(m, n_block) ln density of each block given all other data, at draws x (m, d).

    Raises ValueError for several increments of a field, or a kind of data that there is not.
    """
    parts = []
    for start in range(0, len(x), BATCH):
        theta = theta_of(x[start : start + BATCH])
        whole = likelihood.log_prob(theta)
        single = None
        columns = []
        for block in blocks:
            if block.kind == "increments" and len(block.steps) == 1:
                single = likelihood.pointwise(theta) if single is None else single
                columns.append(single[:, block.steps[0]])
            else:
                columns.append(whole - _without(likelihood, theta, block))
        parts.append(np.column_stack(columns))
    return np.concatenate(parts)


def leave_out(
    likelihood: Likelihood, x: Array, blocks: tuple[Block, ...], worth: float | None = None
) -> Scores:
    """PSIS scores of blocks from equally probable posterior draws x (m, d).

    The draws are `worth` so many independent ones, by default m: errors are larger by the root of
    the ratio (relative efficiency, Vehtari et al. 2024), and infinite where they are worth none; as
    much longer is the tail that is smoothed.
    """
    density = block_log_density(likelihood, x, blocks)
    independent = len(x) if worth is None else min(max(worth, 1.0), len(x))
    log_weights, k = smoothed_weights(-density, independent / len(x))
    weighted = log_weights + density
    score = logsumexp(weighted, axis=0)
    weights = np.exp(log_weights)
    # Delta method for a weighted mean of the densities (Vehtari et al. 2024, section 2.5).
    relative = np.exp(density - score)
    error = np.sqrt(np.sum(weights**2 * (relative - 1.0) ** 2, axis=0))
    if worth is not None:
        error = error * (np.sqrt(len(x) / worth) if worth > 0.0 else np.inf)
    return Scores(tuple(block.name for block in blocks), score, error, k)


@dataclass(frozen=True)
class AllBut:
    """Likelihood of all data but one block."""

    likelihood: Likelihood
    block: Block

    def log_prob(self, theta: Array) -> Array:
        """(m,) ln likelihood at theta (m, d)."""
        if self.likelihood.field is None:
            left = _without(self.likelihood, theta, self.block)
        else:
            whole = self.likelihood.log_prob(theta)
            left = whole - block_log_density(self.likelihood, x_of(theta), (self.block,))[:, 0]
        return np.where(np.isfinite(left), left, -np.inf)


class Wider(NamedTuple):
    """A posterior known beyond the box of another, for what is left when a block is left out."""

    posterior: Posterior
    reached: Callable[[Quadrature], bool]
    """whether what is left of the other reaches beyond its box"""


def refitted(
    posterior: Posterior,
    scores: Scores,
    blocks: tuple[Block, ...],
    wider: Wider | None = None,
) -> Scores:
    """Scores with those of too large a Pareto k integrated anew, without their block.

    Above `SURE_K` for forces, which takes a second, and above `GOOD_K` where there is a field.
    ln p(block | rest) is the difference of two ln evidences, by `integrate`;
    the error is that of both. The same is done by hand as `reloo`. By the `wider` posterior where
    that without the block reaches beyond where this one is known.
    """
    wanted = scores.pareto_k > (SURE_K if posterior.likelihood.field is None else GOOD_K)
    if not wanted.any():
        return scores
    density, error = scores.log_density.copy(), scores.error.copy()
    whole = integrate(posterior, N_NODES)
    whole_of_wider: Quadrature | None = None
    for index in np.flatnonzero(wanted):
        left, of = without_block(posterior, blocks[index]), whole
        if wider is not None and wider.reached(left):
            if whole_of_wider is None:
                whole_of_wider = integrate(wider.posterior, N_NODES)
            left, of = without_block(wider.posterior, blocks[index]), whole_of_wider
        density[index] = of.log_evidence - left.log_evidence
        error[index] = np.hypot(of.log_evidence_error, left.log_evidence_error)
    return replace(scores, log_density=density, error=error, refit=tuple(wanted.tolist()))


def without_block(posterior: Posterior, block: Block) -> Quadrature:
    """The posterior by all data but a block."""
    rest = AllBut(posterior.likelihood, block)
    return integrate(replace(posterior, likelihood=cast("Likelihood", rest)), N_NODES)


def differences(scores: tuple[Scores, ...]) -> tuple[Difference, ...]:
    """Each hypothesis against the best, paired over the blocks."""
    best = max(scores, key=lambda found: found.total)
    rows = []
    for found in scores:
        off = found.log_density - best.log_density
        n = off.size
        error = float(np.sqrt(n) * off.std(ddof=1)) if n > 1 else float("nan")
        rows.append(Difference(float(off.sum()), error))
    return tuple(rows)


def stacking(scores: tuple[Scores, ...], rng: np.random.Generator) -> Stacking:
    """Weights of Yao, Vehtari, Simpson, Gelman, Bayesian Analysis 13 (2018) 917.

    Their uncertainty by a Bayesian bootstrap: the blocks reweighted with Dirichlet(1, ..., 1).
    """
    density = np.column_stack([found.log_density for found in scores])
    n = len(density)
    best = _stack(density, np.full(n, 1.0 / n))
    drawn = rng.dirichlet(np.ones(n), size=N_BOOTSTRAP)
    others = np.array([_stack(density, shares) for shares in drawn])
    low, high = np.quantile(others, [0.05, 0.95], axis=0)
    return Stacking(best, low, high)


def _stack(density: Array, shares: Array) -> Array:
    """Weights (k,) that maximise sum_i shares_i ln sum_k w_k exp(density_ik), by EM then SLSQP."""
    scaled = np.exp(density - density.max(axis=1, keepdims=True))
    k = scaled.shape[1]
    weights = np.full(k, 1.0 / k)
    for _ in range(50):  # EM: monotone, a good start
        mixed = weights * scaled
        weights = shares @ (mixed / mixed.sum(axis=1, keepdims=True))

    def objective(w: Array) -> float:
        return -float(shares @ np.log(np.maximum(scaled @ w, 1e-300)))

    def slope(w: Array) -> Array:
        by_weight: Array = -(shares / np.maximum(scaled @ w, 1e-300)) @ scaled
        return by_weight

    simplex: Any = {
        "type": "eq",
        "fun": lambda w: w.sum() - 1.0,
        "jac": lambda w: np.ones(k),
    }
    result = minimize(
        objective,
        weights,
        jac=slope,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * k,
        constraints=simplex,
    )
    found = np.clip(result.x, 0.0, None)
    better = objective(found / found.sum()) <= objective(weights)
    chosen: Array = found / found.sum() if better else weights
    return chosen


def _without(likelihood: Likelihood, theta: Array, block: Block) -> Array:
    """(m,) ln density of all data but the block's."""
    if block.kind == "force":
        if likelihood.field is None:
            raise ValueError("blocks: found force, expected increments: the data are forces only")
        return FieldOnly(likelihood).log_prob(theta)
    if block.kind == "field":
        if likelihood.field is None:
            raise ValueError("blocks: found field, expected increments: the data hold no field")
        return replace(likelihood, field=None).log_prob(theta)
    if likelihood.field is not None:
        raise ValueError(
            f"blocks: found {block.name}, expected single increments: the data hold a field"
        )
    return likelihood.force_log_prob(
        theta, np.delete(np.arange(likelihood.force.size), block.steps)
    )
