"""What training says at its end, and the figure of the emulators' errors on runs held out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calib.study.config import Study
from calib.study.figure_style import save_png
from calib.study.force_figures import EmulatorErrors, emulator_errors
from calib.study.tables import emulator_table
from calib.study.train_stage import DIAGNOSTICS, FIRST, emulator_path, load_diagnostics


def closing_lines(out: Path, study: Study) -> tuple[list[str], tuple[str, ...]]:
    """What `calib train` prints at its end: table, files, figure; and the limits violated.

    Raises ValueError naming a damaged file.
    """
    folder = out / FIRST
    diagnostics = load_diagnostics(folder)
    figure = folder / "emulator.png"
    save_png(emulator_figure(diagnostics, study), figure)
    failures = tuple(
        f"{name}: {failure}" for name, found in diagnostics.items() for failure in found["failures"]
    )
    places = [
        *(("emulator", emulator_path(folder, h)) for h in study.hypotheses),
        ("errors", folder / DIAGNOSTICS),
        ("figure", figure),
    ]
    table = emulator_table(diagnostics, limits_of(study)).text()
    return ["", table, "", *(f"{name:<9} {path}" for name, path in places)], failures


def limits_of(study: Study) -> dict[str, float]:
    """Largest errors that the study accepts, by name."""
    return {
        "max_force_error": study.emulator.max_force_error,
        "max_field_error": study.emulator.max_field_error,
    }


def emulator_figure(diagnostics: Mapping[str, Any], study: Study) -> Figure:
    """Errors of every emulator's force on the runs held out; `diagnostics` by hypothesis."""
    n_step = len(study.increments)
    errors = [
        EmulatorErrors(
            name,
            np.asarray(found["held_out_relative_error"], dtype=float).reshape(-1, n_step),
            np.asarray(found["held_out_standardised_error"], dtype=float).reshape(-1, n_step),
            study.emulator.max_force_error,
        )
        for name, found in diagnostics.items()
    ]
    return emulator_errors(errors, np.asarray(study.increments))
