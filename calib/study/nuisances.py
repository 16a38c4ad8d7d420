"""The noise in comparison.json and the report: nuisances of the test, other assumptions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calib.inference.coordinates import theta_of
from calib.inference.posterior import Posterior
from calib.study.tables import Table, number
from fe.response import Array

N_DRAWS = 2000


def nuisances_of(posterior: Posterior, draws: Array) -> list[dict[str, object]]:
    """Posterior mean and SD of each nuisance that is integrated out, over draws x (n, d).

    By the laws of total expectation and variance from the normal that each draw leaves.
    """
    likelihood = posterior.likelihood
    theta = theta_of(_some(draws))
    found = likelihood.shared_posterior(theta)
    variance = np.einsum("mqq->mq", found.covariance)
    mean, total = found.mean.mean(axis=0), variance.mean(axis=0) + found.mean.var(axis=0)
    return [
        {
            "name": error.name,
            "unit": error.unit,
            "prior_sd": error.sd,
            "mean": error.sd * mean[i],
            "sd": error.sd * np.sqrt(total[i]),
        }
        for i, error in enumerate(likelihood.errors.shared)
        if error.sd > 0
    ]


def discrepancy_of(posterior: Posterior, draws: Array) -> dict[str, object] | None:
    """Ln of the factor by which the model errs: mean over draws, and the SD of the means.

    None without a discrepancy.
    """
    likelihood = posterior.likelihood
    if likelihood.errors.discrepancy is None:
        return None
    found = likelihood.force_factor(theta_of(_some(draws)))
    return {"mean": found.mean(axis=0), "sd_over_draws": found.std(axis=0), "unit": "1"}


def _some(draws: Array) -> Array:
    every = max(1, len(draws) // N_DRAWS)
    return draws[::every]


def nuisance_table(comparison: Mapping[str, Any]) -> Table | None:
    """Nuisances before and after the data; None where the study has none."""
    rows = []
    for name, found in comparison["hypotheses"].items():
        for entry in found.get("nuisances", ()):
            unit = "-" if entry["unit"] == "1" else entry["unit"]
            rows.append(
                (
                    name,
                    entry["name"],
                    unit,
                    f"0 ± {number(entry['prior_sd'], 3)}",
                    f"{number(entry['mean'], 3)} ± {number(entry['sd'], 3)}",
                )
            )
    notes = [
        f"{name}, discrepancy, factor of the predicted forces: "
        + ", ".join(number(np.exp(value), 3) for value in found["ln_force_factor"]["mean"])
        + "."
        for name, found in comparison["hypotheses"].items()
        if found.get("ln_force_factor")
    ]
    if not rows and not notes:
        return None
    return Table(
        "Nuisances of the test, integrated out of the posterior",
        ("hypothesis", "nuisance", "unit", "before the data", "after"),
        tuple(rows),
        " ".join(["A posterior as wide as the prior says that the data know nothing.", *notes]),
    )


def correlation_table(comparison: Mapping[str, Any]) -> Table | None:
    """How the posterior changes with what is assumed of the noise."""
    found = comparison["correlation_study"]
    constants = list(dict.fromkeys(name for row in found for name in row["mean"]))
    rows = tuple(
        (
            row["hypothesis"],
            f"{row['sample_correlation']:g}",
            f"{row['travel_zero_sd']:g}",
            *(_mean_sd(row, constant) for constant in constants),
            f"{row['log_evidence']:.1f}",
            f"{row['predictive_p']:.2g}",
        )
        for row in comparison["correlation_study"]
    )
    if not rows:
        return None
    return Table(
        "Posterior under other assumptions on the noise (mean ± SD, by quadrature)",
        (
            "hypothesis",
            "rho [-]",
            "zero [mm]",
            *(f"{constant} [{'-' if 'alpha' in constant else 'MPa'}]" for constant in constants),
            "ln evid. [-]",
            "p [-]",
        ),
        rows,
        "rho: correlation of one sample's deviation between neighbouring increments; zero: SD of "
        "the travel's zero; p: posterior predictive p-value of the forces.",
    )


def _mean_sd(row: Mapping[str, Any], constant: str) -> str:
    if constant not in row["mean"]:
        return "-"
    return f"{number(row['mean'][constant], 3)} ± {number(row['sd'][constant], 2)}"
