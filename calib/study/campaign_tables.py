"""Tables and figure of campaigns, from their manifests."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.study.figure_style import COLOURS, MUTED, tidy
from calib.study.tables import Table, number
from fe.campaign_parameters import Parameter, from_json


def campaign_table(manifests: Mapping[str, Any]) -> Table:
    """Runs of each hypothesis, how many failed and what they cost; `manifests` by its name."""
    rows = []
    for name, manifest in manifests.items():
        runs = manifest["runs"]
        done = [run for run in runs if run["file"] is not None]
        failed = [run for run in done if _failed(run)]
        shortest = min((run["reached_mm"] for run in done), default=None)
        seconds = [run["seconds"] for run in done]
        rows.append(
            (
                name,
                str(len(runs)),
                str(len(done)),
                str(len(failed)),
                number(shortest, 3),
                number(float(np.mean(seconds)) if seconds else None, 2),
                str(len(manifest["unused"])),
            )
        )
    return Table(
        "Campaign: FE runs of each hypothesis",
        (
            "hypothesis",
            "design",
            "done",
            "failed",
            "shortest travel [mm]",
            "mean time [s]",
            "other files",
        ),
        tuple(rows),
        "Failed: ended before the last increment; good up to the travel reached. Other files: runs "
        "of another design, model or version in the folder, named in its manifest and not used.",
    )


def failures_table(name: str, manifest: Mapping[str, Any]) -> Table | None:
    """Runs that ended before their last travel, with parameters and travel reached."""
    parameters = from_json(manifest["parameters"])
    rows = [
        (
            str(run["index"]),
            *(p.text(value) for p, value in zip(parameters, run["theta"], strict=True)),
            f"{run['reached_mm']:.4g}",
            run["message"].partition(";")[0],  # how it ended; what it warns of is in the manifest
        )
        for run in manifest["runs"]
        if _failed(run)
    ]
    if not rows:
        return None
    return Table(
        f"{name}: {len(rows)} of {len(manifest['runs'])} runs did not reach the last increment",
        ("run", *(label_of(p) for p in parameters), "reached [mm]", "why"),
        tuple(rows),
    )


def design_figure(manifests: Mapping[str, Any]) -> Figure:
    """The first two parameters of each design, by how far the runs went."""
    figure = Figure(figsize=(4.2 * len(manifests), 3.8), layout="constrained")
    axes = figure.subplots(1, len(manifests), squeeze=False)[0]
    for axis, (name, manifest) in zip(axes, manifests.items(), strict=True):
        _draw_design(axis, manifest)
        axis.set_title(name, fontsize=10)
        tidy(axis)
    # Below the axes: the corners of a design are runs too. All axes together have every label once.
    marks = {label: mark for axis in axes for mark, label in zip(*_legend(axis), strict=True)}
    figure.legend(marks.values(), marks.keys(), loc="outside lower center", ncols=3, fontsize=8)
    return figure


def _legend(axis: Axes) -> tuple[list[Any], list[str]]:
    marks, labels = axis.get_legend_handles_labels()
    return list(marks), [str(label) for label in labels]


def _draw_design(axis: Axes, manifest: Mapping[str, Any]) -> None:
    parameters = from_json(manifest["parameters"])
    theta = np.array([run["theta"] for run in manifest["runs"]])
    if theta.shape[1] == 1:
        theta = np.column_stack([theta, np.zeros(len(theta))])
    groups = (
        (
            "reached the last increment",
            "o",
            COLOURS[0],
            lambda run: run["file"] and not _failed(run),
        ),
        ("ended before, at the travel written", "X", COLOURS[1], _failed),
        ("not run", ".", MUTED, lambda run: run["file"] is None),
    )
    for label, marker, colour, belongs in groups:
        rows = [bool(belongs(run)) for run in manifest["runs"]]
        if any(rows):
            axis.plot(*theta[rows, :2].T, ls="", marker=marker, color=colour, ms=5, label=label)
    for run in manifest["runs"]:
        if _failed(run):
            x, y = theta[run["index"], :2].tolist()
            reached = f"{run['reached_mm']:.3g} mm"
            axis.annotate(
                reached,
                (x, y),
                xytext=(0, -6),
                textcoords="offset points",
                ha="center",
                va="top",
                fontsize=7,
                color=COLOURS[1],
            )
    # What is written at a run in a corner stays off the axes.
    axis.margins(0.1)
    axis.set_xlabel(label_of(parameters[0]))
    axis.set_ylabel(label_of(parameters[1]) if len(parameters) > 1 else "")
    if len(parameters) == 1:
        axis.set_yticks([])


def label_of(parameter: Parameter) -> str:
    """Name and unit of a column of a design."""
    unit = "-" if parameter.unit == "1" else parameter.unit
    return f"{parameter.name} [{unit}]"


def _failed(run: Mapping[str, Any]) -> bool:
    return run["file"] is not None and not run["reached"]
