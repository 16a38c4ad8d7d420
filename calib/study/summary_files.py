"""The table of a posterior for programs; the only module with pandas."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict

import pandas as pd

from calib.study.artifacts import plain
from calib.study.summary import Summary


def to_json(summaries: Sequence[Summary]) -> str:
    """A list with one object for each hypothesis; what was not found is null."""
    found = [
        {**plain(summary), "passed": summary.passed, "failures": list(summary.failures)}
        for summary in summaries
    ]
    return json.dumps(found, indent=2, allow_nan=False)


def to_frame(summaries: Sequence[Summary]) -> pd.DataFrame:
    """One row for each hypothesis and constant."""
    rows = [
        {
            "study": summary.study,
            "seed": summary.seed,
            "version": summary.version,
            "hypothesis": summary.hypothesis,
            "interval": summary.interval,
            "synthetic": summary.synthetic,
            "constant": name,
            **asdict(constant),
            "truth": None if summary.truth is None else summary.truth.get(name),
            "passed": summary.passed,
        }
        for summary in summaries
        for name, constant in (summary.constants | summary.further).items()
    ]
    return pd.DataFrame(rows)


def to_csv(summaries: Sequence[Summary]) -> str:
    """One line for each hypothesis and constant, with a header."""
    return str(to_frame(summaries).to_csv(index=False, lineterminator="\n"))
