"""Figure of what the data of a study say of which parameter."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import chi2

from calib.inference.knowledge import Knowledge
from calib.inference.profile import LEVEL
from calib.plot_scales import thousandths
from calib.study.figure_style import COLOURS, INK, LINES, MARKERS, legend_columns, symbol, tidy

MOST_BELOW = 8.0
"""how far a likelihood may be below its maximum to be drawn, ln"""
ROOM = 40
"""characters of names that stand beside one another in a panel"""
TURNED: dict[str, Any] = {"rotation": 35, "ha": "right", "rotation_mode": "anchor"}
"""names that do not"""


def identify_figure(found: dict[str, Knowledge]) -> Figure:
    """Profiles of every coordinate, and SD left by part of the data; hypotheses by colour."""
    names = list(dict.fromkeys(name for known in found.values() for name in known.names))
    figure = Figure(figsize=(3.2 * (len(names) + 1), 3.3), layout="constrained")
    axes = figure.subplots(1, len(names) + 1)
    limit = 0.5 * chi2.ppf(LEVEL, 1)
    for column, label in enumerate(names):
        axis = axes[column]
        for order, (name, known) in enumerate(found.items()):
            if label not in known.names:
                continue
            profile = known.profiles[known.names.index(label)]
            style = {"color": COLOURS[order % len(COLOURS)], "ls": LINES[order % len(LINES)]}
            axis.plot(profile.values, profile.drop, label=name, **style)
        axis.axhline(limit, color=INK, lw=0.8, ls=":", label=f"limit of {100 * LEVEL:.0f} %")
        axis.set_ylim(MOST_BELOW, -0.2)
        axis.set_xlim(*_seen(found, label))
        axis.set_xlabel(_label(label, _unit(found, label)))
        thousandths(axis.xaxis)
        tidy(axis)
    axes[0].set_ylabel("ln likelihood below its maximum")
    _draw_contraction(axes[-1], found, names)
    marks: dict[str, Artist] = {}
    for axis in axes:
        marks.update(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    figure.legend(
        handles=list(marks.values()),
        loc="outside upper center",
        ncols=legend_columns(figure.get_figwidth()),
        title="profile likelihoods, and what is left of the prior",
        fontsize=9,
    )
    return figure


def _draw_contraction(axis: Axes, found: dict[str, Knowledge], names: list[str]) -> None:
    """Posterior SD over prior SD of every coordinate by every part of the data."""
    n = sum(len(known.parts) for known in found.values())
    step, drawn = min(0.12, 0.8 / n), 0
    for order, (name, known) in enumerate(found.items()):
        places = np.array([names.index(own) for own in known.names])
        for offset, entry in enumerate(known.parts):
            axis.plot(
                places + step * (drawn - 0.5 * (n - 1)),
                100 * entry.contraction,
                MARKERS[offset % len(MARKERS)],
                color=COLOURS[order % len(COLOURS)],
                label=f"{name}, by {entry.part}",
            )
            drawn += 1
    axis.axhline(100, color=INK, lw=0.8, ls=":")
    symbols = [_symbol(name) for name in names]
    long = max(map(len, symbols)) * len(symbols) > ROOM
    axis.set_xticks(range(len(names)), symbols, **(TURNED if long else {}))
    axis.set_ylabel("posterior SD / prior SD [%]")
    axis.set_ylim(bottom=-3)
    tidy(axis)


def _symbol(name: str) -> str:
    return f"ln {symbol(name[3:])}" if name.startswith("ln ") else symbol(name)


def _unit(found: dict[str, Knowledge], label: str) -> str:
    known = next(known for known in found.values() if label in known.names)
    return known.units[known.names.index(label)]


def _label(name: str, unit: str) -> str:
    """A coordinate and its unit, which a logarithm divides by."""
    if unit == "1":
        return f"{_symbol(name)} [-]"
    if unit.startswith("ln "):
        return f"ln({symbol(name.removeprefix('ln '))} / {unit.removeprefix('ln ')})"
    return f"{_symbol(name)} [{unit}]"


def _seen(found: dict[str, Knowledge], label: str) -> tuple[float, float]:
    """Where any profile of a coordinate is high enough to be seen, and a little beside.

    A profile sharp in its prior would be one line on the prior's whole range.
    """
    ends: list[float] = []
    for known in found.values():
        if label in known.names:
            profile = known.profiles[known.names.index(label)]
            # The best value is one of them, however coarse the profile is.
            drawn = profile.drop <= max(MOST_BELOW, float(np.nanmin(profile.drop)))
            ends += [float(v) for v in profile.values[drawn]]
    width = (max(ends) - min(ends)) or 1e-3
    return min(ends) - 0.15 * width, max(ends) + 0.15 * width
