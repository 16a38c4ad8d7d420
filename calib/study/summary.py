"""The table of a posterior: constants, intervals, diagnostics, maxima; for readers.

Everything is read from posterior.nc, so that the table can be had long after the study, from that
file alone. Of a study that takes its samples one by one population_<hypothesis>.nc beside it tells
of these.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib.inference.at_bound import AtBound, at_bound
from calib.inference.convergence import Convergence, convergence
from calib.inference.inference_data import load_inference_data, provenance_of
from calib.inference.laws import DEFAULT_LAW
from calib.inference.verdict import HOPELESS, NONE_EXPLAINS, POOR_FIT
from calib.study.artifacts import of_another_run, read_json
from calib.study.figure_style import INTERVAL, Array, hdi
from calib.study.further_table import further_table
from calib.study.maxima_table import is_verified, largest_difference, unconfirmed
from calib.study.population_checks import SAMPLES
from calib.study.population_summary import (
    PopulationSummary,
    load_population,
    population_path,
    population_remarks,
)
from calib.study.population_tables import population_tables
from calib.study.predictive_tables import CHECKS
from calib.study.provenance_facts import maxima_in, space_in, truth_in
from calib.study.remarks import odd_one_out, unlike_field, unlike_forces
from calib.study.summary_tables import constants_table, points_table

INTERVAL_NAME = f"{INTERVAL:.0%} HDI"
UNIT = "MPa"


@dataclass(frozen=True)
class ConstantSummary:
    """Posterior of one constant under one hypothesis; None where something was not found."""

    unit: str
    mean: float
    sd: float
    hdi_low: float
    hdi_high: float
    ess_bulk: float
    ess_tail: float
    r_hat: float
    map_emulator: float | None
    map_fe: float | None
    map_difference_sd: float | None
    """direct FE minus emulator, in posterior SDs"""
    published: float | None
    published_z: float | None
    """(published - mean) / SD"""


@dataclass(frozen=True)
class Summary:
    """Posterior of all constants under one hypothesis, and whether it may be relied on."""

    study: str
    seed: int
    version: str
    hypothesis: str
    interval: str
    synthetic: bool
    truth: dict[str, float] | None
    """constants behind synthetic data if they were made under this hypothesis, MPa"""
    constants: dict[str, ConstantSummary]
    further: dict[str, ConstantSummary]
    """what else was unknown: of the forward model and of the errors"""
    diagnostics: dict[str, Any]
    at_bound: tuple[AtBound, ...]
    """bounds of the prior that the posterior leans on"""
    failures: tuple[str, ...]
    """diagnostics outside the limits of the study, one sentence each"""
    predictive_p: float | None = None
    """posterior predictive p-value of the forces' chi-square, where it is known"""
    mesh_remark: str = ""
    """a sentence where the posterior lies far from the last check of its mesh"""
    remarks: tuple[str, ...] = ()
    """what should be seen before a number is used, one sentence each"""
    population: PopulationSummary | None = None
    """the hierarchical model, where samples were taken one by one"""

    @property
    def passed(self) -> bool:
        """Whether all diagnostics are within the limits of the study."""
        return not self.failures

    @property
    def verified(self) -> bool:
        """Whether direct FE confirms the emulator's maximum."""
        return bool(self.diagnostics["map"]["verified"])

    @property
    def contradicted(self) -> bool:
        """Whether the forces lie outside what the hypothesis can explain, as `verdict` judges."""
        return self.predictive_p is not None and self.predictive_p < POOR_FIT


def load_summary(path: Path) -> list[Summary]:
    """Summaries of all hypotheses in a posterior.nc.

    Raises ValueError naming the file when it is damaged or no posterior of this program.
    """
    data = load_inference_data(path)
    provenance: dict[str, Any] = dict(provenance_of(data))
    try:
        names = [str(name) for name in data["posterior"]["hypothesis"].values]
        found = [
            summarise(
                name,
                {
                    str(c): data["posterior"][c].sel(hypothesis=name).values.ravel()
                    for c in data["posterior"].data_vars
                },
                convergence(data, name),
                provenance,
                leaning(data["posterior"].sel(hypothesis=name), provenance),
            )
            for name in names
        ]
    except KeyError as error:
        raise ValueError(f"{path}: holds no {error}; run the study again") from error
    found = [_with_checks(summary, path.parent) for summary in found]
    if provenance.get("study_file", {}).get("data", {}).get("level") != SAMPLES:
        return found
    return [_with_population(summary, path.parent) for summary in found]


def _with_checks(summary: Summary, folder: Path) -> Summary:
    """With what the predictive checks of the same run say of the data, where they are there."""
    path = folder / CHECKS
    if not path.is_file() or of_another_run(folder, "predict", "posterior"):
        return summary
    found, name = read_json(path), summary.hypothesis
    # One sentence on single forces is enough: one outside the fit is odd among the others, too.
    said = unlike_forces(found, name) or odd_one_out(found, name)
    said = [*said, *unlike_field(found, name)]
    return replace(summary, remarks=(*summary.remarks, *said))


def _with_population(summary: Summary, folder: Path) -> Summary:
    """With the population of the same study and run, where its file is there."""
    path = population_path(folder, summary.hypothesis)
    if not path.is_file():
        failure = "population: not sampled yet, as the study file asks for; `calib run` goes on"
        return replace(summary, failures=(*summary.failures, failure))
    if reason := of_another_run(folder, "population", "posterior"):
        failure = f"population: {path.name} is left out: {reason}; `calib run` makes it anew"
        return replace(summary, failures=(*summary.failures, failure))
    population = load_population(path)
    failures = (*summary.failures, *population.failures)
    return replace(summary, population=population, failures=failures)


def summarise(
    hypothesis: str,
    draws: Mapping[str, Array],
    found: Mapping[str, Convergence],
    provenance: Mapping[str, Any],
    at_bound: tuple[AtBound, ...] = (),
) -> Summary:
    """Summary of one hypothesis from draws (n,) of each constant [MPa], diagnostics, provenance.

    The draws may hold more than the constants of the hypothesis.
    """
    facts = provenance["hypotheses"][hypothesis]
    space = space_in(facts)
    law = space.law
    published = (provenance["published"] or {}) if law.name == DEFAULT_LAW else {}
    constants = {
        name: _constant(unit, draws[name], found[name], maxima_in(name, facts), published.get(name))
        for name, unit in zip(law.constants, law.units, strict=True)
    }
    further = {
        u.name: _constant(u.unit, draws[u.name], found[u.name], (None, None, None), None)
        for u in (*space.inputs, *space.errors)
    }
    limits = provenance["limits"]
    failures = [
        *(f for name, c in (constants | further).items() for f in _unconverged(name, c, limits)),
        *facts["emulator_failures"],
    ]
    # A search that ends at the roughness of the FE forces is told, with its distance, not failed.
    if facts["map"]["fe"] is None:
        failures.append(f"MAP: the search with the FE model: {facts['map']['message']}")
    found_by = {"sampling": facts["sampling"], "emulator": facts["emulator"]}
    diagnostics = {"limits": limits, **found_by, "map": _search(facts["map"])}
    return Summary(
        study=provenance["study"],
        seed=provenance["seed"],
        version=provenance["version"],
        hypothesis=hypothesis,
        interval=INTERVAL_NAME,
        synthetic=provenance["synthetic"],
        truth=truth_in(provenance, hypothesis, tuple(constants)),
        constants=constants,
        further=further,
        diagnostics=diagnostics,
        at_bound=at_bound,
        failures=tuple(failures),
        # posteriors of 0.3 before these have none
        predictive_p=facts.get("predictive_p"),
        mesh_remark=facts.get("mesh_remark", ""),
        remarks=tuple(facts.get("remarks", ())),
    )


def _search(found: Mapping[str, Any]) -> dict[str, Any]:
    """How the search with the FE model ended, and whether it verifies the emulator's maximum."""
    verified = {"verified": is_verified(found), "difference_sd": largest_difference(found)}
    return {key: found[key] for key in ("converged", "n_fe_solves", "message")} | verified


def leaning(posterior: Any, provenance: Mapping[str, Any]) -> tuple[AtBound, ...]:
    """Bounds of the stored prior on which the stored draws of one hypothesis lean."""
    facts = provenance["hypotheses"][str(posterior["hypothesis"].values)]
    space, bounds = space_in(facts), np.array(facts["bounds"])
    columns = [
        np.log(posterior[u.name].values.ravel()) if u.log else posterior[u.name].values.ravel()
        for u in space.unknowns
    ]
    stated = facts.get("constant_bounds")
    constants = None if stated is None else np.array(stated)
    return at_bound(np.stack(columns, axis=-1), bounds, space, constants)


def _constant(
    unit: str,
    draws: Array,
    found: Convergence,
    maxima: tuple[float | None, float | None, float | None],
    published: float | None,
) -> ConstantSummary:
    mean, sd = float(draws.mean()), float(draws.std(ddof=1))
    low, high = hdi(draws)
    return ConstantSummary(
        unit=unit,
        mean=mean,
        sd=sd,
        hdi_low=low,
        hdi_high=high,
        ess_bulk=found.ess_bulk,
        ess_tail=found.ess_tail,
        r_hat=found.r_hat,
        map_emulator=maxima[0],
        map_fe=maxima[1],
        map_difference_sd=maxima[2],
        published=published,
        published_z=None if published is None else (published - mean) / sd,
    )


def _unconverged(
    name: str, constant: ConstantSummary, limits: Mapping[str, float]
) -> Iterator[str]:
    """Rules of convergence that a constant violates; a value that is not a number violates."""
    if not constant.r_hat <= limits["max_r_hat"]:
        yield f"{name}: R-hat is {constant.r_hat:.4f}, above {limits['max_r_hat']:g}"
    for label, value in (("bulk", constant.ess_bulk), ("tail", constant.ess_tail)):
        if not value >= limits["min_ess"]:
            yield f"{name}: ESS ({label}) is {value:.0f}, below {limits['min_ess']:g}"


def unverified(summaries: Sequence[Summary]) -> list[str]:
    """Whose maximum direct FE does not confirm; where it found none, that is a failure."""
    return [
        f"{s.hypothesis}: {unconfirmed(s.diagnostics['map']['difference_sd'])}"
        for s in summaries
        if not s.verified and s.diagnostics["map"]["difference_sd"] is not None
    ]


def judgement_lines(summaries: Sequence[Summary]) -> list[str]:
    """Whether the numbers may be relied on: what failed, and what the forces contradict."""
    lines = [f"FAILED  {s.hypothesis}: {failure}" for s in summaries for failure in s.failures]
    lines += [f"NOT VERIFIED  {said}" for said in unverified(summaries)]
    wrong = [s for s in summaries if s.contradicted]
    lines += [
        f"CONTRADICTED  {s.hypothesis}: the forces lie outside what it can explain (predictive p = "
        f"{s.predictive_p:.2g}); its constants are of a model that does not hold"
        for s in wrong
    ]
    lines += [
        f"LOOK AT  {s.hypothesis}: {remark}"
        for s in summaries
        for remark in (
            *s.remarks, *(() if s.population is None else population_remarks(s.population))
        )
    ]  # fmt: skip
    if all(s.predictive_p is not None and s.predictive_p < HOPELESS for s in summaries):
        lines.append(NONE_EXPLAINS)
    if all(summary.passed and summary.verified for summary in summaries):
        lines.append("All diagnostics are within the limits of the study.")
    return lines


def format_table(summaries: Sequence[Summary]) -> str:
    """All tables for a terminal, and which diagnostics fail."""
    parts = []
    for summary in summaries:
        parts += [constants_table(summary, summary.truth).text(), ""]
        parts += [points_table(summary).text(), ""]
        further = further_table(summary)
        parts += [further.text(), ""] if further is not None else []
        for table in population_tables(summary.population, summary.hypothesis):
            parts += [table.text(), ""]
    parts += judgement_lines(summaries)
    first = summaries[0]
    parts.append(f"softcal {first.version}, seed {first.seed}; constants in {UNIT}")
    return "\n".join(parts)
