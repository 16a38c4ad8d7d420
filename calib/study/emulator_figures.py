"""Figures of emulators: errors on the front face and over the design, and the loop of refinement.

`diagnostics` and `refinement` as in `emulator_tables`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.study.emulator_tables import KINDS
from calib.study.figure_style import COLOURS, INK, MARKERS, MUTED, Array, tidy

N_MARKED = 10
"""worst points that are marked on the front face"""


def worst_errors(
    diagnostics: Mapping[str, Any], maps: Mapping[str, Mapping[str, Array]], travel: Sequence[float]
) -> Figure:
    """Where emulators err most: runs in the plane of the ratios, points on the front face.

    `maps` as `train_stage.load_maps` gives them, by hypothesis; of runs held out where there are
    some, else left out.
    """
    n = len(diagnostics)
    figure = Figure(figsize=(9.5, 3.4 * n), layout="constrained")
    axes = figure.subplots(n, 2, squeeze=False, width_ratios=(1, 1.15))
    for row, (name, found) in zip(axes, diagnostics.items(), strict=True):
        _draw_runs(figure, row[0], name, found)
        _draw_face(figure, row[1], name, maps[name], travel)
        for axis in row:
            tidy(axis)
    return figure


def refinement_loop(refinement: Mapping[str, Any]) -> Figure:
    """Predicted shift of the posterior mean and error at the runs added, over runs so far."""
    figure = Figure(figsize=(9.5, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for order, (name, found) in enumerate(refinement.items()):
        style = {
            "color": COLOURS[order % len(COLOURS)],
            "marker": MARKERS[order % len(MARKERS)],
            "ms": 5,
            "label": name,
        }
        runs = [entry["n_train"] for entry in found["rounds"]]
        left.plot(runs, [max(entry["predicted_shift"]) for entry in found["rounds"]], **style)
        error = [_largest(entry["force_error"]) for entry in found["rounds"]]
        right.plot(runs, 100 * np.array(error), **style)
        if found.get("box") is not None:
            inside = [entry.get("box") is not None for entry in found["rounds"]]
            moves = [max(entry["predicted_shift"]) for entry in found["rounds"]]
            at = np.flatnonzero(inside)
            left.plot(
                np.array(runs)[at],
                np.array(moves)[at],
                ls="none",
                marker="s",
                ms=10,
                mfc="none",
                mec=style["color"],
                label=f"{name}: in its box",
            )
    limit = next(iter(refinement.values()))["limit"]
    left.axhline(limit, color=MUTED, lw=0.8)
    left.set_title(f"the loop stops below {limit:g}", fontsize=10)
    left.set_ylabel("posterior mean may move [SD]")
    right.set_title("at the runs then added, not seen before", fontsize=10)
    right.set_ylabel("emulator force error, RMS [%]")
    for axis in (left, right):
        axis.set_yscale("log")
        axis.set_xlabel("runs that trained the emulator")
        axis.xaxis.get_major_locator().set_params(integer=True)
        tidy(axis)
    left.legend()
    return figure


def _draw_runs(figure: Figure, axis: Axes, name: str, found: Mapping[str, Any]) -> None:
    """Largest force error of every run at its place in the design."""
    kinds = [kind for kind in KINDS if found["runs"].get(kind)]
    error = {
        kind: 100 * np.abs(found["runs"][kind]["relative_force_error"]).max(axis=1)
        for kind in kinds
    }
    top = max(float(values.max()) for values in error.values())
    for kind, marker in zip(KINDS, ("o", "s"), strict=True):
        if kind in error:
            ratios = np.array(found["runs"][kind]["ratios"])
            if ratios.shape[1] == 1:
                ratios = np.column_stack([ratios, np.zeros(len(ratios))])
            drawn = axis.scatter(
                ratios[:, 0],
                ratios[:, 1],
                c=error[kind],
                marker=marker,
                s=34,
                cmap="viridis_r",
                vmin=0.0,
                vmax=top or 1.0,
                edgecolors=INK,
                linewidths=0.5,
                label=KINDS[kind],
            )
    figure.colorbar(drawn, ax=axis, label="largest force error [%]")
    axis.set_title(name, fontsize=10, loc="right")
    labels = [*found.get("inputs", ("r [-]", "s [-]")), ""]
    axis.set_xlabel(labels[0])
    axis.set_ylabel(labels[1])
    axis.margins(0.08)
    # Beside the axes: the corners of a design are runs too.
    axis.legend(fontsize=7, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False)


def _draw_face(
    figure: Figure, axis: Axes, name: str, maps: Mapping[str, Array], travel: Sequence[float]
) -> None:
    """Error of the field at its worst increment at every point; the worst points are ringed."""
    kind = "held_out" if "held_out" in maps else "leave_one_out"
    axis.set_xlabel("x [mm]")
    axis.set_ylabel("y [mm]")
    if kind not in maps:
        axis.set_title(f"{name}: no field", fontsize=10, color=MUTED)
        return
    points, by_step = maps["points"], 1e3 * maps[kind]
    step, largest = by_step.argmax(axis=0), by_step.max(axis=0)
    drawn = axis.scatter(
        points[:, 0], points[:, 1], c=largest, s=14, cmap="viridis_r", vmin=0.0, linewidths=0
    )
    figure.colorbar(drawn, ax=axis, label="RMS error, worst increment [µm]")
    worst = np.argsort(-largest, kind="stable")[:N_MARKED]
    x, y = points[worst].T
    axis.scatter(x, y, s=46, facecolors="none", edgecolors=COLOURS[1], linewidths=1.0)
    axis.set_title(
        f"{name}: front face, {KINDS[kind]} runs\nworst {largest[worst[0]]:.2g} µm at "
        f" {travel[step[worst[0]]]:g} mm",
        fontsize=10,
    )
    axis.set_aspect("equal")
    axis.margins(0.1)


def _largest(values: Sequence[float | None]) -> float:
    return max((value for value in values if value is not None), default=np.nan)
