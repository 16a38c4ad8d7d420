"""Figures of emulators: errors on the front face and over the design, and the loop of refinement.

`diagnostics` and `refinement` as in `emulator_tables`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from calib.plot_scales import plain_log
from calib.study.emulator_tables import KINDS
from calib.study.figure_style import COLOURS, INK, MARKERS, MUTED, Array, tidy

N_MARKED = 10
"""worst points that are marked on the front face"""
DECADES = 1e3
"""largest error over the smallest that has a colour of its own"""


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
    """Predicted shift of the posterior mean and error at the runs added, round by round.

    Each round says how many runs trained its emulator: in a box about the posterior these are
    fewer, since only those within it count.
    """
    figure = Figure(figsize=(10.5, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    boxed = False
    for order, (name, found) in enumerate(refinement.items()):
        rounds = found["rounds"]
        moves = np.array([max(entry["predicted_shift"]) for entry in rounds])
        error = 100 * np.array([_largest(entry["force_error"]) for entry in rounds])
        inside = np.array([entry.get("box") is not None for entry in rounds])
        boxed |= bool(inside.any())
        for axis, values in ((left, moves), (right, error)):
            _draw_rounds(axis, values, inside, order, name)
        for place, entry in enumerate(rounds):
            _write(left, place + 1, moves[place], str(entry["n_train"]), order)
    limit = next(iter(refinement.values()))["limit"]
    left.axhline(limit, color=MUTED, lw=1.0, ls="--", label=f"the loop stops below {limit:g}")
    left.set_title("number: runs that trained the emulator", fontsize=10)
    left.set_ylabel("posterior mean may move [SD]")
    right.set_title("at the runs then added, not seen before", fontsize=10)
    right.set_ylabel("emulator force error, RMS [%]")
    for axis in (left, right):
        axis.set_yscale("log")
        axis.margins(0.08, 0.12)
        plain_log(axis.yaxis)
        axis.set_xlabel("round of refinement")
        axis.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        tidy(axis)
    handles, _ = left.get_legend_handles_labels()
    if boxed:
        look: dict[str, Any] = {"ls": "", "marker": "o", "mfc": "w", "mec": INK}
        handles.append(Line2D([], [], label="open: in a box about the posterior", **look))
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


def _draw_rounds(axis: Axes, values: Array, inside: Array, order: int, name: str) -> None:
    """A line over the rounds of one hypothesis, open marks for those in a box."""
    number = np.arange(1, values.size + 1)
    colour, marker = COLOURS[order % len(COLOURS)], MARKERS[order % len(MARKERS)]
    axis.plot(number, values, color=colour, marker=marker, ms=5, lw=1.0, label=name)
    axis.plot(number[inside], values[inside], color=colour, marker=marker, ms=5, mfc="w", ls="")


def _write(axis: Axes, x: float, y: float, text: str, order: int) -> None:
    """A number beside a mark, above those of the first hypothesis and below those of others."""
    axis.annotate(
        text,
        (x, y),
        xytext=(0, -5 if order else 5),
        textcoords="offset points",
        ha="center",
        va="top" if order else "bottom",
        fontsize=7,
        color=COLOURS[order % len(COLOURS)],
    )


def _draw_runs(figure: Figure, axis: Axes, name: str, found: Mapping[str, Any]) -> None:
    """Largest force error of every run at its place in the design."""
    kinds = [kind for kind in KINDS if found["runs"].get(kind)]
    error = {
        kind: 100 * np.abs(found["runs"][kind]["relative_force_error"]).max(axis=1)
        for kind in kinds
    }
    every = np.concatenate(list(error.values()))
    low, top = _decades(every)
    marks = []
    for kind, marker in zip(KINDS, ("o", "s"), strict=True):
        if kind in error:
            ratios = np.array(found["runs"][kind]["ratios"])
            if ratios.shape[1] == 1:
                ratios = np.column_stack([ratios, np.zeros(len(ratios))])
            order = np.argsort(error[kind], kind="stable")  # the worst on top
            drawn = axis.scatter(
                ratios[order, 0],
                ratios[order, 1],
                c=np.maximum(error[kind][order], low),
                marker=marker,
                s=34,
                cmap="viridis_r",
                norm=LogNorm(low, top),
                edgecolors=INK,
                linewidths=0.5,
            )
            # A colour stands for an error: the legend shows the shape only.
            look: dict[str, Any] = {"ls": "", "mfc": "w", "mec": INK, "mew": 0.5}
            marks.append(Line2D([], [], marker=marker, label=KINDS[kind], **look))
    smaller: Literal["min", "neither"] = "min" if every.min() < low else "neither"
    bar = figure.colorbar(drawn, ax=axis, label="largest force error [%]", extend=smaller)
    plain_log(bar.ax.yaxis)
    axis.set_title(name, fontsize=10, loc="right")
    labels = found.get("inputs", ("r [-]", "s [-]"))
    axis.set_xlabel(labels[0])
    if len(labels) > 1:
        axis.set_ylabel(labels[1])
    else:
        axis.yaxis.set_visible(False)
    if len(labels) > 2:
        axis.set_title(f"over two of {len(labels)} inputs", fontsize=9, loc="left")
    axis.margins(0.08)
    # Beside the axes: the corners of a design are runs too.
    axis.legend(
        handles=marks,
        fontsize=8,
        loc="lower left",
        bbox_to_anchor=(-0.03, 1.0),
        ncols=2,
        frameon=False,
        handletextpad=0.2,
    )


def _draw_face(
    figure: Figure, axis: Axes, name: str, maps: Mapping[str, Array], travel: Sequence[float]
) -> None:
    """Error of the field at its worst increment at every point; the worst points are ringed."""
    kind = "held_out" if "held_out" in maps else "leave_one_out"
    axis.set_xlabel("x [mm]")
    axis.set_ylabel("y [mm]")
    if kind not in maps:
        axis.set_axis_off()
        axis.set_title(f"{name}: no field", fontsize=10, color=MUTED)
        return
    points, by_step = maps["points"], 1e3 * maps[kind]
    step, largest = by_step.argmax(axis=0), by_step.max(axis=0)
    drawn = axis.scatter(
        points[:, 0], points[:, 1], c=largest, s=14, cmap="viridis_r", vmin=0.0, linewidths=0
    )
    figure.colorbar(drawn, ax=axis, label="RMS error,\nworst increment [µm]", shrink=0.7)
    worst = np.argsort(-largest, kind="stable")[:N_MARKED]
    x, y = points[worst].T
    axis.scatter(x, y, s=46, facecolors="none", edgecolors=COLOURS[1], linewidths=1.0)
    axis.set_title(
        f"{name}: front face, {KINDS[kind]} runs\nworst {largest[worst[0]]:.2g} µm, at a travel "
        f"of {travel[step[worst[0]]]:g} mm",
        fontsize=10,
    )
    axis.set_aspect("equal")
    axis.margins(0.1)


def _decades(errors: Array) -> tuple[float, float]:
    """Ends of a scale of colours by decades, on which one run far off leaves the others colours.

    Such runs are in the corners of a design.
    """
    top = float(errors.max()) or 1.0
    low = max(float(errors.min()), top / DECADES)
    return (low if low < top else top / 10), top


def _largest(values: Sequence[float | None]) -> float:
    return max((value for value in values if value is not None), default=np.nan)
