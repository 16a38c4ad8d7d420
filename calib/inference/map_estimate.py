"""Maximum a posteriori in x = (ln kappa, r, s, ...): by emulator, then by the direct model.

The refinement is first-order model management (Alexandrov & Lewis, Optim. Eng. 2 (2001) 413): the
emulator is corrected to the value and the gradient of the direct model at the current point, the
corrected posterior is minimised in a trust region, and the step is judged by the direct posterior.
A limit point is one of the direct model alone, whatever the emulator's error. FE forces are rough
on a small scale (contact points come and go), so a slope at one point can mislead: after a first
rejected step the model keeps the emulator's slopes and learns from secants between solves instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from calib.inference.coordinates import theta_of
from calib.inference.corrected import (
    CorrectedForward,
    correct,
    has_slope,
    with_secant,
    without_slope,
)
from calib.inference.forward import DirectForward, ForwardModel
from calib.inference.forward_errors import DirectWithErrors
from calib.inference.minimise import minimise_in_box, projected_gradient
from calib.inference.posterior import Posterior
from fe.response import Array

STEP_TOLERANCE = 0.02  # posterior SDs
GAIN_TOLERANCE = 0.01
"""gain of log posterior that is not worth a solve: a density ratio of 1 %, far below what the
residual roughness of FE forces (node rows that pass the pin's edge) lets one resolve"""
FIRST_RADIUS = 1.0  # posterior SDs
LARGEST_RADIUS = 4.0
N_STARTS = 12
N_CANDIDATES = 2048


class MapStatus(StrEnum):
    """How the refinement with the direct model ended."""

    CONVERGED = "converged"
    BLOCKED = "blocked"
    MAX_SOLVES = "max_solves"
    NO_SOLVE = "no_solve"


@dataclass(frozen=True)
class MapPoint:
    """A maximum of the posterior of one forward model."""

    x: Array
    """(n,) (ln kappa, r, s, ...)"""
    log_prob: float
    """unnormalised log posterior density with respect to x"""
    gradient: Array
    """(n,) projected gradient of the negative log posterior times the posterior SD: zero at a
    maximum, also where a bound is active; that of the model used, see `MapResult.by_secants`"""

    @property
    def theta(self) -> Array:
        """(n,) (kappa [MPa], r, s, ...)"""
        return theta_of(self.x)


@dataclass(frozen=True)
class MapResult:
    """Both maxima and what lies between them."""

    emulator: MapPoint
    direct: MapPoint | None
    """the best point that was solved; None when no direct solve succeeded"""
    maximum: Array | None
    """(n,) x of the maximum that values and slopes (or secants, see `by_secants`) at `direct`
    foretell where the search converged, at most a gain of 0.01 from it; else that of `direct`"""
    difference_sd: Array
    """(n,) (maximum - emulator) in posterior SDs; NaN without a direct maximum"""
    foretold_sd: Array
    """(n,) the same of the maximum foretold at `direct`, within 4 posterior SDs of it, wherever the
    search ended: one that was stopped at the emulator's maximum does not confirm it by that"""
    sd: Array
    """(n,) posterior SD of x used as the unit"""
    n_solves: int
    """direct simulations run, failed ones included"""
    status: MapStatus
    by_secants: bool
    """whether the slopes at the direct maximum are the emulator's with secants between direct
    solves, and not those of the direct model, which were not known or led to a worse point"""
    message: str
    """one sentence on how the refinement ended"""
    solved: Array
    """(k, d) inputs of the direct simulations that reached the end, in the order of solving"""


def emulator_map(posterior: Posterior, sd: Array, rng: np.random.Generator) -> MapPoint:
    """Highest maximum found by bounded L-BFGS-B from the best of many prior draws.

    `sd` (n,) posterior SD of x sets the scale of steps and gradients. Raises ValueError when no
    prior draw has a finite posterior.
    """
    candidates = posterior.prior.sample(rng, N_CANDIDATES)
    values = posterior.log_prob(candidates)
    order = np.argsort(-values)[:N_STARTS]
    starts = candidates[order[np.isfinite(values[order])]]
    if not len(starts):
        raise ValueError(
            f"posterior: zero at all of {N_CANDIDATES} prior draws; check prior and forward model"
        )
    bounds = posterior.prior.bounds
    found = [minimise_in_box(posterior.log_prob, start, bounds, sd, bounds) for start in starts]
    best = max(found, key=lambda end: end[1])[0]
    return _point(posterior, best, sd)


def refine_map(
    posterior: Posterior,
    direct: DirectForward,
    start: MapPoint,
    sd: Array,
    *,
    max_solves: int = 12,
    progress: Callable[[int, int], None] | None = None,
) -> MapResult:
    """Move the emulator's maximum to that of the direct model under the same posterior.

    The same prior, data and errors: the emulator's stated covariance stays in the likelihood.

    Converged when the corrected posterior's maximum lies within 0.02 posterior SDs (largest over
    coordinates) or promises a gain of log posterior below 0.01, the region not in the way: that
    maximum, not the point solved last, is compared with the emulator's. A failed
    or worse direct solve shrinks the region; shrinking below the tolerance ends as `blocked`. At
    most `max_solves` simulations.
    Raises ValueError where an accepted point has forces that are not positive (see `correct`).
    """
    if max_solves < 1:
        raise ValueError(f"max_solves: expected at least 1, got {max_solves}")
    search = _Search(posterior, direct, sd, max_solves, progress)
    status = search.run(start.x)
    point = None
    difference = foretold = np.full(sd.size, np.nan)
    if search.x is not None and search.maximum is not None:
        gradient = projected_gradient(search.model.log_prob, search.x, posterior.prior.bounds, sd)
        point = MapPoint(search.x, search.value, gradient)
        difference = foretold = (search.maximum - start.x) / sd
        if status is not MapStatus.CONVERGED:
            foretold = (search.foretold() - start.x) / sd
    return MapResult(
        emulator=start,
        direct=point,
        maximum=search.maximum,
        difference_sd=difference,
        foretold_sd=foretold,
        sd=sd,
        n_solves=search.solves,
        status=status,
        by_secants=search.rough,
        message=_MESSAGES[status].format(n=counted(search.solves)),
        solved=direct.solved,
    )


_MESSAGES = {
    MapStatus.CONVERGED: "converged after {n}",
    MapStatus.BLOCKED: (
        "stopped after {n}: no smaller step was better, since the direct posterior there is "
        "rougher than the step or cannot be solved"
    ),
    MapStatus.MAX_SOLVES: "stopped at {n} before the step was small",
    MapStatus.NO_SOLVE: "none of {n} succeeded; the emulator's maximum stands",
}


def counted(n: int) -> str:
    """A number of direct simulations in words."""
    return "1 direct simulation" if n == 1 else f"{n} direct simulations"


def _point(posterior: Posterior, x: Array, sd: Array) -> MapPoint:
    value = float(posterior.log_prob(x[None])[0])
    gradient = projected_gradient(posterior.log_prob, x, posterior.prior.bounds, sd)
    return MapPoint(x, value, gradient)


class _Search:
    """State of one refinement: best point so far, model there, its maximum, solves used."""

    def __init__(
        self,
        posterior: Posterior,
        direct: DirectForward,
        sd: Array,
        max_solves: int,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        self._emulator: ForwardModel = posterior.likelihood.forward
        self._n = posterior.prior.space.n_forward
        self._direct = direct
        self._exact = posterior.with_forward(DirectWithErrors(direct, self._emulator))
        self._bounds = posterior.prior.bounds
        self._sd = sd
        self._max_solves = max_solves
        self._progress = progress
        self.solves = 0
        self.rough = False
        self.x: Array | None = None
        self.maximum: Array | None = None
        self.value = -np.inf
        self.model = posterior

    def run(self, start: Array) -> MapStatus:
        """Search from `start`; leaves the best point in `x`, `value`, `model`.

        And in `maximum` what these foretell.
        """
        status = self._first(start)
        radius = FIRST_RADIUS
        while status is None:
            assert self.x is not None
            candidate, promised = self._best_within(self.x, radius)
            length = float(np.abs((candidate - self.x) / self._sd).max())
            if length < STEP_TOLERANCE:
                # A step as long as the region is short for the region, not for a maximum.
                at_edge = length > 0.9 * radius
                status = MapStatus.BLOCKED if at_edge else MapStatus.CONVERGED
            elif promised < GAIN_TOLERANCE and length < 0.9 * radius:
                status = MapStatus.CONVERGED
            elif self.solves >= self._max_solves:
                status = MapStatus.MAX_SOLVES
            else:
                radius = self._step(candidate, promised, length, radius)
            self.maximum = candidate if status is MapStatus.CONVERGED else self.x
        return status

    def foretold(self) -> Array:
        """(n,) maximum of the corrected posterior about the best point that was solved."""
        assert self.x is not None
        return self._best_within(self.x, LARGEST_RADIUS)[0]

    def _first(self, start: Array) -> MapStatus | None:
        """Solve at the start, or failing that ever closer to the middle of the box."""
        middle = self._bounds.mean(axis=1)
        share = 0.0
        while self.solves < self._max_solves:
            x = start + share * (middle - start)
            value = self._solve(x)
            if np.isfinite(value):
                self._accept(x, value)
                return None
            share = 0.1 if share == 0.0 else min(1.0, 2.0 * share)
        return MapStatus.NO_SOLVE

    def _solve(self, x: Array) -> float:
        self.solves += 1
        value = float(self._exact.log_prob(x[None])[0])
        if self._progress is not None:
            self._progress(self.solves, self._max_solves)
        return value

    def _accept(self, x: Array, value: float) -> None:
        corrected = correct(self._emulator, self._direct, x[: self._n])
        self.rough |= not has_slope(self._direct.jacobian(theta_of(x[: self._n])[None]))
        if self.rough and self.x is not None:
            corrected = self._meet(without_slope(corrected), self.x)
        self.x, self.value = x, value
        self.model = self._exact.with_forward(corrected)

    def _learn(self, x: Array) -> None:
        """After a rejected x: trust secants between solves more than the slope at one point."""
        corrected = self.model.likelihood.forward
        assert isinstance(corrected, CorrectedForward)
        if not self.rough:
            corrected = without_slope(corrected)
        self.rough = True
        self.model = self._exact.with_forward(self._meet(corrected, x))

    def _meet(self, corrected: CorrectedForward, x: Array) -> CorrectedForward:
        at, sd = x[: self._n], self._sd[: self._n]
        force = self._direct.predict(theta_of(at)[None]).force[0]
        return with_secant(corrected, force, at, sd)

    def _best_within(self, x: Array, radius: float) -> tuple[Array, float]:
        """Maximum of the corrected posterior in the trust region, and the gain it promises."""
        half = radius * self._sd
        box = np.column_stack(
            [np.maximum(self._bounds[:, 0], x - half), np.minimum(self._bounds[:, 1], x + half)]
        )
        candidate, value = minimise_in_box(self.model.log_prob, x, box, self._sd, self._bounds)
        return candidate, value - float(self.model.log_prob(x[None])[0])

    def _step(self, candidate: Array, promised: float, length: float, radius: float) -> float:
        """Try a candidate with the direct model; returns the next radius."""
        value = self._solve(candidate)
        gain = value - self.value
        if not np.isfinite(value):
            return 0.25 * length
        ratio = gain / promised if promised > 0 else -1.0
        if gain > 0:
            self._accept(candidate, value)
        else:
            self._learn(candidate)
        if ratio < 0.25:
            return 0.5 * length
        if ratio > 0.75 and length > 0.9 * radius:
            return min(2.0 * radius, LARGEST_RADIUS)
        return radius
