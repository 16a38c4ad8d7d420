"""Posterior samples by several independent emcee ensembles, stopped by autocorrelation time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import emcee
import numpy as np
from scipy.special import expit, log_expit, logit

from calib.inference.autocorrelation import integrated_time
from calib.inference.posterior import Posterior
from fe.response import Array

Progress = Callable[[int, int], None]
"""called with steps done and steps expected in total"""

BURN_SHARE = 4  # the first quarter of the chain is discarded
BURN_TIMES = 5  # and must be at least this many autocorrelation times
START_DRAWS = 4096
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
) -> SamplingResult:
    """Run the ensembles until every one has `n_autocorrelation` times its own memory.

    A first round of `check_every` steps only settles the walkers and is thrown away: a walker
    that ended it in a mode without weight is moved among the others, for it would take the whole
    run to leave. Ensembles have their own random streams, spawned from `rng`, and start apart
    from each other (see `dispersed_starts`). All advance together and are judged together, so
    that the kept chains have the same length. The result depends on `rng`'s seed and on nothing
    else.
    Reaching `max_steps` is a status, not an error. Raises ValueError when no prior draw has a
    finite posterior.
    """
    children = rng.spawn(settings.n_ensembles)
    box = Box(posterior)
    samplers = [_sampler(box, settings.n_walkers) for _ in children]
    states = [
        _start(box, settings.n_walkers, child) for child in children
    ]  # position and random state of each ensemble
    for index, (sampler, child) in enumerate(zip(samplers, children, strict=True)):
        states[index] = _settle(sampler, states[index], settings.check_every, child)
    done, expected = 0, settings.max_steps
    status = SamplingStatus.MAX_STEPS
    while done < settings.max_steps:
        n_steps = min(settings.check_every, settings.max_steps - done)
        for index, sampler in enumerate(samplers):
            states[index] = sampler.run_mcmc(
                states[index], n_steps, skip_initial_state_check=True, store=True
            )
            if progress is not None:
                share = n_steps * (index + 1) // settings.n_ensembles
                progress(done + share, max(expected, done + n_steps))
        done += n_steps
        times = _autocorrelation_times(samplers, done // BURN_SHARE, box)
        needed = _steps_needed(times, settings.n_autocorrelation)
        if done >= needed:
            status = SamplingStatus.CONVERGED
            break
        expected = min(_next_check(needed, settings.check_every), settings.max_steps)
    return _result(samplers, times, status, settings, box)


def _sampler(box: Box, n_walkers: int) -> emcee.EnsembleSampler:
    # Differential evolution crosses narrow ridges (kappa against r, s) faster than the stretch
    # move, which changes scale along bounds. emcee's snooker move is left out: its acceptance
    # takes half the power of the distance ratio that detailed balance needs (ter Braak & Vrugt
    # 2008: d - 1) and biases the spread (docs/inference.md; emcee 3.1.6).
    moves = [(emcee.moves.DEMove(), 0.7), (emcee.moves.StretchMove(), 0.3)]
    return emcee.EnsembleSampler(
        n_walkers, box.posterior.prior.space.size, box.log_prob, moves=moves, vectorize=True
    )


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


def dispersed_starts(posterior: Posterior, n_walkers: int, rng: np.random.Generator) -> Array:
    """(n_walkers, n) starts far wider than the posterior but not hopeless.

    Prior draws, chosen without replacement with probability proportional to likelihood^beta;
    the power beta <= 1 is the largest that leaves an effective 4 n_walkers different draws.
    Raises ValueError when too few prior draws have a finite posterior.
    """
    x = posterior.prior.sample(rng, START_DRAWS)
    log_likelihood = posterior.log_prob(x) - posterior.prior.log_prob(x)
    finite = np.isfinite(log_likelihood)
    if np.count_nonzero(finite) < 4 * n_walkers:
        raise ValueError(
            f"posterior: finite at {np.count_nonzero(finite)} of {START_DRAWS} prior draws; "
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


def _autocorrelation_times(samplers: list[emcee.EnsembleSampler], burn: int, box: Box) -> Array:
    """(n_ensemble, n) steps; infinite while a chain is too short to tell."""
    times = []
    for sampler in samplers:
        chain = box.x_of(sampler.get_chain(discard=burn))
        times.append([integrated_time(chain[:, :, i]) for i in range(chain.shape[2])])
    return np.array(times)


def _steps_needed(times: Array, n_autocorrelation: float) -> float:
    """Steps, burn-in included, at which the slowest coordinate of all ensembles is served."""
    kept = n_autocorrelation * BURN_SHARE / (BURN_SHARE - 1)
    return float(times.max() * max(kept, BURN_TIMES * BURN_SHARE))


def _next_check(needed: float, check_every: int) -> int:
    if not np.isfinite(needed):
        return np.iinfo(np.int64).max
    return int(np.ceil(needed / check_every)) * check_every


def _result(
    samplers: list[emcee.EnsembleSampler],
    times: Array,
    status: SamplingStatus,
    settings: SamplerSettings,
    box: Box,
) -> SamplingResult:
    done = samplers[0].iteration
    burn = done // BURN_SHARE
    slowest = times.max()
    message = f"{done} steps of {settings.n_walkers} walkers in {len(samplers)} ensembles, " + (
        f"kept {(done - burn) / slowest:.0f} autocorrelation times of {slowest:.1f} steps"
    )
    if status is SamplingStatus.MAX_STEPS:
        message += (
            f"; stopped at max_steps before {settings.n_autocorrelation:g} times were reached"
        )
    chains = np.array([sampler.get_chain(discard=burn) for sampler in samplers])
    log_prob = np.array([sampler.get_log_prob(discard=burn) for sampler in samplers])
    return SamplingResult(
        chains=box.x_of(chains),
        log_prob=log_prob - box.log_jacobian(chains),
        autocorrelation_time=times,
        acceptance=np.array([np.mean(sampler.acceptance_fraction) for sampler in samplers]),
        n_burn=burn,
        status=status,
        message=message,
    )
