"""Figure of the calibration of real cylinders: misfit by travel, and tension predicted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calib.study.figure_style import COLOURS, INK, LINES, MARKERS, tidy


def cylinder_figure(facts: Mapping[str, Any]) -> Figure:
    """Left: models off the mean of the repeats; right: predicted over another's tension."""
    figure = Figure(figsize=(10.5, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    travel = np.asarray(facts["travel"])
    spread = 100 * np.asarray(facts["force_sd_share"])
    left.fill_between(travel, -spread, spread, color=INK, alpha=0.15, lw=0, label="SD of repeats")
    laws = list(dict.fromkeys(one["law"] for one in facts["models"]))
    ends = list(dict.fromkeys(one["ends"] for one in facts["models"]))
    for one in facts["models"]:
        law, end = laws.index(one["law"]), ends.index(one["ends"])
        style = {"color": COLOURS[law], "ls": LINES[end], "marker": MARKERS[end], "ms": 4, "lw": 1}
        name = f"{one['law']}, {one['ends']}"
        left.plot(travel, 100 * np.asarray(one["misfit"]), label=name, **style)
        right.plot(one["tension"]["stretch"], one["tension"]["ratio"], **style)
    left.set_xlabel("travel [mm]")
    left.set_ylabel("model off the mean of five repeats [%]")
    left.axhline(0.0, color=INK, lw=0.8)
    # Below the panels: the curves fill them.
    figure.legend(fontsize=7, ncols=5, loc="outside lower center", handlelength=3.5)
    right.axhline(1.0, color=INK, lw=0.8)
    right.set_xlabel("stretch in tension [-]")
    right.set_ylabel("predicted over measured elsewhere [-]")
    for axis in (left, right):
        tidy(axis)
    return figure
