"""Tables of the posterior predictive checks; `found` is predictive.json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calib.study.tables import Table, number, percent

CHECKS = "predictive.json"
COMPONENTS = ("x", "y", "z")


def force_checks_table(found: Mapping[str, Any]) -> Table:
    """One row an increment, p-value and deviation of every hypothesis."""
    names = list(found["hypotheses"])
    columns = ["travel [mm]"]
    for name in names:
        columns += [f"{name}: p", "off [%]", "within 94 %"]
        if found["hypotheses"][name].get("force_left_out_p"):
            columns.append("p left out")
    rows = []
    for i, travel in enumerate(found["travel"]):
        row = [number(travel)]
        for name in names:
            check = found["hypotheses"][name]["force"][i]
            inside = "yes" if check["coverage"]["0.94"] else "NO"
            row += [number(check["p_value"], 2), percent(check["relative"]), inside]
            if left_out := found["hypotheses"][name].get("force_left_out_p"):
                row.append("-" if left_out[i] is None else number(left_out[i], 2))
        rows.append(tuple(row))
    return Table(
        "Predictive check of each force",
        tuple(columns),
        tuple(rows),
        "off: the median prediction, from the measured mean. "
        "p: two-sided, of the measured mean among its replicates. The posterior was fitted to the "
        "same forces, so p-values crowd towards 1 where all is well; small ones are news."
        + (
            " p left out: the same given the other forces alone, to which it was not fitted."
            if "p left out" in columns
            else ""
        ),
    )


def field_checks_tables(found: Mapping[str, Any]) -> list[Table]:
    """One table a hypothesis: region and increment against p-values, coverage and error."""
    tables = []
    for name, checks in found["hypotheses"].items():
        if "field" not in checks:
            continue
        rows = [
            _row(region, travel, checks["field"][region][i])
            for region in checks["field"]
            for i, travel in enumerate(found["travel"])
        ]
        columns = ["region", "travel [mm]"]
        columns += [f"p {c}" for c in COMPONENTS]
        columns += [f"in 94 % {c}" for c in COMPONENTS]
        columns += [f"RMSE {c} [mm]" for c in COMPONENTS]
        tables.append(
            Table(
                f"Predictive check of the field under {name}",
                tuple(columns),
                tuple(rows),
                "p: share of replicates further from the model (RMS over the region) than the "
                "measurement; below 0.05 errors are not explained, above 0.95 stated too large. "
                "in 94 %: share of the points within their 94 % interval.",
            )
        )
    return tables


def face_summary_table(found: Mapping[str, Any]) -> Table | None:
    """As thesis Table 5.5; None without a field."""
    rows = []
    for name, checks in found["hypotheses"].items():
        for part in checks.get("summary", ()):
            share = 100 * part["rmse"] / part["largest"]
            rows.append(
                (
                    name,
                    part["component"],
                    number(part["mean_correlation"]),
                    number(part["rmse"], 3),
                    number(share, 3),
                )
            )
    if not rows:
        return None
    return Table(
        "Correlation and error over the front face (thesis, Table 5.5)",
        ("hypothesis", "component", "mean R [-]", "RMSE [mm]", "of largest [%]"),
        tuple(rows),
        "R over the increments at each point, averaged over the points; the thesis calls it R^2. "
        "RMSE of the posterior mean, all points and increments, and as a share of the largest "
        "measured displacement of that component.",
    )


def _row(region: str, travel: float, checks: list[dict[str, Any]]) -> tuple[str, ...]:
    return (
        region,
        number(travel),
        *(number(c["p_value"], 2) for c in checks),
        *(number(c["coverage"]["0.94"], 2) for c in checks),
        *(number(c["rmse"], 2) for c in checks),
    )
