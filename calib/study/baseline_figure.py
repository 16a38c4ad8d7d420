"""Figure of the thesis' own method: its answers along the valley, over the posterior."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from calib.data.thesis import optimization_runs
from calib.study.figure_style import COLOURS, INK, MUTED, Array, tidy

if TYPE_CHECKING:
    from calib.study.baseline import BaselineStudy

EDGES = (2e-4, 2e-5)
"""MPa, smallest C10 and C01 that are drawn"""


def baseline_figure(found: BaselineStudy, draws: Array | None) -> Figure:
    """Answers in (C10, C01), from start to end, with the posterior and the thesis' own answers."""
    figure = Figure(figsize=(10.5, 4.4), layout="constrained")
    for axis, run in zip(figure.subplots(1, 2), found.runs[:2], strict=True):
        if draws is not None:
            few = draws[:: max(1, len(draws) // 1500)]
            axis.plot(few[:, 0], few[:, 1], ".", ms=1.5, color=COLOURS[0], alpha=0.3)
            axis.plot([], [], ".", color=COLOURS[0], label="posterior of the study (force in it)")
        printed = optimization_runs().result
        axis.plot(
            printed[:, 0],
            printed[:, 1],
            "x",
            color=MUTED,
            zorder=4,
            label="thesis Table 5.3 (real)",
        )
        # A constant of zero ends at the edge of logarithmic axes, where a triangle shows the way.
        ends = np.maximum(run.result[:, :2], EDGES)
        for start, end in zip(run.start, ends, strict=True):
            axis.plot([start[0], end[0]], [start[1], end[1]], "-", lw=0.6, color=COLOURS[1])
        axis.plot(run.start[:, 0], run.start[:, 1], "o", mfc="w", color=COLOURS[1], label="start")
        kind = "synthetic field" if found.synthetic else "measured field"
        label = f"end, {kind}"
        inside = np.all(run.result[:, :2] >= EDGES, axis=1)
        axis.plot(*ends[inside].T, "o", color=COLOURS[1], label=label)
        for column, mark in enumerate("<v"):
            out = run.result[:, column] < EDGES[column]
            if out.any():
                name = ("C_{10}", "C_{01}")[column]
                style = {"color": COLOURS[1], "clip_on": False, "label": f"end at ${name}$ = 0"}
                axis.plot(*ends[out].T, mark, **style)
        if found.truth is not None:
            ray = np.geomspace(0.02, 50.0, 50)[:, None] * found.truth
            axis.plot(ray[:, 0], ray[:, 1], ":", color=INK, label="ray of the truth: one error")
            axis.plot(*found.truth[:2], "*", ms=13, color=INK, label="synthetic truth")
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlim(EDGES[0], 0.2)
        axis.set_ylim(EDGES[1], 0.5)
        axis.set_xlabel("$C_{10}$ [MPa]")
        axis.set_ylabel("$C_{01}$ [MPa]")
        gradients = "exact gradients" if run.exact else "central differences of 0.1"
        axis.set_title(f"{run.method}, {gradients}", fontsize=9)
        tidy(axis)
    figure.axes[0].legend(fontsize=7, loc="lower right")
    return figure
