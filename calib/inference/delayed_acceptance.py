"""A chain of the direct model's posterior whose proposals have passed the emulator: few solves.

Delayed acceptance (Christen & Fox, J. Comput. Graph. Stat. 14 (2005) 795): a random walk is first
accepted or not by the emulator's posterior p*, and what passes by the direct one p, with the
probability min(1, p(y) p*(x) / (p(x) p*(y))). The chain leaves p invariant however wrong the
emulator is; a wrong one costs acceptance. Several first steps in a row are one proposal that is
reversible for p* (Liu, Monte Carlo Strategies in Scientific Computing, 2001, 9.4.3), so that each
solve is spent on a point that is far from the last.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fe.response import Array

LogDensity = Callable[[Array], Array]
"""(m, d) to (m,), -inf where it is zero"""
OPTIMAL = 2.38
"""scale of a random walk over that of a normal target, times sqrt(d) (Roberts & Rosenthal 2001)"""


@dataclass(frozen=True)
class DelayedChain:
    """States of the chain, the start first, and what became of each step."""

    x: Array
    """(n + 1, d)"""
    direct: Array
    """(n + 1,) ln of the direct posterior at the states"""
    emulator: Array
    """(n + 1,) ln of the emulator's"""
    moved: Array
    """(n,) 1 where the first steps moved, so that the direct model was asked, else 0"""
    accepted: Array
    """(n,) 1 where it then accepted, else 0"""
    inner: Array
    """(n,) share of the first steps that the emulator accepted"""

    @property
    def n_steps(self) -> int:
        """Steps made"""
        return len(self.moved)

    @property
    def first_rate(self) -> float:
        """Acceptance rate of the emulator's steps."""
        return float(self.inner.mean()) if self.n_steps else float("nan")

    @property
    def second_rate(self) -> float:
        """Share of what moved that the direct model accepted."""
        return float(self.accepted.sum() / self.moved.sum()) if self.moved.any() else float("nan")


class Densities(NamedTuple):
    """Both posteriors of the same unknowns."""

    direct: LogDensity
    emulator: LogDensity


def begin(densities: Densities, start: Array) -> DelayedChain:
    """A chain of no steps at `start` (d,); raises ValueError where either density is zero."""
    values = [float(density(start[None])[0]) for density in densities]
    for name, value in zip(Densities._fields, values, strict=True):
        if not np.isfinite(value):
            raise ValueError(f"start: the {name} posterior is zero at {start}, expected above 0")
    none = np.zeros(0)
    return DelayedChain(start[None], np.array(values[:1]), np.array(values[1:]), none, none, none)


def extend(
    chain: DelayedChain,
    densities: Densities,
    covariance: Array,
    n_steps: int,
    *,
    seed: int,
    n_inner: int = 1,
    on_step: Callable[[DelayedChain], None] | None = None,
) -> DelayedChain:
    """The chain with as many steps more as make `n_steps` in all.

    `covariance` (d, d) is that of the emulator's posterior, by which the walk is scaled. The draws
    of a step follow from the seed and its number: a chain that was stopped goes on as if it had not
    been. `on_step` is given the chain after each step, to be kept.
    Raises ValueError for fewer than one first step.
    """
    if n_inner < 1:
        raise ValueError(f"n_inner: expected at least 1, got {n_inner}")
    d = chain.x.shape[1]
    factor = OPTIMAL / np.sqrt(d) * np.linalg.cholesky(covariance)
    for index in range(chain.n_steps, n_steps):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
        chain = _step(chain, densities, factor, n_inner, rng)
        if on_step is not None:
            on_step(chain)
    return chain


def _step(
    chain: DelayedChain,
    densities: Densities,
    factor: Array,
    n_inner: int,
    rng: np.random.Generator,
) -> DelayedChain:
    x, emulator, direct = chain.x[-1], chain.emulator[-1], chain.direct[-1]
    y, value, share = _walk(densities.emulator, x, emulator, factor, n_inner, rng)
    moved, accepted = share > 0.0, False
    uniform = rng.random()
    if moved:
        exact = float(densities.direct(y[None])[0])
        # NaN, of a solve that failed, is not accepted.
        accepted = bool(np.log(uniform) < exact - direct + emulator - value)
        if accepted:
            x, emulator, direct = y, value, exact
    return DelayedChain(
        np.concatenate([chain.x, x[None]]),
        np.append(chain.direct, direct),
        np.append(chain.emulator, emulator),
        np.append(chain.moved, float(moved)),
        np.append(chain.accepted, float(accepted)),
        np.append(chain.inner, share),
    )


def _walk(
    density: LogDensity, x: Array, value: float, factor: Array, n: int, rng: np.random.Generator
) -> tuple[Array, float, float]:
    """Metropolis steps by the emulator: where they end, its density there, share accepted."""
    taken = 0
    for _ in range(n):
        y = x + factor @ rng.standard_normal(x.size)
        proposed = float(density(y[None])[0])
        if np.log(rng.random()) < proposed - value:
            x, value, taken = y, proposed, taken + 1
    return x, value, taken / n
