"""`calib identify`: what a study's data say of which parameter, as tables, JSON and a figure."""

from __future__ import annotations

import itertools
import sys
from pathlib import Path
from typing import Any

import numpy as np

from calib.inference.knowledge import Constants, Knowledge, knowledge, n_pieces
from calib.inference.profile import LEVEL
from calib.study.answers import keep_answer
from calib.study.artifacts import write_json
from calib.study.context import stream
from calib.study.figure_style import save_png
from calib.study.finished import finished, posteriors
from calib.study.identify_figure import identify_figure
from calib.study.local_design import kept_box
from calib.study.posterior_setup import emulator_posterior
from calib.study.tables import Table, number
from fe.progress_bar import progress_bar

FILE = "identify.json"
FIGURE = "identify.png"
ROUNDING = 1e-12
"""of the largest eigenvalue, below which one is zero"""


def identify(out: Path) -> tuple[list[str], list[Path]]:
    """Answer for every hypothesis of a finished study; returns the lines to print and the files.

    Raises ValueError where the folder holds no finished study.
    """
    context = finished(out)
    by_name = posteriors(context)
    total = sum(n_pieces(posterior) for posterior in by_name.values())
    done = itertools.count(1)
    with progress_bar("identify", "part", shown=sys.stderr.isatty()) as report:
        report(0, total)
        found = {
            h.name: knowledge(
                by_name[h.name],
                stream(context.study, f"identify {h.name}"),
                sampled=None if kept_box(out, h) is None else emulator_posterior(context, h),
                told=lambda: report(next(done), total),
            )
            for h in context.study.hypotheses
        }
    write_json(out / FILE, {name: facts(known) for name, known in found.items()})
    save_png(identify_figure(found), out / "figures" / FIGURE)
    told = [table for name, known in found.items() for table in tables(name, known)]
    remarks = [f"{name}: {each}" for name, known in found.items() for each in known.warnings]
    keep_answer(context, "identify", told, out / "figures" / FIGURE, remarks)
    lines = []
    for name, known in found.items():
        for table in tables(name, known):
            lines += [table.text(), ""]
        lines += [f"{name}: {sentence}" for sentence in known.warnings]
        lines.append("")
    return lines, [out / FILE, out / "figures" / FIGURE]


def facts(known: Knowledge) -> dict[str, Any]:
    """The answer as JSON data."""
    return {
        "coordinates": known.names,
        "units": {
            **dict(zip(known.names, known.units, strict=True)),
            **dict(zip(known.constant_names, known.constant_units, strict=True)),
        },
        "prior_sd": known.prior_sd,
        "constants": known.constant_names,
        "prior_constants": _moments(known.prior_constants),
        "parts": {
            entry.part: {
                "mean": entry.moments.mean,
                "sd": entry.moments.sd,
                "sd_over_prior": entry.contraction,
                "constants": _moments(entry.constants),
                "fisher_eigenvalues_in_prior_units": entry.spectrum.information,
                "fisher_directions_in_prior_units": entry.spectrum.directions,
            }
            for entry in known.parts
        },
        "profiles": {
            name: {
                "value": profile.values,
                "log_likelihood": profile.log_likelihood,
                "interval": profile.interval,
                "intervals": profile.intervals,
                "open_ends": profile.open_ends,
            }
            for name, profile in zip(known.names, known.profiles, strict=True)
        },
        "warnings": known.warnings,
    }


def _moments(constants: Constants) -> dict[str, Any]:
    return {"mean": constants.mean, "sd": constants.sd}


def tables(name: str, known: Knowledge) -> tuple[Table, Table, Table]:
    """Contraction of coordinates and of constants; combinations by Fisher information."""
    return _contraction_table(name, known), _constants_table(name, known), _spectrum(name, known)


def _constants_table(name: str, known: Knowledge) -> Table:
    """Prior and posterior of each constant."""
    prior = known.prior_constants
    rows = []
    for index, label in enumerate(known.constant_names):
        parts = [
            f"{number(entry.constants.mean[index])} ± {number(entry.constants.sd[index], 2)} "
            f"({100 * entry.constants.sd[index] / prior.sd[index]:.0f})"
            for entry in known.parts
        ]
        rows.append(
            (
                label,
                _unit(known.constant_units[index]),
                f"{number(prior.mean[index])} ± {number(prior.sd[index], 2)}",
                *parts,
            )
        )
    low, high = (2.0 * np.exp(end) for end in known.profiles[0].interval)
    return Table(
        f"The same of the constants, under {name}",
        ("constant", "unit", "prior", *(f"{e.part} (SD left [%])" for e in known.parts)),
        tuple(rows),
        f"Mean ± SD. {LEVEL:.0%} profile of mu given all data: {number(low)} to {number(high)} "
        "MPa.",
    )


def _unit(unit: str) -> str:
    """As tables have it."""
    return "-" if unit == "1" else unit


def _contraction_table(name: str, known: Knowledge) -> Table:
    """Contraction and profile of each coordinate."""
    names = known.names
    rows = []
    for index, label in enumerate(names):
        low, high = known.profiles[index].interval
        ends = known.profiles[index].open_ends
        rows.append(
            (
                label,
                _unit(known.units[index]),
                number(known.prior_sd[index], 3),
                *(f"{100 * entry.contraction[index]:.0f}" for entry in known.parts),
                f"{number(low, 3)}{' (bound)' if ends[0] else ''}",
                f"{number(high, 3)}{' (bound)' if ends[1] else ''}",
            )
        )
    return Table(
        f"What the data leave of the prior, under {name}",
        (
            "coordinate",
            "unit",
            "prior SD",
            *(f"{entry.part}: SD left [%]" for entry in known.parts),
            f"{LEVEL:.0%} profile low",
            "high",
        ),
        tuple(rows),
        "SD left: posterior SD over prior SD, 100 is the prior. Profile: values that a "
        "likelihood-ratio test does not refuse, whatever the prior's density; (bound) where that "
        "goes on to the prior's bound. ln kappa is that of C10 + C01 in MPa, or of mu / 2.",
    )


def _spectrum(name: str, known: Knowledge) -> Table:
    """Combinations of coordinates by Fisher information."""
    combined = []
    for entry in known.parts:
        least = ROUNDING * float(entry.spectrum.information.max())
        for value, ratio, direction in zip(
            entry.spectrum.information,
            entry.spectrum.sd_ratio,
            entry.spectrum.directions,
            strict=True,
        ):
            combined.append(
                (
                    entry.part,
                    number(float(value) if value > least else 0.0, 3),
                    f"{100 * ratio:.1f}",
                    _words(known.names, direction) if value > least else "of the rest nothing",
                )
            )
    return Table(
        f"Combinations by Fisher information, under {name}",
        ("data", "eigenvalue [-]", "SD left [%]", "combination of coordinates / prior SD"),
        tuple(combined),
        "At the posterior's mean, in units of the prior's SDs: above 1 the data say more than the "
        "prior. SD left counts the prior as normal.",
    )


def _words(names: tuple[str, ...], direction: np.ndarray[Any, Any]) -> str:
    """A combination, parts below 0.1 left out."""
    parts = [
        f"{value:+.2f} {name}"
        for name, value in zip(names, direction, strict=True)
        if abs(value) >= 0.1
    ]
    return " ".join(parts)
