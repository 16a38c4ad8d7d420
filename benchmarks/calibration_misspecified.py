"""Truths that the model cannot be: another law, compressible, friction where stick is assumed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import logsumexp

from benchmarks import calibration_runs as runs
from benchmarks.calibration_experiments import by_runs, likelihood_of, sbc_prior
from benchmarks.calibration_figures import emulator, points
from calib.data import thesis_forces
from calib.inference import Likelihood, Posterior, Prior, integrate
from calib.inference.discrepancy import TRAVEL_LENGTH, with_discrepancy
from calib.inference.rank_uniformity import clustered_error
from calib.inference.weighted_draws import WeightedDraws, draw_weighted
from fe.response import Array

SHARES = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
"""relative SDs of the model's error, equally likely before the data"""
COMMON_LENGTH = 4.0
"""mm of travel: an error of the forces that is all but a common factor; set after the figures with
that of `calib.inference.discrepancy` had been seen, so no more than a comparison"""
N_DRAWS = 2048
"""for each share"""
LEVEL = 0.95
"""of the central interval of mu"""


def figures(store: Path, n: int) -> dict[str, Any]:
    """Share of experiments whose interval of mu holds the truth, with the discrepancy and without.

    Truths are by FE: `N_OTHER` Ogden blocks, each serving n / N_OTHER experiments with a modulus
    and errors of measurement of their own. The model sticks and is nearly incompressible.
    """
    prior = sbc_prior()
    without = likelihood_of(emulator(store, "stuck", 20, True), points())
    # kappa = mu / 2 of a run at mu = 2 MPa is 1 MPa, as for ratios; (r, s) have no truth here.
    experiments = by_runs(without, prior, runs.other_truths(store), n, runs.SEED + 5)
    told: dict[str, Any] = {"misspecified_n": n, "misspecified_level": LEVEL}
    for name, rivals in (
        ("without", [without]),
        ("with", _rivals(without, TRAVEL_LENGTH)),
        ("with_common", _rivals(without, COMMON_LENGTH)),
    ):
        found = _below(store / "placed" / f"ogden-{name}", rivals, prior, experiments)
        inside = (np.abs(found["below"] - 0.5) <= 0.5 * LEVEL).astype(float)
        told |= {
            f"misspecified_coverage_{name}": float(inside.mean()),
            f"misspecified_coverage_{name}_standard_error": clustered_error(
                inside, experiments.run
            ),
            f"misspecified_bias_{name}": float(found["off"].mean()),
            f"misspecified_sd_{name}": float(found["sd"].mean()),
        }
        if len(rivals) > 1:
            told[f"misspecified_share_{name}"] = float(found["share"].mean())
    return told


def _rivals(without: Likelihood, force_length: float) -> list[Likelihood]:
    """One for each size of the model's error."""
    travel = thesis_forces().travel
    return [
        with_discrepancy(without, travel, points(), share, force_length=force_length)
        for share in SHARES
    ]


def _below(
    path: Path, rivals: list[Likelihood], prior: Prior, experiments: Any
) -> dict[str, Array]:
    """Posterior probability below the true mu, mean and SD of ln mu, by experiment; kept."""
    file = path.with_suffix(f".{len(experiments.x)}.npz")
    if not file.exists():
        fields = [rival.field.of_fields(experiments.field) for rival in rivals if rival.field]
        rows = []
        for index, (x, force) in enumerate(zip(experiments.x, experiments.force, strict=True)):
            posteriors = [
                Posterior(prior, Likelihood(rival.forward, force, rival.errors, own[index]))
                for rival, own in zip(rivals, fields, strict=True)
            ]
            rows.append(_of(posteriors, x[0], index))
            if index % 10 == 0:
                print(f"  {path.name}: {index}/{len(experiments.x)}", flush=True)
        file.parent.mkdir(parents=True, exist_ok=True)
        names = ("below", "off", "sd", "share", "ess")
        np.savez(file, **dict(zip(names, np.array(rows).T, strict=True)))
    with np.load(file) as stored:
        return {name: stored[name] for name in stored.files}


def _of(
    posteriors: list[Posterior], truth: float, index: int
) -> tuple[float, float, float, float, float]:
    """Average over the shares by their evidence: what their posterior probability is."""
    found = [
        _sampled(posterior, np.random.default_rng([7, index, k]))
        for k, posterior in enumerate(posteriors)
    ]
    evidence = np.array([draws.log_evidence for draws in found])
    each = np.exp(evidence - logsumexp(evidence))
    x = np.concatenate([draws.x[:, 0] for draws in found])
    weights = np.concatenate([p * draws.weights for p, draws in zip(each, found, strict=True)])
    mean = float(weights @ x)
    return (
        float(weights @ (x < truth)),
        mean - truth,
        float(np.sqrt(weights @ (x - mean) ** 2)),
        float(each @ np.array(SHARES[: len(each)])),
        float(1.0 / np.sum(weights**2)),
    )


def _sampled(posterior: Posterior, rng: np.random.Generator) -> WeightedDraws:
    """Weighted draws, or the nodes of a quadrature where a posterior is squeezed into a corner."""
    try:
        return draw_weighted(posterior, rng, N_DRAWS)
    except ValueError:
        exact = integrate(posterior, 18)
        return WeightedDraws(exact.x, exact.weights, exact.log_evidence, 0)
