"""Tables of a study, made once from its artifacts and shown both on the terminal and in the report.

Numbers are text here, rounded for reading; programs read the JSON artifacts instead.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.data import PUBLISHED_CONSTANTS
from calib.data.thesis import optimization_runs, stated_average
from calib.inference.coordinates import CONSTANTS
from calib.study.block_cells import RingCells, written
from fe.response import Array

NOTE_WIDTH = 100


@dataclass(frozen=True)
class Table:
    """A titled table of text."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    """a sentence below the table"""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(
                    f"rows: expected {len(self.columns)} cells as in columns, found {row}"
                )

    def text(self) -> str:
        """The table for a terminal, columns aligned."""
        lines = [self.columns, *self.rows]
        widths = [max(len(line[i]) for line in lines) for i in range(len(self.columns))]
        aligned = [
            "  ".join(
                cell.ljust(width) if column == 0 else cell.rjust(width)
                for column, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in lines
        ]
        rule = "-" * max(len(line) for line in aligned)
        parts = [self.title, rule, aligned[0], rule, *aligned[1:], rule]
        return "\n".join([*parts, *textwrap.wrap(self.note, NOTE_WIDTH)])


def number(value: float | None, digits: int = 4) -> str:
    """A number with the given significant digits; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    return f"{value:#.{digits}g}".rstrip(".").replace(".e", "e") if value else "0"


def percent(value: float | None, digits: int = 2) -> str:
    """A ratio as a percentage with a sign, without unit."""
    return "-" if value is None or not math.isfinite(value) else f"{100 * value:+.{digits}f}"


def data_table(data: Mapping[str, Any]) -> Table:
    """What the posterior is conditioned on; `data` is data.json."""
    n = data["n_samples"]
    rows = tuple(
        (number(d), number(m), number(s), number(s / n**0.5))
        for d, m, s in zip(data["travel"], data["force_mean"], data["force_sd"], strict=True)
    )
    kind = "SYNTHETIC forces" if data["synthetic"] else "measured forces"
    field = f", and a front-face field of {data['n_point']} points" if "n_point" in data else ""
    left_out = data.get("left_out", ())
    return Table(
        f"Data: {kind}, {data['name']} ({n} samples{field})",
        ("travel [mm]", "mean force [N]", "SD between samples [N]", "standard error [N]"),
        rows,
        f"Left out by quality control: {'; '.join(left_out)}." if left_out else "",
    )


def mesh_table(errors: Mapping[str, Any]) -> Table:
    """Discretisation error; `errors` maps a hypothesis to its mesh_error.json."""
    first = next(iter(errors.values()))
    rows = []
    for name, error in errors.items():
        measured = zip(error["ratios"], error["signed_force"], error["field_rms"], strict=True)
        of_pin = _of_pin(error.get("pin"), len(error["ratios"]))
        for (ratios, signed, field), pin_rows in zip(measured, of_pin, strict=True):
            named = zip(error.get("names", ("r", "s")), ratios, strict=True)
            at = ", ".join(f"{column} = {value:.3g}" for column, value in named)
            rows.append((f"{name}, force [%]", at, *(percent(value) for value in signed)))
            rows.append((f"{name}, field RMS [mm]", at, *(number(value, 2) for value in field)))
            rows += ((f"{name}, {what}", at, *values) for what, values in pin_rows)
        left = (f"{100 * value:.2f}" for value in error["force"])
        rows.append((f"{name}, SD of force left [%]", "", *left))
        floors = (number(max(value), 2) for value in error["field_floor"])
        rows.append((f"{name}, SD of field left [mm]", "", *floors))
    meshes = (
        f"{name}: {_mesh(error['coarse_cells'])} against {_mesh(error['fine_cells'])}"
        for name, error in errors.items()
    )
    shares = (
        f"{error['left_share']:.2f} of forces, "
        f"{error.get('field_left_share', error['left_share']):.2f} of fields ({name})"
        for name, error in errors.items()
    )
    pin, pin_note = _pin_words(first.get("pin"))
    return Table(
        f"Discretisation error of the emulator's runs: {', '.join(meshes)}{pin}",
        ("hypothesis", "measured at", *(f"{travel:g} mm" for travel in first["travel"])),
        tuple(rows),
        f"{_corrected(errors)} SD left: of the error "
        f"that the likelihood still allows for, {'; '.join(shares)} times the meshes' part (half "
        "the grid convergence index of two meshes, of order 1 for fields where anything sticks "
        "or rubs and else 2; of the force never less than that of the RMS "
        "over the increments) and its spread over the points; of the field, the worst component, "
        "as a root mean square over the face, and a field has the same share again of the changes "
        "of each constant and of nuisances of the test that the difference would be mistaken for."
        f"{pin_note} It is an estimate, not a bound."
        + "".join(
            f" {name}: one of the points could not be solved on both meshes and under both pins, "
            "so the spread is not known."
            for name, error in errors.items()
            if len(error["ratios"]) < 2
        ),
    )


def _of_pin(pin: Mapping[str, Any] | None, n: int) -> list[list[tuple[str, list[str]]]]:
    """What of the difference of two meshes is that of their pins, at each of n points."""
    if pin is None:
        return [[] for _ in range(n)]
    return [
        [
            ("force, the pin's part [%]", [percent(value) for value in signed]),
            ("field RMS, the pin's part [mm]", [number(value, 2) for value in field]),
        ]
        for signed, field in zip(pin["signed_force"], pin["field_rms"], strict=True)
    ]


def _pin_words(pin: Mapping[str, Any] | None) -> tuple[str, str]:
    """Of the title and of the note of the table of meshes, where their pins differ."""
    if pin is None:
        return "", ""
    return (
        f", under a pin that gives way {pin['stiffening']:g} times less",
        " What is the pin's part is known by the coarse mesh under the other pin; predictions go "
        f"on by {pin['beyond']:.2f} times that part, to a rigid pin, and {pin['left_share']:.2f} "
        f"times it is left of forces, {pin['beyond']:.2f} of fields.",
    )


def published_table(comparison: Mapping[str, Any]) -> Table | None:
    """Forces that the published constants predict; None when there are no published constants."""
    rows = []
    notes = []
    for name, found in comparison["hypotheses"].items():
        published = found["published"]
        if published is None:
            continue
        rows.append((f"{name}, force [N]", *(number(force) for force in published["force"])))
        ratios = zip(published["force"], comparison["force_mean"], strict=True)
        rows.append((f"{name}, times the data", *(f"{force / mean:.1f}" for force, mean in ratios)))
        notes.append(
            f"{name}: the published constants lie {published['mahalanobis']:.1f} posterior SDs "
            "from the posterior mean (Mahalanobis distance in ln kappa, r, s)"
            + (", outside the box of the prior's ratios." if published["extrapolated"] else ".")
            + (
                " That posterior leans on a bound of its prior; its SDs say little about distance."
                if found["at_bound"]
                else ""
            )
        )
    if not rows:
        return None
    rows.append(("data [N]", *(number(mean) for mean in comparison["force_mean"])))
    return Table(
        "Forces that the published constants predict (thesis Table 5.4; MPa implied there)",
        ("hypothesis", *(f"{travel:g} mm" for travel in comparison["travel"])),
        tuple(rows),
        " ".join(notes),
    )


def optimization_table(published: Mapping[str, float] | None) -> Table | None:
    """Thesis Table 5.3's range beside Table 5.4; None where these are not what was published."""
    if published is None or any(
        published[name] != PUBLISHED_CONSTANTS[name] for name in CONSTANTS[:3]
    ):
        return None
    runs, average = optimization_runs(), stated_average()
    columns = np.column_stack([runs.result, 2.0 * runs.result[:, :2].sum(axis=1)])
    means = {**average, "mu": 2.0 * (average["C10"] + average["C01"])}
    rows = tuple(
        (
            name,
            number(published[name]),
            number(float(values.min())),
            number(float(values.max())),
            number(means[name]),
        )
        for name, values in zip(CONSTANTS, columns.T, strict=True)
    )
    return Table(
        "Published constants beside the results they were chosen from (thesis Tables 5.3, 5.4)",
        ("constant", "published [MPa]", "lowest [MPa]", "highest [MPa]", "stated average [MPa]"),
        rows,
        f"lowest, highest: over the {len(runs.rmse)} starts of Table 5.3, which the same data "
        "gave; stated average: of the starts with RMSE 0.1559 mm, which the thesis says Table 5.4 "
        "is and it is not.",
    )


def comparison_table(comparison: Mapping[str, Any]) -> Table:
    """Evidence and predictive check of each hypothesis; `comparison` is comparison.json."""
    errors = share_errors(list(comparison["hypotheses"].values()))
    rows = tuple(
        (
            name,
            f"{found['log_evidence']:.2f} ± {found['log_evidence_error']:.2f}",
            f"{found['probability']:.3g} ± {error:.1g}",
            f"{found['max_log_likelihood']:.2f}",
            f"{found['best_force_misfit']:.2f}",
            f"{found['predictive_p']:.3g}",
            f"{number(found['mu_mean'])} ± {number(found['mu_sd'], 2)}",
        )
        for (name, found), error in zip(comparison["hypotheses"].items(), errors, strict=True)
    )
    return Table(
        "Comparison of the hypotheses",
        (
            "hypothesis",
            "ln evidence [-]",
            "share of evidence [-]",
            "max ln L [-]",
            "chi2 there [-]",
            "predictive p [-]",
            "mu [MPa]",
        ),
        rows,
        "± of evidences: numerical, for the emulators and meshes at hand; share of evidence: "
        "probability at equal prior odds; max ln L: largest ln likelihood in "
        "the prior's box, and the forces' chi-square there. " + " ".join(comparison["verdict"]),
    )


def share_errors(found: Sequence[Mapping[str, Any]]) -> Array:
    """(n,) numerical errors of shares of the evidence, of first order in those of all evidences.

    With shares p and independent errors e of ln Z: dp_i = p_i (e_i - sum_j p_j e_j).
    """
    p = np.array([each["probability"] for each in found], dtype=float)
    e = np.array([each["log_evidence_error"] for each in found], dtype=float)
    slopes = p[:, None] * (np.eye(len(p)) - p)
    errors: Array = np.sqrt(slopes**2 @ e**2)
    return errors


def texts(tables: Sequence[Table | None]) -> list[str]:
    """The tables that there are, for a terminal."""
    return [table.text() for table in tables if table is not None]


def _corrected(errors: Mapping[str, Any]) -> str:
    """How predictions were corrected, of what `mesh_table` takes."""
    with_slopes = [name for name, error in errors.items() if error.get("with_derivatives")]
    if not with_slopes:
        return "Predictions are corrected by the mean difference."
    at_last = (
        "Predictions are corrected by the difference at the last point, that of the field "
        "carried on by the derivatives of its runs"
    )
    without = [name for name in errors if name not in with_slopes]
    if not without:
        return f"{at_last}."
    return (
        f"{at_last} ({', '.join(with_slopes)}), or by the mean difference ({', '.join(without)})."
    )


def _mesh(cells: Sequence[int] | Mapping[str, int]) -> str:
    """A mesh of mesh_error.json."""
    if isinstance(cells, Mapping):
        return written(RingCells(**cells))
    nx, ny, nz = cells
    return written((nx, ny, nz))
