"""The table of a posterior for programs; the only module with pandas."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import pandas as pd

from calib.study.artifacts import plain
from calib.study.population_summary import PopulationSummary
from calib.study.summary import Summary

Row = tuple[str, str, dict[str, Any]]
"""of what, name of the quantity, its columns"""


def to_json(summaries: Sequence[Summary]) -> str:
    """A list with one object for each hypothesis; what was not found is null."""
    found = [
        {**plain(summary), "passed": summary.passed, "failures": list(summary.failures)}
        for summary in summaries
    ]
    return json.dumps(found, indent=2, allow_nan=False)


AVERAGED, POPULATION, NEW, ALONE = "averaged sample", "population", "new sample", "by itself"


def to_frame(summaries: Sequence[Summary]) -> pd.DataFrame:
    """One row for each hypothesis, constant and what it is of; see the column "of".

    Where samples were taken one by one: the population with its SDs between samples, a new sample,
    each sample by name, and each by its own data.
    """
    rows = [
        {
            "study": summary.study,
            "seed": summary.seed,
            "version": summary.version,
            "hypothesis": summary.hypothesis,
            "interval": summary.interval,
            "synthetic": summary.synthetic,
            "of": of,
            "constant": name,
            **values,
            "passed": summary.passed,
            "predictive_p": summary.predictive_p,
        }
        for summary in summaries
        for of, name, values in (*_averaged(summary), *_of_population(summary.population))
    ]
    return pd.DataFrame(rows)


def _averaged(summary: Summary) -> list[Row]:
    """What is known of the averaged sample."""
    truth = summary.truth or {}
    return [
        (AVERAGED, name, {**asdict(constant), "truth": truth.get(name)})
        for name, constant in (summary.constants | summary.further).items()
    ]


def _of_population(found: PopulationSummary | None) -> list[Row]:
    """What is known of the population and of single samples; nothing where there are none."""
    if found is None:
        return []
    rows: list[Row] = [
        (POPULATION, name, asdict(spread) | asdict(found.convergence[name]))
        for name, spread in found.population.items()
    ]
    rows += [(NEW, name, asdict(spread)) for name, spread in found.new.items()]
    for index, sample in enumerate(found.sample_names):
        rows += [(sample, name, asdict(each[index])) for name, each in found.samples.items()]
        rows.append((sample, "fit_p", {"unit": "1", "mean": found.fit_p[index]}))
        of = f"{sample} {ALONE}"
        rows += [(of, name, asdict(each[index])) for name, each in found.alone.items()]
    return rows


def to_csv(summaries: Sequence[Summary]) -> str:
    """One line for each row of `to_frame`, with a header."""
    return str(to_frame(summaries).to_csv(index=False, lineterminator="\n"))
