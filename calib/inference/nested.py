"""Evidence and moments by nested sampling (dynesty): any number of unknowns, no grid.

Skilling, Bayesian Analysis 1 (2006) 833; Speagle, MNRAS 493 (2020) 3132.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dynesty import NestedSampler

from calib.inference.data_parts import log_likelihood
from calib.inference.moments import Moments
from calib.inference.posterior import Posterior
from fe.response import Array

FLOOR = -1e100
"""what dynesty is told of a likelihood of zero: it takes no infinities"""
FEW = 4


@dataclass(frozen=True)
class Nested:
    """Weighted draws of the posterior and its evidence."""

    moments: Moments
    log_evidence: float
    log_evidence_error: float
    """SD by dynesty's estimate from the information and the number of live points"""
    n_calls: int


def nested(
    posterior: Posterior, rng: np.random.Generator, *, n_live: int = 400, dlogz: float = 0.01
) -> Nested:
    """Nested sampling of a posterior from its prior, until what is left adds less than `dlogz`.

    Priors of the constants that a box of kappa and ratios cuts off are drawn from whole, and the
    likelihood is zero beyond the box.
    Raises ValueError for fewer live points than dynesty can bound (2 d + 1).
    """
    prior, drawn = posterior.prior, posterior.prior.uncut
    low, high = prior.bounds.T
    d = len(low)
    if n_live < 2 * d + 1:
        raise ValueError(f"n_live: expected at least {2 * d + 1}, got {n_live}")

    def value(x: Array) -> float:
        if drawn is not prior and not ((low <= x) & (x <= high)).all():
            return FLOOR
        found = float(log_likelihood(posterior, x[None])[0])
        return found if np.isfinite(found) else FLOOR

    def transform(unit: Array) -> Array:
        return np.asarray(drawn.quantile(np.asarray(unit)[None])[0])

    # Bounds by ellipsoids with a wide margin in few dimensions, where posteriors that lean on a
    # bound of the prior have corners; random walks in more.
    how = {"sample": "unif", "bootstrap": 0, "enlarge": 2.0} if d <= FEW else {"sample": "rwalk"}
    sampler = NestedSampler(value, transform, d, nlive=n_live, rstate=rng, **how)
    # Not by its wrappers, which print a traceback at a Ctrl-C.
    sampler.loglikelihood.loglikelihood, sampler.prior_transform = value, transform
    sampler.run_nested(dlogz=dlogz, print_progress=False)
    found = sampler.results
    # Draws of a prior that was cut are of what is inside, see `Prior.within`; those of an uncut one
    # count it as if it were not.
    share = prior.log_share - (0.0 if drawn is prior else prior.log_mass)
    log_weights = np.asarray(found["logwt"]) - float(found["logz"][-1])
    weights = np.exp(log_weights)
    return Nested(
        moments=Moments(np.asarray(found["samples"], dtype=np.float64), weights / weights.sum()),
        log_evidence=float(found["logz"][-1]) + share,
        log_evidence_error=float(found["logzerr"][-1]),
        n_calls=int(np.sum(found["ncall"])),
    )
