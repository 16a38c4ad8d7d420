"""Convergence of stored draws, and Pareto-smoothed weights, by ArviZ."""

from __future__ import annotations

from dataclasses import dataclass

import arviz as az
import numpy as np
import xarray as xr

from calib.inference.autocorrelation import integrated_time
from fe.response import Array


@dataclass(frozen=True)
class Convergence:
    """Diagnostics of one quantity under one hypothesis."""

    ess_bulk: float
    """effective sample size for the centre: the smaller of ArviZ's over walkers and draws/tau"""
    ess_tail: float
    """the same for the 5 % and 95 % quantiles"""
    r_hat: float
    """rank-normalised split R-hat over the independent ensembles"""


def smoothed_weights(log_ratios: Array, efficiency: float = 1.0) -> tuple[Array, Array]:
    """Pareto-smoothed log weights (m, k), each column summing to 1, and Pareto shapes (k,).

    `log_ratios` (m, k) are ln of the importance ratios of m draws to k targets, up to constants. Of
    draws whose `efficiency`, independent ones a draw, is smaller, a longer tail is fitted.
    """
    stacked = xr.DataArray(log_ratios.T, dims=("target", "__sample__"))
    weights, shape = az.psislw(stacked, reff=efficiency)  # type: ignore[no-untyped-call]
    values: Array = np.asarray(weights.values, dtype=np.float64).T
    return values, np.asarray(shape.values, dtype=np.float64)


def convergence(data: az.InferenceData, hypothesis: str) -> dict[str, Convergence]:
    """Diagnostics of every posterior variable that there is under one hypothesis.

    R-hat compares ensembles, each one chain in the order of time: walkers of an ensemble are not
    independent, so comparing them says little. For the effective size every walker is a chain
    (walkers interleaved in one chain would look less correlated than they are), and the result
    is not allowed above (number of draws) / (autocorrelation time averaged over walkers).
    """
    posterior = data["posterior"].sel(hypothesis=hypothesis)
    ensemble = posterior["ensemble"].values
    result = {}
    for name in posterior.data_vars:
        draws = posterior[name].transpose("chain", "draw").values
        if not np.isfinite(draws).any():
            continue  # not a parameter under this hypothesis
        result[str(name)] = convergence_of(draws, ensemble)
    return result


def convergence_of(draws: Array, ensemble: Array) -> Convergence:
    """Diagnostics of draws (chain, draw), with the ensemble of each chain (chain,)."""
    return Convergence(
        ess_bulk=min(_ess(draws, "bulk"), _ess_by_tau(draws, ensemble)),
        ess_tail=min(_ess(draws, "tail"), _tail_by_tau(draws, ensemble)),
        r_hat=_r_hat(draws, ensemble),
    )


def _by_ensemble(draws: Array, ensemble: Array) -> list[Array]:
    """(n_draw, n_walker) of each ensemble."""
    return [draws[ensemble == index].T for index in np.unique(ensemble)]


def _ess(draws: Array, method: str) -> float:
    return float(az.ess(draws, method=method))  # type: ignore[no-untyped-call]


def _r_hat(draws: Array, ensemble: Array) -> float:
    in_time = np.array([values.ravel() for values in _by_ensemble(draws, ensemble)])
    return float(az.rhat(in_time, method="rank"))  # type: ignore[no-untyped-call]


def _ess_by_tau(draws: Array, ensemble: Array) -> float:
    """Draws over the longest autocorrelation time of the ensembles; 0 when it is not known."""
    return draws.size / max(integrated_time(values) for values in _by_ensemble(draws, ensemble))


def _tail_by_tau(draws: Array, ensemble: Array) -> float:
    low, high = np.quantile(draws, [0.05, 0.95])
    return min(
        _ess_by_tau((draws <= low).astype(np.float64), ensemble),
        _ess_by_tau((draws >= high).astype(np.float64), ensemble),
    )
