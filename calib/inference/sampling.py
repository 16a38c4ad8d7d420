"""Posterior samples by several independent emcee ensembles, stopped by autocorrelation time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import emcee
import numpy as np
from scipy.special import expit, log_expit, logit

from calib.inference.block_store import BlockStore
from calib.inference.chain_store import Block, block_of, run_key
from calib.inference.chain_verdict import BURN_SHARE, ChainVerdict, judge, what_is_missing
from calib.inference.ensemble import ensemble_sampler
from calib.inference.posterior import Density, Posterior
from fe.response import Array

Progress = Callable[[int, int], None]
"""called with steps done and steps expected in total"""

START_DRAWS = 4096
"""prior draws that starts are chosen from, and 16 a walker at least"""
STRAY = 20.0
"""log-probability below the best at which a walker counts as lost in a secondary mode: with three
parameters a draw of the main mode lies that low with probability 1e-8 (chi-square of 3, 40), with
ten with 2e-5"""


class SamplingStatus(StrEnum):
    """How sampling ended."""

    CONVERGED = "converged"
    MAX_STEPS = "max_steps"


@dataclass(frozen=True)
class SamplerSettings:
    """Size of the run. Raises ValueError when a value is impossible."""

    n_ensembles: int = 4
    """independent ensembles; R-hat compares them"""
    n_walkers: int = 48
    """walkers of an ensemble, an even number of at least 8"""
    n_autocorrelation: float = 50.0
    """kept steps must be at least this many integrated autocorrelation times"""
    max_r_hat: float = 1.01
    """R-hat over the ensembles may be this at most"""
    max_steps: int = 20_000
    check_every: int = 250
    """steps between two looks at the autocorrelation time"""

    def __post_init__(self) -> None:
        if self.n_ensembles < 2:
            raise ValueError(
                f"n_ensembles: R-hat needs independent ensembles, at least 2, "
                f"got {self.n_ensembles}"
            )
        if self.n_walkers < 8 or self.n_walkers % 2:
            raise ValueError(
                f"n_walkers: expected an even number of at least 8, got {self.n_walkers}"
            )
        if not self.n_autocorrelation >= 1:
            raise ValueError(f"n_autocorrelation: expected >= 1, got {self.n_autocorrelation}")
        if not self.max_r_hat > 1:
            raise ValueError(f"max_r_hat: expected above 1, got {self.max_r_hat}")
        for name in ("max_steps", "check_every"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")


@dataclass(frozen=True)
class SamplingResult:
    """Kept part of the chains, and how they were obtained."""

    chains: Array
    """(n_ensemble, n_step, n_walker, n) x = (ln kappa, r, s, ...) after burn-in, every step"""
    log_prob: Array
    """(n_ensemble, n_step, n_walker) log posterior"""
    autocorrelation_time: Array
    """(n_ensemble, n) integrated autocorrelation time of each coordinate, steps"""
    acceptance: Array
    """(n_ensemble,) accepted share of the proposals"""
    n_burn: int
    """steps discarded at the start of each ensemble"""
    status: SamplingStatus
    message: str
    """one sentence on how sampling ended"""

    @property
    def draws(self) -> Array:
        """(n_draw, n) all kept x"""
        return self.chains.reshape(-1, self.chains.shape[-1])


@dataclass(frozen=True)
class Box:
    """The posterior in y = logit of x's place in the prior's box, which has no walls.

    Posteriors of these data lean on the bounds of r and s; in x half of the proposals there would
    fall outside, and the chains would remember several times longer.
    """

    posterior: Posterior

    def x_of(self, y: Array) -> Array:
        """(..., n) x in the box."""
        low, high = self.posterior.prior.bounds.T
        x: Array = low + (high - low) * expit(y)
        return x

    def y_of(self, x: Array) -> Array:
        """(..., n) y; a point on a bound is moved inside by 1e-9 of the box."""
        low, high = self.posterior.prior.bounds.T
        y: Array = logit(np.clip((x - low) / (high - low), 1e-9, 1.0 - 1e-9))
        return y

    def log_jacobian(self, y: Array) -> Array:
        """(...) ln |dx/dy|."""
        low, high = self.posterior.prior.bounds.T
        each = np.log(high - low) + log_expit(y) + log_expit(-y)
        total: Array = each.sum(axis=-1)
        return total

    def log_prob(self, y: Array) -> Array:
        """(m,) unnormalised log density with respect to y (m, n)."""
        value: Array = self.posterior.log_prob(self.x_of(y)) + self.log_jacobian(y)
        return value


def sample_posterior(
    posterior: Posterior,
    settings: SamplerSettings,
    rng: np.random.Generator,
    progress: Progress | None = None,
    store: Path | None = None,
) -> SamplingResult:
    """Run the ensembles until each has `n_autocorrelation` times its own memory and they agree.

    A first round of `check_every` steps only settles the walkers and is thrown away: a walker
    that ended it in a mode without weight is moved among the others, for it would take the whole
    run to leave. Ensembles have their own random streams, spawned from `rng`, and start apart
    from each other (see `dispersed_starts`). All advance together and are judged together, so
    that the kept chains have the same length: by autocorrelation time, and by R-hat over the
    ensembles. The result depends on `rng`'s seed and on nothing else. With a folder `store` every
    block of `check_every` steps is kept there: a run that was killed goes on where it was and ends
    with the same bits; blocks of another run are thrown away.
    Reaching `max_steps` is a status, not an error. Raises ValueError when too few prior
    draws have a finite posterior.
    """
    children = rng.spawn(settings.n_ensembles)
    box = Box(posterior)
    d = box.posterior.prior.space.size
    samplers = [ensemble_sampler(settings.n_walkers, d, box.log_prob) for _ in children]
    # position and random state of each ensemble
    states = [_start(box, settings.n_walkers, child) for child in children]
    kept, blocks = None, list[Block]()
    if store is not None:
        at_starts = np.array([box.log_prob(state.coords) for state in states])
        kept = BlockStore(store, run_key(settings, states, at_starts))
        blocks = [Block(**arrays) for arrays in kept.load()]
    if blocks:
        states = blocks[-1].states
    else:
        for index, (sampler, child) in enumerate(zip(samplers, children, strict=True)):
            states[index] = _settle(sampler, states[index], settings.check_every, child)
    while not (verdict := _judged(blocks, settings, box)).ended:
        done = sum(block.chains.shape[1] for block in blocks)
        n_steps = min(settings.check_every, settings.max_steps - done)
        for index, sampler in enumerate(samplers):
            states[index] = sampler.run_mcmc(
                states[index], n_steps, skip_initial_state_check=True, store=True
            )
            if progress is not None:
                share = n_steps * (index + 1) // settings.n_ensembles
                progress(done + share, max(verdict.expected, done + n_steps))
        blocks.append(block_of(samplers, states))
        if kept is not None:
            kept.keep(len(blocks) - 1, blocks[-1]._asdict())
        for sampler in samplers:
            sampler.reset()
    return _result(blocks, verdict, settings, box)


def _judged(blocks: list[Block], settings: SamplerSettings, box: Box) -> ChainVerdict:
    return judge(
        box.x_of(_joined(blocks, "chains")) if blocks else None,
        n_autocorrelation=settings.n_autocorrelation,
        max_r_hat=settings.max_r_hat,
        max_steps=settings.max_steps,
        check_every=settings.check_every,
    )


def _joined(blocks: list[Block], name: str) -> Array:
    """(n_ensemble, n_step, ...) of all blocks."""
    return np.concatenate([getattr(block, name) for block in blocks], axis=1)


def _start(box: Box, n_walkers: int, child: np.random.Generator) -> emcee.State:
    starts = box.y_of(dispersed_starts(box.posterior, n_walkers, child))
    # emcee draws from the older RandomState; it is fed from the ensemble's own stream.
    legacy = np.random.RandomState(np.random.MT19937(child.integers(2**63)))
    return emcee.State(starts, random_state=legacy.get_state())


def _settle(
    sampler: emcee.EnsembleSampler, start: emcee.State, n_steps: int, rng: np.random.Generator
) -> emcee.State:
    """Run a first round, bring stray walkers back to where others have been, forget the round."""
    state = sampler.run_mcmc(start, n_steps, skip_initial_state_check=True, store=True)
    visited = sampler.get_chain(discard=n_steps // 2, flat=True)
    value = sampler.get_log_prob(discard=n_steps // 2, flat=True)
    main = visited[value > value.max() - STRAY]
    stray = np.flatnonzero(state.log_prob < value.max() - STRAY)
    coords = state.coords.copy()
    coords[stray] = main[rng.integers(len(main), size=stray.size)]
    sampler.reset()
    return emcee.State(coords, random_state=state.random_state)


def dispersed_starts(posterior: Density, n_walkers: int, rng: np.random.Generator) -> Array:
    """(n_walkers, n) starts far wider than the posterior but not hopeless.

    Prior draws, chosen without replacement with probability proportional to likelihood^beta;
    the power beta <= 1 is the largest that leaves an effective 4 n_walkers different draws.
    Raises ValueError when too few prior draws have a finite posterior.
    """
    n = max(START_DRAWS, 16 * n_walkers)
    x = posterior.prior.sample(rng, n)
    log_likelihood = posterior.log_prob(x) - posterior.prior.log_prob(x)
    finite = np.isfinite(log_likelihood)
    if np.count_nonzero(finite) < 4 * n_walkers:
        raise ValueError(
            f"posterior: finite at {np.count_nonzero(finite)} of {n} prior draws; "
            "narrow the prior to where the forward model works"
        )
    x, log_likelihood = x[finite], log_likelihood[finite]
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        enough = _effective_number(_weights(log_likelihood, middle)) >= 4 * n_walkers
        low, high = (middle, high) if enough else (low, middle)
    chosen = rng.choice(len(x), n_walkers, replace=False, p=_weights(log_likelihood, low))
    starts: Array = x[chosen]
    return starts


def _weights(log_likelihood: Array, power: float) -> Array:
    weights = np.exp(power * (log_likelihood - log_likelihood.max()))
    # A floor keeps every draw possible, so that a choice without replacement always succeeds.
    weights = weights + 1e-12
    normalised: Array = weights / weights.sum()
    return normalised


def _effective_number(weights: Array) -> float:
    return float(1.0 / np.sum(weights**2))


def _result(
    blocks: list[Block], verdict: ChainVerdict, settings: SamplerSettings, box: Box
) -> SamplingResult:
    chains, log_prob = _joined(blocks, "chains"), _joined(blocks, "log_prob")
    n_ensemble, done = chains.shape[:2]
    burn, slowest = done // BURN_SHARE, verdict.times.max()
    message = f"{done} steps of {settings.n_walkers} walkers in {n_ensemble} ensembles, " + (
        f"kept {(done - burn) / slowest:.0f} autocorrelation times of {slowest:.1f} steps"
    )
    message += what_is_missing(verdict, settings.n_autocorrelation, settings.max_r_hat)
    accepted = np.sum([block.accepted for block in blocks], axis=0)
    return SamplingResult(
        chains=box.x_of(chains[:, burn:]),
        log_prob=log_prob[:, burn:] - box.log_jacobian(chains[:, burn:]),
        autocorrelation_time=verdict.times,
        acceptance=np.mean(accepted / done, axis=1),
        n_burn=burn,
        status=SamplingStatus.CONVERGED if verdict.converged else SamplingStatus.MAX_STEPS,
        message=message,
    )
