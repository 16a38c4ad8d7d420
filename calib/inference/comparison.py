"""Rival hypotheses compared by evidence and fit, and published constants held against the data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from calib.inference.coordinates import CONSTANTS, constants_of, theta_of, theta_of_constants
from calib.inference.likelihood import Likelihood
from calib.inference.minimise import minimise_in_box
from calib.inference.posterior import Posterior
from calib.inference.quadrature import Quadrature
from calib.inference.verdict import HypothesisFit, verdict_of
from fe.response import Array

N_STARTS = 3
"""quadrature nodes from which the best likelihood is searched"""


@dataclass(frozen=True)
class Comparison:
    """All hypotheses of a study against each other."""

    fits: tuple[HypothesisFit, ...]
    """best evidence first"""
    log_bayes_factors: Array
    """(n,) ln evidence ratio of the best to each, in the order of `fits`"""
    verdict: str
    """what the data support and what they cannot separate"""
    trade_off: str
    """mu under each hypothesis"""


def predictive_p_value(posterior: Posterior, quadrature: Quadrature) -> float:
    """Posterior predictive p-value of the chi-square of the forces.

    Discrepancy T = (y - f(theta))^T Sigma(theta)^-1 (y - f(theta)) (Gelman, Meng, Stern, Stat.
    Sinica 6 (1996) 733). Given theta a replicate's T is chi-square of n_step degrees of freedom,
    so the p-value is the posterior mean of its upper tail, without simulation. It is
    conservative: the data were used to find theta. Of Student-t forces T over n_step is F of n_step
    and their degrees of freedom (but for the nuisances of the test, which stay normal).
    """
    kept = quadrature.weights > 1e-9
    misfit = posterior.likelihood.force_misfit(theta_of(quadrature.x[kept]))
    n, freedom = posterior.likelihood.force.size, posterior.likelihood.errors.freedom
    tail = chi2.sf(misfit, n) if freedom is None else f_distribution.sf(misfit / n, n, freedom)
    weights = quadrature.weights[kept]
    return float(weights @ tail / weights.sum())


def best_fit(posterior: Posterior, quadrature: Quadrature) -> tuple[float, float]:
    """Largest ln likelihood in the prior's box, and the forces' chi-square where it is reached.

    Without the prior's density: what the hypothesis can do at its best, whatever share of the
    prior does so. Bounded search from the quadrature nodes of largest likelihood.
    """

    def log_likelihood(x: Array) -> Array:
        value = np.full(len(x), -np.inf)
        inside = np.all((x >= bounds[:, 0]) & (x <= bounds[:, 1]), axis=1)
        if inside.any():
            value[inside] = posterior.likelihood.log_prob(theta_of(x[inside]))
        return value

    bounds = posterior.prior.bounds
    kept = quadrature.x[quadrature.weights > 1e-9]
    at_nodes = np.concatenate([log_likelihood(part) for part in np.array_split(kept, 16)])
    starts = kept[np.argsort(-at_nodes)[:N_STARTS]]
    found = [
        minimise_in_box(log_likelihood, start, bounds, quadrature.sd, bounds) for start in starts
    ]
    x, value = max(found, key=lambda end: end[1])
    return value, float(posterior.likelihood.force_misfit(theta_of(x[None]))[0])


def fit_of(name: str, posterior: Posterior, quadrature: Quadrature) -> HypothesisFit:
    """Evidence, fit and stiffness of one hypothesis."""
    mu = -1  # the last of every law's constants
    max_log_likelihood, best_misfit = best_fit(posterior, quadrature)
    return HypothesisFit(
        name=name,
        log_evidence=quadrature.log_evidence,
        log_evidence_error=quadrature.log_evidence_error,
        p_value=predictive_p_value(posterior, quadrature),
        mu_mean=float(quadrature.constants_mean[mu]),
        mu_sd=float(quadrature.constants_sd[mu]),
        max_log_likelihood=max_log_likelihood,
        best_misfit=best_misfit,
    )


def compare(fits: list[HypothesisFit]) -> Comparison:
    """Rank hypotheses by evidence (equal prior probability) and say what that means.

    Raises ValueError without hypotheses, and for an evidence that is not a number.
    """
    if not fits:
        raise ValueError("fits: expected at least one hypothesis")
    for fit in fits:
        if np.isnan(fit.log_evidence):
            raise ValueError(f"fits: {fit.name}: expected an evidence, found NaN")
    ordered = tuple(sorted(fits, key=lambda fit: -fit.log_evidence))
    factors = np.array([ordered[0].log_evidence - fit.log_evidence for fit in ordered])
    trade_off = "; ".join(
        f"{fit.name}: mu = {fit.mu_mean:.5f} ± {fit.mu_sd:.5f} MPa" for fit in ordered
    )
    return Comparison(ordered, factors, verdict_of(ordered), trade_off)


@dataclass(frozen=True)
class PublishedCheck:
    """Published constants against the posterior and against the measured forces."""

    constants: dict[str, float]
    """C10, C01, C11, mu as published, MPa"""
    z: dict[str, float]
    """(published - posterior mean) / posterior SD of each constant"""
    mahalanobis: float
    """distance of (ln kappa, r, s) from the posterior mean in the metric of their posterior"""
    force: Array
    """(n_step,) force predicted by the published constants, N"""
    force_misfit: float
    """chi-square of these forces against the measured ones with all errors"""
    extrapolated: bool
    """whether the published constants lie outside the prior's box, where the forward model was
    not trained and its forces are extrapolated"""


def check_published(
    published: Mapping[str, float], posterior: Posterior, quadrature: Quadrature
) -> PublishedCheck:
    """How far out published C10, C01, C11 [MPa] lie, and what they predict.

    Of the three-parameter Mooney-Rivlin law; what else is unknown is at its posterior mean.
    """
    theta = theta_of_constants(published["C10"], published["C01"], published["C11"])
    constants = constants_of(theta)
    z = (constants - quadrature.constants_mean) / quadrature.constants_sd
    x = theta.copy()
    x[0] = np.log(x[0])
    off = x - quadrature.mean[:3]
    distance = np.sqrt(off @ np.linalg.solve(quadrature.covariance[:3, :3], off))
    likelihood: Likelihood = posterior.likelihood
    low, high = posterior.prior.bounds[:3].T
    at = np.concatenate([theta, quadrature.mean[3:]])[None]
    return PublishedCheck(
        constants=dict(zip(CONSTANTS, constants.tolist(), strict=True)),
        z=dict(zip(CONSTANTS, z.tolist(), strict=True)),
        mahalanobis=float(distance),
        force=likelihood.predict(at).force[0],
        force_misfit=float(likelihood.force_misfit(at)[0]),
        # kappa scales exactly, so only the ratios can leave what the model was trained on.
        extrapolated=bool(np.any((x < low)[1:] | (x > high)[1:])),
    )
