"""Where the next runs of a study go, and how far the posterior mean may still move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.inference.coordinates import theta_of
from calib.inference.forward import EmulatorForward
from calib.inference.posterior import Posterior
from calib.inference.quadrature import Quadrature, integrate
from calib.study.judgement import Noise
from calib.study.seen_error import SeenShift, seen_shift
from fe.response import Array
from surrogate import (
    Emulator,
    PredictedShift,
    TrainingSet,
    predicted_shift,
    propose,
    spans_inputs,
)

N_SAMPLE = 400
"""draws of the posterior among which runs are chosen and by which its shift is predicted"""
APART = 0.01
"""share of the design's extent that a new run stays away from others: FE forces are rough over
shorter distances, as contact points come and go, and such runs contradict each other's slopes"""
N_DRAWS = 64
"""draws of the emulator's error"""


@dataclass(frozen=True)
class Outlook:
    """The posterior by one emulator, and what more runs could change."""

    emulator: Emulator
    quadrature: Quadrature
    x: Array
    """(m, n) draws of the posterior of (ln kappa, r, s, ...)"""
    shift: PredictedShift
    """of the mean of (ln kappa, r, s, ...): the larger of the two below"""
    foretold: PredictedShift
    """by what the emulator's processes do not know"""
    seen: SeenShift
    """by the errors that it states, and those at runs left out"""

    def proposals(self, n: int, runs: Array, noise: Noise, rng: np.random.Generator) -> Array:
        """(n, d) points for new runs, apart from the `runs` (k, d) so far and from each other.

        Fewer or none where draws are not.
        """
        ratios, extent = self._inputs, np.ptp(self.emulator.bounds, axis=1)
        distance = np.abs(ratios[:, None] - runs) / extent
        ratios = ratios[(distance.max(axis=2) > APART).all(axis=1)]
        n = min(n, len(np.unique(ratios, axis=0)))
        if not spans_inputs(ratios):
            return np.zeros((0, ratios.shape[1]))
        force_noise = float(np.sqrt(np.mean(noise.force**2)))
        return propose(
            self.emulator,
            ratios,
            n,
            rng,
            force_noise=force_noise,
            # Where there is none, the emulated field does not enter the likelihood.
            field_noise=1e6 if noise.field is None else noise.field,
            apart=APART,
        )

    @property
    def mean(self) -> Array:
        """(d,) inputs of the emulator at the posterior mean."""
        found: Array = self.quadrature.mean[1 : 1 + len(self.emulator.bounds)]
        return found

    @property
    def _inputs(self) -> Array:
        """(m, d) inputs of the emulator at the draws."""
        return self.x[:, 1 : 1 + len(self.emulator.bounds)]


def outlook(
    emulator: Emulator,
    runs: TrainingSet,
    posterior: Posterior,
    forward: EmulatorForward,
    rng: np.random.Generator,
) -> Outlook:
    """Sample the posterior whose forward model is `forward`, that of the emulator of the `runs`.

    The sample is drawn from the nodes of a quadrature, by their weights: independent draws.
    """
    quadrature = integrate(posterior)
    weights = quadrature.weights / quadrature.weights.sum()
    x = quadrature.x[rng.choice(len(weights), N_SAMPLE, p=weights)]
    theta = theta_of(x)
    inputs = x[:, 1 : 1 + len(emulator.bounds)]

    def log_likelihood(unit_force: Array, weights: Array | None) -> Array:
        return posterior.likelihood.log_prob_of(theta, forward.stated(theta, unit_force, weights))

    foretold = predicted_shift(emulator, inputs, log_likelihood, N_DRAWS, rng, quantities=x)
    seen = seen_shift(emulator, runs, posterior.likelihood, forward, x)
    shift = PredictedShift(np.maximum(foretold.shift, seen.total))
    return Outlook(emulator, quadrature, x, shift, foretold, seen)
