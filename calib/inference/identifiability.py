"""How the posterior depends on what is assumed about the errors: correlation and travel zero."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.data.dataset import Dataset
from calib.inference.comparison import predictive_p_value
from calib.inference.likelihood import DISCREPANCY
from calib.inference.noise import NoiseSettings, force_errors, travel_zero_sd
from calib.inference.posterior import Posterior
from calib.inference.quadrature import Quadrature, integrate
from fe.response import Array


@dataclass(frozen=True)
class SensitivityRow:
    """Posterior under one pair of assumptions."""

    sample_correlation: float
    travel_zero_sd: float
    """mm"""
    constants_mean: Array
    """posterior mean of the law's constants and mu, MPa"""
    constants_sd: Array
    """posterior SD of the law's constants and mu, MPa"""
    log_evidence: float
    log_evidence_error: float
    p_value: float
    """posterior predictive p-value of the forces"""


def assumption_study(
    dataset: Dataset,
    posterior: Posterior,
    settings: NoiseSettings,
    correlations: Sequence[float],
    travel_zero_sds: Sequence[float] = (),
    *,
    n_nodes: int = 30,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[SensitivityRow, ...]:
    """One row for every rho at the travel zero of the posterior, then for every sigma_0 at its rho.

    That zero is the study's, or what the data state where larger (`calib.inference.noise`).
    Only the errors of the force and the zero of the travel change; prior, forward model,
    discretisation and noise of the field stay. By quadrature, so that rows differ by the
    assumption and not by Monte-Carlo error.
    """
    settings = replace(settings, travel_zero_sd=travel_zero_sd(dataset, settings))
    cases = [replace(settings, sample_correlation=rho) for rho in correlations]
    cases += [replace(settings, travel_zero_sd=sd) for sd in travel_zero_sds]
    rows = []
    for index, case in enumerate(cases):
        changed = with_noise(dataset, posterior, case)
        rows.append(_row(changed, integrate(changed, n_nodes), case))
        if progress is not None:
            progress(index + 1, len(cases))
    return tuple(rows)


def with_noise(dataset: Dataset, posterior: Posterior, settings: NoiseSettings) -> Posterior:
    """The posterior under other assumptions on the force errors and the zero of the travel."""
    likelihood = posterior.likelihood
    dataset = replace(dataset, travel_zero_sd=0.0)  # each case says what it is
    errors = force_errors(
        dataset,
        settings,
        likelihood.errors.discretisation,
        unknown_discrepancy=DISCREPANCY in likelihood.unknown,
    )
    field = likelihood.field
    if field is not None:
        field = replace(field, shifts=np.stack([error.field for error in errors.shared]))
    return replace(posterior, likelihood=replace(likelihood, errors=errors, field=field))


def _row(posterior: Posterior, quadrature: Quadrature, case: NoiseSettings) -> SensitivityRow:
    return SensitivityRow(
        sample_correlation=case.sample_correlation,
        travel_zero_sd=case.travel_zero_sd,
        constants_mean=quadrature.constants_mean,
        constants_sd=quadrature.constants_sd,
        log_evidence=quadrature.log_evidence,
        log_evidence_error=quadrature.log_evidence_error,
        p_value=predictive_p_value(posterior, quadrature),
    )
