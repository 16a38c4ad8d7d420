"""Figure of a validation: answer against level, error and coverage by increment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from calib.inference.validation import Prediction
from calib.study.figure_style import COLOURS, INK, INTERVAL, LINES, MARKERS, MUTED, Array, tidy
from calib.study.second_data import SecondData


@dataclass(frozen=True)
class Shown:
    """One prediction as it is drawn."""

    name: str
    replicates: Array
    """(n, n_step) of the measured mean answer"""
    judged: dict[str, Prediction]


def validation_figure(data: SecondData, shown: Sequence[Shown]) -> Figure:
    """Measured and predicted answers, and the error of every quantity over the increments."""
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
        for index, (quantity, judged) in enumerate(one.judged.items()):
            right.plot(
                data.levels,
                100 * np.array(judged.error_by_step),
                color=colour,
                marker=MARKERS[index % len(MARKERS)],
                lw=0.8,
                ms=5,
                label=quantity if order == 0 else None,
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
    left.set_ylim(bottom=0)
    left.set_ylabel(data.quantity)
    left.legend(fontsize=8)
    right.axhline(10, color=MUTED, lw=0.8, ls="--")
    right.set_yscale("log")
    right.set_ylabel("error over RMS of the measured [%]")
    right.set_title("dashed: 10 % (requirement 8)", fontsize=10)
    right.legend(fontsize=8, title="quantity")
    for axis in (left, right):
        axis.set_xlabel(level)
        tidy(axis)
    return figure
