"""Figures of the posterior predictive checks: maps of the front face, p-values and coverage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calib.study.figure_style import COLOURS, MARKERS, MUTED, Array, tidy

COMPONENTS = ("x", "y", "z")


def face_maps(name: str, maps: Mapping[str, Array]) -> Figure:
    """Correlation and RMS error over the increments at each point (thesis, 5.9 to 5.12, D, E).

    `maps`: points (n_point, 2) mm, correlation and rmse (n_point, 3).
    """
    figure = Figure(figsize=(10.5, 4.4), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True, sharey=True)
    x, y = maps["points"].T
    for column, component in enumerate(COMPONENTS):
        for row, (key, unit, scale) in enumerate(
            (("correlation", "R [-]", 1.0), ("rmse", "", 1e3))
        ):
            axis, values = axes[row, column], scale * maps[key][:, column]
            style: dict[str, Any] = {"cmap": "viridis", "vmin": -1.0, "vmax": 1.0}
            if key == "rmse":
                style = {"cmap": "viridis_r", "vmin": 0.0}
            drawn = axis.scatter(x, y, c=values, s=14, linewidths=0, **style)
            figure.colorbar(drawn, ax=axis, label=unit or "RMSE [µm]")
            axis.set_aspect("equal")
        axes[0, column].set_title(f"{name}: $u_{component}$", fontsize=10)
        axes[1, column].set_xlabel("x [mm]")
    for axis in axes[:, 0]:
        axis.set_ylabel("y [mm]")
    return figure


def region_checks(name: str, travel: Array, checks: Mapping[str, Any]) -> Figure:
    """p-value and coverage of every region, increment and component; `checks` of one hypothesis."""
    figure = Figure(figsize=(10.5, 5.0), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True, sharey="row")
    for column, component in enumerate(COMPONENTS):
        top, bottom = axes[:, column]
        for order, (region, steps) in enumerate(checks.items()):
            style = {
                "color": COLOURS[order % len(COLOURS)],
                "marker": MARKERS[order % len(MARKERS)],
                "ms": 5,
                "lw": 1.0,
            }
            found = [step[column] for step in steps]
            top.plot(travel, [c["p_value"] for c in found], label=region, **style)
            bottom.plot(travel, [100 * c["coverage"]["0.94"] for c in found], **style)
        top.axhspan(0.0, 0.05, color=MUTED, alpha=0.2, lw=0)
        top.axhspan(0.95, 1.0, color=MUTED, alpha=0.2, lw=0)
        bottom.axhline(94, color=MUTED, lw=0.8)
        top.set_title(f"{name}: $u_{component}$", fontsize=10)
        bottom.set_xlabel("pin travel [mm]")
        bottom.set_xticks(np.asarray(travel))
        for axis in (top, bottom):
            tidy(axis)
    axes[0, 0].set_ylabel("predictive p-value [-]")
    axes[1, 0].set_ylabel("points in 94 % interval [%]")
    axes[0, 0].set_ylim(0.0, 1.0)
    axes[0, 2].legend(fontsize=8)
    return figure
