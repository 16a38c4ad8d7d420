"""Figure of a validation: answer against level, error and coverage by increment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from calib.inference.validation import Prediction
from calib.plot_scales import plain_log
from calib.study.figure_style import COLOURS, INK, INTERVAL, LINES, MARKERS, MUTED, Array, tidy
from calib.study.second_data import SecondData


@dataclass(frozen=True)
class Shown:
    """One prediction as it is drawn."""

    name: str
    replicates: Array
    """(n, n_step) of the measured mean answer"""
    judged: dict[str, Prediction]


def validation_figure(data: SecondData, shown: Sequence[Shown], max_error: float) -> Figure:
    """Measured and predicted answers, and the error of every quantity over the increments.

    `max_error`: the relative error that all increments together must stay below.
    """
    figure = Figure(figsize=(10.5, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    tail = (1 - INTERVAL) / 2
    level = "force [N]" if data.control == "force" else "travel [mm]"
    for order, one in enumerate(shown):
        colour = COLOURS[order % len(COLOURS)]
        low, middle, high = np.quantile(one.replicates, [tail, 0.5, 1 - tail], axis=0)
        left.fill_between(data.levels, low, high, color=colour, alpha=0.3, lw=0)
        left.plot(
            data.levels, middle, color=colour, ls=LINES[order % len(LINES)], label=one.name, lw=1.2
        )
    spread = np.abs(data.softened(data.answer)) * data.stiffness_sd
    kind = "synthetic" if data.synthetic else "measured"
    left.errorbar(
        data.levels,
        data.answer,
        yerr=spread,
        fmt="o",
        ms=4,
        color=INK,
        capsize=3,
        label=f"{kind}: mean of {data.n_samples}, SD between samples",
    )
    # In no prediction's colour, since all have one.
    left.plot([], [], color=INK, lw=1.2, label="median of replicates")
    left.fill_between([], [], color=INK, alpha=0.3, lw=0, label=f"{INTERVAL:.0%} of replicates")
    left.set_ylim(bottom=0)
    left.set_ylabel(data.quantity)
    left.legend(fontsize=8)
    _draw_errors(right, data, shown, max_error)
    figure.legend(handles=_marks(data, shown), fontsize=9, ncols=5, loc="outside upper right")
    for axis in (left, right):
        axis.set_xlabel(level)
        axis.set_xticks(data.levels)
        tidy(axis)
    return figure


def _draw_errors(axis: Axes, data: SecondData, shown: Sequence[Shown], max_error: float) -> None:
    """Relative error of every quantity that is judged, and what is asked of it."""
    kind = "synthetic" if data.synthetic else "measured"
    for order, one in enumerate(shown):
        for index, judged in enumerate(one.judged.values()):
            axis.plot(
                data.levels,
                100 * np.array(judged.error_by_step),
                color=COLOURS[order % len(COLOURS)],
                marker=MARKERS[index % len(MARKERS)],
                ls=LINES[order % len(LINES)],
                lw=0.8,
                ms=5,
            )
    axis.axhline(100 * max_error, color=MUTED, lw=0.8)
    axis.set_ylabel(f"RMS error over RMS of the {kind} [%]")
    axis.set_title(
        f"grey line: {100 * max_error:g} %, asked of all increments together", fontsize=10
    )
    plain_log(axis.yaxis)


def _symbol(quantity: str, data: SecondData) -> str:
    """A quantity that is judged: what was read, or a component of the field."""
    return data.quantity.partition(" [")[0] if quantity == "answer" else f"$u_{quantity}$"


def _marks(data: SecondData, shown: Sequence[Shown]) -> list[Line2D]:
    """Marks of the quantities, without a colour: that is a prediction's."""
    names = dict.fromkeys(name for one in shown for name in one.judged)
    return [
        Line2D([], [], ls="", marker=marker, color=INK, label=_symbol(name, data))
        for name, marker in zip(names, cycle(MARKERS), strict=False)
    ]
