"""Five laws, stuck and sliding, held against Table 5.1: figures of a finished study as JSON.

    calib run benchmarks/thesis_laws.toml --out runs/thesis-laws
    calib evidence runs/thesis-laws
    python -m benchmarks.thesis_laws runs/thesis-laws --json docs/verification/thesis_laws.json

Units mm, N, MPa.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calib.data import PUBLISHED_CONSTANTS
from calib.study.artifacts import read_json, write_json


def main() -> None:
    """Write the figures and print them."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.thesis_laws", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of the finished study")
    parser.add_argument("--json", type=Path, required=True)
    arguments = parser.parse_args()
    laws = figures(arguments.run)
    for name, found in laws.items():
        print(name, found)
    write_json(arguments.json, {"about": about(), "laws": laws})


def figures(run: Path) -> dict[str, Any]:
    """By hypothesis: evidence, scores, fit and constants; the best evidence first."""
    compared = read_json(run / "comparison.json")["hypotheses"]
    scores = read_json(run / "evidence.json")
    return {name: _figures(compared[name], scores[name]) for name in scores}


def _figures(compared: dict[str, Any], scores: dict[str, Any]) -> dict[str, Any]:
    published = 2.0 * (PUBLISHED_CONSTANTS["C10"] + PUBLISHED_CONSTANTS["C01"])
    mu, sd = compared["mu_mean"], compared["mu_sd"]
    rule = compared["quadrature"]
    constants = zip(rule["x"][1:], rule["mean"][1:], rule["sd"][1:], strict=True)
    return {
        "ln_evidence": scores["log_evidence"],
        "ln_evidence_nested": scores["log_evidence_nested"],
        "probability": compared["probability"],
        "ln_likelihood_at_best": compared["max_log_likelihood"],
        "predictive_p": compared["predictive_p"],
        "elpd_difference": scores["elpd_difference"],
        "stacking_weight": scores["stacking_weight"],
        "mu_MPa": [mu, sd],
        "too_stiff": [published / mu, published / mu * sd / mu],
        "ratios": {name: [mean, spread] for name, mean, spread in constants},
        "zero_of_the_travel_mm": next(
            [found["mean"], found["sd"]]
            for found in compared["nuisances"]
            if found["name"] == "zero of the travel"
        ),
        "leans_on": [f"{at['parameter']} = {at['value']:g}" for at in compared["at_bound"]],
    }


def about() -> dict[str, Any]:
    """When and how the figures were made."""
    return {
        "commands": [line.strip() for line in (__doc__ or "").splitlines()[2:5]],
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "units": {"mu_MPa": "MPa", "zero_of_the_travel_mm": "mm", "too_stiff": "1"},
    }


if __name__ == "__main__":
    main()
