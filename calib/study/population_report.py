"""What the report shows of a population and its samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from calib.study.data_stage import load_data
from calib.study.population_figures import new_sample_forces, shrinkage
from calib.study.population_tables import population_tables
from calib.study.report import Picture, Section
from calib.study.summary import Summary
from calib.study.tables import Table

SHRINKAGE, FORCES = "population_", "population_forces_"
TEXT = (
    "All samples one by one: each has constants of its own, which scatter about the population's. "
    "What all share (unknowns of the test, errors of mesh and emulator) does not average away over "
    "the samples. The other parts of this report are about the averaged sample."
)


def every_population_table(summaries: Sequence[Summary]) -> list[Table]:
    """Tables of all hypotheses."""
    return [t for s in summaries for t in population_tables(s.population, s.hypothesis)]


def population_sections(
    summaries: Sequence[Summary], pictures: Mapping[str, Picture]
) -> list[Section]:
    """One section, or none where samples were not taken one by one."""
    names = [summary.hypothesis for summary in summaries if summary.population is not None]
    if not names:
        return []
    shown = [pictures[kind + name] for name in names for kind in (SHRINKAGE, FORCES)]
    return [Section("Population and samples", (TEXT,), every_population_table(summaries), shown)]


def population_figures(summaries: Sequence[Summary], out: Path) -> dict[str, tuple[Figure, str]]:
    """Figure and caption by name, of every hypothesis with a population."""
    drawn: dict[str, tuple[Figure, str]] = {}
    for summary in summaries:
        name, found = summary.hypothesis, summary.population
        samples = load_data(out).dataset.samples
        if found is None or samples is None:
            continue
        drawn[SHRINKAGE + name] = (
            shrinkage(found),
            f"Samples under {name}: each by its own data and within the population, which draws "
            "those that are little known towards its middle; the band holds a new sample.",
        )
        drawn[FORCES + name] = (
            new_sample_forces(found, samples.force),
            f"Forces of the samples and of a new one under {name}, with all errors, over the "
            "predictive mean.",
        )
    return drawn
