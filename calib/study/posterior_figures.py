"""Figures of the posterior: marginals, pairs and chains, drawn from plain arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from scipy.ndimage import gaussian_filter

from calib.plot_scales import thousandths
from calib.study.figure_style import (
    COLOURS,
    INK,
    INTERVAL,
    MUTED,
    SHARE,
    Array,
    hdi,
    legend_columns,
    symbol,
    tidy,
)

_HDI = f"{SHARE} HDI"
MOST_COLUMNS = 6
"""panels side by side, beyond which a page shows letters too small to read"""
NARROWEST = 7.0
"""inches, in which titles have room"""


@dataclass(frozen=True)
class Samples:
    """Posterior draws under one hypothesis."""

    name: str
    constants: Mapping[str, Array]
    """constant -> (n_draw,), MPa"""
    map_emulator: Mapping[str, float]
    map_fe: Mapping[str, float]
    units: Mapping[str, str] = field(default_factory=dict)
    """of constants that are not in MPa"""

    def label(self, name: str) -> str:
        """A constant and its unit."""
        return f"{symbol(name)} [{self.units.get(name, 'MPa')}]"


@dataclass(frozen=True)
class Chains:
    """Walkers of one hypothesis in the order in which they were drawn."""

    name: str
    parameters: Mapping[str, Array]
    """label with unit -> (n_ensemble, n_walker, n_draw)"""


def marginals(
    samples: Sequence[Samples],
    published: Mapping[str, float] | None = None,
    truth: Mapping[str, float] | None = None,
) -> Figure:
    """Marginal posterior of every constant, hypotheses in rows with axes of their own.

    A constant has one column, unless all of them are more than a page holds side by side.
    """
    names = list(dict.fromkeys(name for sample in samples for name in sample.constants))
    aligned = len(names) <= MOST_COLUMNS
    rows = [names if aligned else list(sample.constants) for sample in samples]
    most = max(map(len, rows))
    size = max(NARROWEST, 2.9 * most), 1.2 + 1.75 * len(samples) * (1.0 if aligned else 1.2)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(samples), most, squeeze=False)
    for row, sample in enumerate(samples):
        for axis in grid[row, len(rows[row]) :]:
            axis.set_axis_off()
        for axis, name in zip(grid[row], rows[row], strict=False):
            if name not in sample.constants:
                axis.set_axis_off()
                continue
            _draw_marginal(axis, sample, name, row)
            labelled = not aligned or _is_last(samples, row, name)
            axis.set_xlabel(sample.label(name) if labelled else "")
            axis.set_xlim(*_span(sample.constants[name], name, truth))
            _mark(axis, name, published, truth)
            axis.xaxis.set_major_locator(MaxNLocator(4))
            thousandths(axis.xaxis)
    for row, sample in enumerate(samples):
        grid[row, 0].set_ylabel(sample.name, color=COLOURS[row % len(COLOURS)], weight="bold")
    found: dict[str, Artist] = {}
    for axis in grid.ravel():
        found.update(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    # In no hypothesis' colour, since all have one.
    found[_HDI] = Line2D([], [], color=MUTED, lw=4, solid_capstyle="butt")
    figure.legend(
        list(found.values()), list(found), loc="outside upper center", ncols=legend_columns(size[0])
    )
    return figure


def pairs(samples: Sequence[Samples], truth: Mapping[str, float] | None = None) -> Figure:
    """Draws and highest-density contours (50 and 94 %) of every pair of constants.

    A row for each hypothesis, or several, with axes of its own: one posterior may be a dot on
    another's axes.
    """
    couples = [list(combinations(sample.constants, 2)) for sample in samples]
    most = min(max(1, *(len(own) for own in couples)), MOST_COLUMNS - 2)
    heights = [max(1, -(-len(own) // most)) for own in couples]
    figure = Figure(
        figsize=(max(NARROWEST, 3.4 * most), 0.6 + 2.7 * sum(heights)), layout="constrained"
    )
    grid = figure.subplots(sum(heights), most, squeeze=False)
    for order, sample in enumerate(samples):
        first = sum(heights[:order])
        own = grid[first : first + heights[order]].ravel()
        for axis in own[len(couples[order]) :]:
            axis.set_axis_off()
        for axis, (x_name, y_name) in zip(own, couples[order], strict=False):
            _draw_pair(axis, sample, x_name, y_name, order)
            if truth and x_name in truth and y_name in truth:
                _mark_truth(axis, truth[x_name], truth[y_name])
            axis.set_xlabel(sample.label(x_name))
            axis.set_ylabel(sample.label(y_name))
            for one in (axis.xaxis, axis.yaxis):
                one.set_major_locator(MaxNLocator(4))
                thousandths(one)
            tidy(axis)
        own[0].set_title(
            sample.name, loc="left", color=COLOURS[order % len(COLOURS)], weight="bold"
        )
    figure.suptitle(
        f"posterior draws; contours hold 50 % (thick) and {SHARE} (thin) of them; every "
        "hypothesis has its own axes",
        fontsize=9,
    )
    return figure


def chains(chain_sets: Sequence[Chains]) -> Figure:
    """Median and 10 to 90 % range over the walkers of every ensemble, draw by draw."""
    labels = list(
        dict.fromkeys(label for chain_set in chain_sets for label in chain_set.parameters)
    )
    figure = Figure(figsize=(11.0, 1.0 + 1.6 * len(labels)), layout="constrained")
    grid = figure.subplots(len(labels), len(chain_sets), squeeze=False, sharex="col")
    for column, chain_set in enumerate(chain_sets):
        for row, label in enumerate(labels):
            axis = grid[row, column]
            if label not in chain_set.parameters:
                axis.set_axis_off()
                continue
            for order, walkers in enumerate(chain_set.parameters[label]):
                low, middle, high = np.quantile(walkers, [0.1, 0.5, 0.9], axis=0)
                draw = np.arange(middle.size)
                colour = COLOURS[order % len(COLOURS)]
                axis.fill_between(draw, low, high, color=colour, alpha=0.12, lw=0)
                axis.plot(draw, middle, color=colour, lw=0.9, label=f"ensemble {order + 1}")
            axis.set_ylabel(label)
            thousandths(axis.yaxis)
            tidy(axis)
        grid[0, column].set_title(chain_set.name)
        grid[-1, column].set_xlabel("draw kept")
    handles, names = grid[0, 0].get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="outside upper center",
        ncols=6,
        title="median (line) and 10 to 90 % range (band) over the walkers of each ensemble",
    )
    return figure


def _is_last(samples: Sequence[Samples], row: int, name: str) -> bool:
    """Whether no sample below this row has a constant of this name."""
    return not any(name in sample.constants for sample in samples[row + 1 :])


def _draw_marginal(axis: Axes, sample: Samples, name: str, order: int) -> None:
    draws = sample.constants[name]
    colour = COLOURS[order % len(COLOURS)]
    low, high = hdi(draws)
    axis.hist(draws, bins=60, density=True, color=colour, alpha=0.35, histtype="stepfilled")
    top = axis.get_ylim()[1]
    axis.plot(
        [low, high],
        [-0.05 * top] * 2,
        color=colour,
        lw=4,
        solid_capstyle="butt",
        label=_HDI,
    )
    for values, marker, label in (
        (sample.map_emulator, "^", "MAP, emulator"),
        (sample.map_fe, "x", "MAP, direct FE"),
    ):
        if name in values:
            axis.plot(values[name], -0.05 * top, marker, color=INK, ms=6, ls="", label=label)
    # Room above for a note beside the densities, not on them.
    axis.set_ylim(-0.12 * top, 1.15 * top)
    axis.set_yticks([])
    tidy(axis)
    axis.spines["left"].set_visible(False)


def _mark(
    axis: Axes,
    name: str,
    published: Mapping[str, float] | None,
    truth: Mapping[str, float] | None,
) -> None:
    """A line at the truth and at the published value, or a note where that lies off the axis."""
    if truth and name in truth:
        axis.axvline(truth[name], color=INK, lw=1.6, label="synthetic truth")
    if not published or name not in published:
        return
    low, high = axis.get_xlim()
    value = published[name]
    if low <= value <= high:
        axis.axvline(value, color=MUTED, lw=1.4, ls=":", label="published")
        return
    right = value > high
    axis.text(
        0.98 if right else 0.02,
        1.0,
        f"published {value:.3g} →" if right else f"← published {value:.3g}",
        transform=axis.transAxes,
        ha="right" if right else "left",
        va="top",
        fontsize=8,
        color=INK,
    )


def _mark_truth(axis: Axes, x: float, y: float) -> None:
    """A star at the truth, or a note where it lies off the axes, which it must not stretch."""
    (left, right), (bottom, top) = axis.get_xlim(), axis.get_ylim()
    if left <= x <= right and bottom <= y <= top:
        axis.plot(x, y, "*", color=INK, ms=12)
        text = "star: synthetic truth"
    else:
        text = "synthetic truth lies off these axes"
    axis.text(0.98, 0.97, text, transform=axis.transAxes, ha="right", va="top", fontsize=7)


def _draw_pair(axis: Axes, sample: Samples, x_name: str, y_name: str, order: int) -> None:
    x, y = sample.constants[x_name], sample.constants[y_name]
    colour = COLOURS[order % len(COLOURS)]
    shown = slice(None, None, max(1, x.size // 1500))
    axis.plot(x[shown], y[shown], ".", color=colour, ms=1.5, alpha=0.25, rasterized=True)
    centre_x, centre_y, density, levels = _density(x, y)
    axis.contour(centre_x, centre_y, density, levels=levels, colors=colour, linewidths=(1.0, 1.8))


def _density(x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Smoothed histogram and the levels that enclose 94 % and 50 % of its mass."""
    counts, edge_x, edge_y = np.histogram2d(x, y, bins=40)
    # Reflected smoothing keeps the mass inside the prior's bounds; zeros around close the contours.
    density = np.pad(gaussian_filter(counts, 1.2, mode="reflect"), 1).T
    centre_x, centre_y = (
        edge[0] + (edge[1] - edge[0]) * (np.arange(counts.shape[0] + 2) - 0.5)
        for edge in (edge_x, edge_y)
    )
    ordered = np.sort(density.ravel())[::-1]
    mass = np.cumsum(ordered) / ordered.sum()
    levels = np.asarray([ordered[np.searchsorted(mass, p)] for p in (INTERVAL, 0.5)])
    if levels[1] <= levels[0]:
        levels[1] = levels[0] * (1 + 1e-9) + 1e-300
    return centre_x, centre_y, density, levels


def _span(draws: Array, name: str, truth: Mapping[str, float] | None) -> tuple[float, float]:
    """Axis limits that show 99.8 % of the posterior and the truth."""
    low, high = (float(value) for value in np.quantile(draws, [0.001, 0.999]))
    if truth and name in truth:
        low, high = min(low, truth[name]), max(high, truth[name])
    margin = 0.05 * (high - low) or 1e-6
    return low - margin, high + margin
