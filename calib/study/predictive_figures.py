"""Figures of the posterior predictive checks: maps of the front face, p-values and coverage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calib.study.figure_style import COLOURS, INK, MARKERS, MUTED, SHARE, Array, tidy

COMPONENTS = ("x", "y", "z")


def face_maps(name: str, maps: Mapping[str, Array]) -> Figure:
    """Correlation and RMS error over the increments at each point (thesis, 5.9 to 5.12, D, E).

    `maps`: points (n_point, 2) mm, correlation and rmse (n_point, 3). A row has one scale of
    colours, so that the components compare.
    """
    figure = Figure(figsize=(10.5, 4.2), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True, sharey=True)
    x, y = maps["points"].T
    rmse = 1e3 * maps["rmse"]
    rows: tuple[tuple[Array, str, dict[str, Any]], ...] = (
        (
            maps["correlation"],
            "correlation R\nover the increments [-]",
            {"cmap": "RdBu", "vmin": -1.0, "vmax": 1.0},
        ),
        (
            rmse,
            "RMS error over\nthe increments [µm]",
            {"cmap": "viridis_r", "vmin": 0.0, "vmax": float(np.nanmax(rmse)) or 1.0},
        ),
    )
    for row, (values, label, style) in zip(axes, rows, strict=True):
        for axis, of_component in zip(row, values.T, strict=True):
            # Grey behind: the middle of the map of a signed number is white.
            axis.set_facecolor("#dddddd")
            drawn = axis.scatter(x, y, c=of_component, s=14, linewidths=0, **style)
            axis.set_aspect("equal")
        figure.colorbar(drawn, ax=list(row), label=label, shrink=0.85)
    for column, component in enumerate(COMPONENTS):
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
        top.axhspan(-1.0, 0.05, color=MUTED, alpha=0.2, lw=0, label="p below 0.05 or above 0.95")
        top.axhspan(0.95, 2.0, color=MUTED, alpha=0.2, lw=0)
        bottom.axhline(94, color=INK, lw=1.0, ls="--", label=f"coverage stated: {SHARE}")
        top.set_title(f"{name}: $u_{component}$", fontsize=10)
        bottom.set_xlabel("pin travel [mm]")
        bottom.set_xticks(np.asarray(travel))
        for axis in (top, bottom):
            tidy(axis)
    axes[0, 0].set_ylabel("predictive p-value [-]")
    axes[1, 0].set_ylabel(f"points in {SHARE} interval [%]")
    # Room for marks at 0 and 1, of which there are many.
    axes[0, 0].set_ylim(-0.04, 1.04)
    axes[1, 0].set_ylim(top=102.0)
    axes[1, 0].yaxis.get_major_locator().set_params(steps=[1, 2, 5, 10])
    marks = [axis.get_legend_handles_labels()[0] for axis in axes[:, 0]]
    # Beside the panels: in any of them it would be on some study's points.
    figure.legend(handles=[*marks[0], *marks[1]], loc="outside upper center", ncols=5, fontsize=9)
    return figure
