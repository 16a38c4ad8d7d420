"""What is said and drawn of emulators: at the end of training, in the report, and on refusal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calib.study.config import Study
from calib.study.context import Context
from calib.study.emulator_figures import worst_errors
from calib.study.emulator_tables import emulator_tables
from calib.study.figure_style import save_png
from calib.study.force_figures import EmulatorErrors, emulator_errors
from calib.study.local_design import LOCAL
from calib.study.tables import texts
from calib.study.train_stage import (
    DIAGNOSTICS,
    FIRST,
    IN_ITS_BOX,
    emulator_path,
    load_diagnostics,
    load_local_diagnostics,
    load_maps,
)
from fe.response import Array

WORST = "emulator_worst.png"


class EmulatorRefused(RuntimeError):  # noqa: N818 - says what happened
    """An emulator errs more than the study allows or than it states itself."""


def closing_lines(out: Path, study: Study) -> tuple[list[str], tuple[str, ...]]:
    """What `calib train` prints at its end: tables, files, figures; and the limits violated.

    Raises ValueError naming a damaged file.
    """
    folder = out / FIRST
    diagnostics = load_diagnostics(folder)
    figure = folder / "emulator.png"
    save_png(emulator_figure(diagnostics, study), figure)
    save_png(worst_figure(folder, diagnostics, study), folder / WORST)
    places = [
        *(("emulator", emulator_path(folder, h)) for h in study.hypotheses),
        ("errors", folder / DIAGNOSTICS),
        ("figure", figure),
        ("figure", folder / WORST),
    ]
    tables = [f"{text}\n" for text in texts(emulator_tables(diagnostics, limits_of(study)))]
    lines = ["", *tables, *(f"{name:<9} {path}" for name, path in places)]
    return lines, failures_of(diagnostics)


def refuse_bad_emulators(context: Context) -> None:
    """Stop before anything is inferred from an emulator that violates a limit of the study.

    Raises EmulatorRefused with the first violation, what to do, and the figure that shows where.
    """
    judged, local = load_diagnostics(context.out), load_local_diagnostics(context.out)
    failures = failures_of({**judged, **local})
    if not failures:
        return
    folder, keys = context.out, "design.n_runs"
    if not failures_of(judged):
        folder, judged, keys = folder / LOCAL, local, "design.n_local"
    elif failures_of(local):
        keys += " and design.n_local"
    figure = folder / WORST
    save_png(worst_figure(folder, judged, context.study), figure)
    more = f" (and {len(failures) - 1} more)" if len(failures) > 1 else ""
    raise EmulatorRefused(
        f"{failures[0]}{more}: nothing is inferred from such an emulator; {figure} shows where it "
        f"errs; raise {keys}, narrow the priors of its unknowns, or accept errors of force and "
        "field by the limits in [emulator]"
    )


def failures_of(diagnostics: Mapping[str, Any]) -> tuple[str, ...]:
    """Limits of the study that emulators violate, one sentence each."""
    return tuple(
        f"{name}: {failure}" for name, found in diagnostics.items() for failure in found["failures"]
    )


def limits_of(study: Study) -> dict[str, float]:
    """Largest errors that the study accepts, by name."""
    return {
        "max_force_error": study.emulator.max_force_error,
        "max_field_error": study.emulator.max_field_error,
    }


def emulator_figure(diagnostics: Mapping[str, Any], study: Study) -> Figure:
    """Errors of every emulator's force on the runs held out; `diagnostics` by hypothesis."""
    n_step = len(study.increments)

    def held_out(found: Mapping[str, Any], what: str) -> Array:
        runs = found["runs"].get("held_out")
        return np.asarray(runs[what] if runs else [], dtype=float).reshape(-1, n_step)

    errors = [
        EmulatorErrors(
            name,
            held_out(found, "relative_force_error"),
            held_out(found, "standardised_error"),
            study.emulator.max_force_error,
        )
        for name, found in diagnostics.items()
    ]
    return emulator_errors(errors, np.asarray(study.increments))


def worst_figure(folder: Path, diagnostics: Mapping[str, Any], study: Study) -> Figure:
    """Where the emulators kept in `folder` err most, in the design and on the front face.

    `diagnostics` by hypothesis, whose names may end in `IN_ITS_BOX`.
    """
    hypotheses = {h.name: h for h in study.hypotheses}
    maps = {n: load_maps(folder, hypotheses[n.removesuffix(IN_ITS_BOX)]) for n in diagnostics}
    return worst_errors(diagnostics, maps, study.increments)
