"""Stage `compare`: hypotheses by evidence and fit, published constants, other assumptions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calib.data import Dataset
from calib.inference.at_bound import at_bound, leaning_sentence
from calib.inference.comparison import check_published, compare, fit_of
from calib.inference.identifiability import SensitivityRow, assumption_study
from calib.inference.laws import DEFAULT_LAW
from calib.inference.noise import travel_zero_sd
from calib.inference.posterior import Posterior
from calib.inference.quadrature import Quadrature, integrate
from calib.inference.verdict import HypothesisFit
from calib.study.artifacts import write_json
from calib.study.context import Context
from calib.study.data_stage import StudyData, load_data
from calib.study.nuisances import discrepancy_of, nuisances_of
from calib.study.posterior_setup import emulator_posterior, noise_of
from calib.study.sample_stage import StoredSamples, load_samples
from calib.study.unknowns import prior_of
from fe.progress_bar import progress_bar


def run(context: Context) -> list[Path]:
    """Compare the hypotheses and write comparison.json; returns its path."""
    study, data = context.study, load_data(context.out)
    posteriors = {h.name: emulator_posterior(context, h) for h in study.hypotheses}
    quadratures = _integrals(context, posteriors)
    fits = {name: fit_of(name, posteriors[name], quadratures[name]) for name in posteriors}
    comparison = compare(list(fits.values()))
    weights = {name: np.exp(fit.log_evidence - _best(fits)) for name, fit in fits.items()}
    found: dict[str, Any] = {}
    for hypothesis in study.hypotheses:
        name = hypothesis.name
        samples = load_samples(context.out, hypothesis)
        whole = prior_of(study, hypothesis, with_field=data.dataset.field is not None)
        leaning = at_bound(samples.result.draws, whole.bounds, whole.space, whole.constant_bounds)
        found[name] = {
            "log_evidence": fits[name].log_evidence,
            "log_evidence_error": fits[name].log_evidence_error,
            "probability": weights[name] / sum(weights.values()),
            "predictive_p": fits[name].p_value,
            "max_log_likelihood": fits[name].max_log_likelihood,
            "best_force_misfit": fits[name].best_misfit,
            "mu_mean": fits[name].mu_mean,
            "mu_sd": fits[name].mu_sd,
            "published": _published(data, posteriors[name], quadratures[name]),
            "quadrature": _against_chains(quadratures[name], samples),
            "nuisances": nuisances_of(posteriors[name], samples.result.draws),
            "ln_force_factor": discrepancy_of(posteriors[name], samples.result.draws),
            "at_bound": leaning,
            "at_bound_text": leaning_sentence(name, leaning),
        }
    facts = {
        "units": {"force": "N", "travel": "mm", "constants": "MPa"},
        "synthetic": data.dataset.synthetic,
        "travel": data.dataset.travel,
        "force_mean": data.dataset.force_mean,
        "hypotheses": found,
        "verdict": [comparison.verdict, *_remarks(comparison.trade_off, found, data)],
        "correlation_study": _assumptions(context, data.dataset, posteriors),
    }
    write_json(context.out / "comparison.json", facts)
    return [context.out / "comparison.json"]


def _integrals(context: Context, posteriors: dict[str, Posterior]) -> dict[str, Quadrature]:
    """Moments and evidence of each hypothesis, which takes minutes where sizes are unknown."""
    found: dict[str, Quadrature] = {}
    with progress_bar("integrals", "hypothesis", shown=context.show_progress) as progress:
        for name, posterior in posteriors.items():
            progress(len(found), len(posteriors))
            try:
                found[name] = integrate(posterior)
            except ValueError as error:
                raise ValueError(f"hypothesis {name}: {error}") from error
        progress(len(found), len(posteriors))
    return found


def _best(fits: dict[str, HypothesisFit]) -> float:
    return max(fit.log_evidence for fit in fits.values())


def _published(
    data: StudyData, posterior: Posterior, quadrature: Quadrature
) -> dict[str, object] | None:
    law = posterior.prior.space.law
    if data.published is None or law.name != DEFAULT_LAW:
        return None
    check = check_published(data.published, posterior, quadrature)
    mean = dict(zip(law.constants, quadrature.constants_mean.tolist(), strict=True))
    return {
        "constants": check.constants,
        "posterior_mean": mean,
        "z": check.z,
        "mahalanobis": check.mahalanobis,
        "force": check.force,
        "force_misfit": check.force_misfit,
        "extrapolated": check.extrapolated,
    }


def _against_chains(quadrature: Quadrature, samples: StoredSamples) -> dict[str, object]:
    """Posterior moments without a sampler, and how far those of the chains are from them."""
    draws = samples.result.draws
    return {
        "x": quadrature.space.x_names,
        "mean": quadrature.mean,
        "sd": quadrature.sd,
        "chains_mean_difference_sd": (draws.mean(axis=0) - quadrature.mean) / quadrature.sd,
        "chains_sd_ratio": draws.std(axis=0) / quadrature.sd,
    }


def _remarks(trade_off: str, found: dict[str, Any], data: StudyData) -> list[str]:
    """Sentences beyond the verdict: stiffness against contact, and the published constants."""
    remarks = []
    if len(found) > 1:
        remarks.append(
            "The shear modulus that the same data give depends on the hypothesis, as contact, "
            f"height and law trade off against stiffness ({trade_off})."
        )
    remarks += [facts["at_bound_text"] for facts in found.values() if facts["at_bound"]]
    for name, facts in found.items():
        if facts["published"] is None:
            continue
        ratio = np.asarray(facts["published"]["force"]) / data.dataset.force_mean
        remark = (
            f"Under {name} the published constants predict {ratio.min():.2g} to "
            f"{ratio.max():.2g} times the {_kind(data)} forces"
        )
        if facts["published"]["extrapolated"]:
            remark += ", by extrapolation beyond the ratios that the emulator was trained on"
        remarks.append(f"{remark}.")
    return remarks


def _kind(data: StudyData) -> str:
    return "synthetic" if data.dataset.synthetic else "measured"


def _assumptions(
    context: Context, dataset: Dataset, posteriors: dict[str, Posterior]
) -> list[dict[str, object]]:
    study = context.study
    correlations = study.noise.correlation_study
    if not correlations:
        return []
    rows: list[dict[str, object]] = []
    zeros = other_travel_zeros(travel_zero_sd(dataset, noise_of(study)))
    per_hypothesis = len(correlations) + len(zeros)
    with progress_bar("assumptions", "posterior", shown=context.show_progress) as progress:
        for order, (name, posterior) in enumerate(posteriors.items()):
            before = order * per_hypothesis
            total = per_hypothesis * len(posteriors)

            def report(done: int, _: int, before: int = before, total: int = total) -> None:
                progress(before + done, total)

            study_rows = assumption_study(
                dataset, posterior, noise_of(study), correlations, zeros, progress=report
            )
            names = posterior.prior.space.law.constants
            rows += [_row(name, names, row) for row in study_rows]
    return rows


def other_travel_zeros(own: float) -> tuple[float, ...]:
    """SDs of the travel's zero to compare with: none, and twice that of the posterior, mm."""
    return (0.0, 2.0 * own) if own > 0 else ()


def _row(hypothesis: str, names: Sequence[str], row: SensitivityRow) -> dict[str, object]:
    return {
        "hypothesis": hypothesis,
        "sample_correlation": row.sample_correlation,
        "travel_zero_sd": row.travel_zero_sd,
        "mean": dict(zip(names, row.constants_mean.tolist(), strict=True)),
        "sd": dict(zip(names, row.constants_sd.tolist(), strict=True)),
        "log_evidence": row.log_evidence,
        "predictive_p": row.p_value,
    }
