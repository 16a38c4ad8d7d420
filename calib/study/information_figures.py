"""Figure of what to measure next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from calib.study.figure_style import COLOURS, INK, tidy


def gains_figure(facts: Mapping[str, Any]) -> Figure:
    """Bars of the gain by experiment, coloured by what is changed, with the nested bounds."""
    plans = list(reversed(facts["plans"]))
    figure = Figure(figsize=(9.0, 0.32 * len(plans) + 1.4), layout="constrained")
    axis = figure.subplots()
    groups = list(dict.fromkeys(plan["group"] for plan in facts["plans"]))
    for place, plan in enumerate(plans):
        order = groups.index(plan["group"])
        axis.barh(place, plan["gain"]["mean"], color=COLOURS[order % len(COLOURS)], alpha=0.8)
        nested = plan["nested"]
        low = nested["lower"]["mean"] - nested["lower"]["error"]
        high = nested["upper"]["mean"] + nested["upper"]["error"]
        label = "bounds of nested Monte Carlo, less and plus their errors" if place == 0 else None
        axis.plot([low, high], [place, place], color=INK, lw=1.5, label=label)
    for order, group in enumerate(groups):
        axis.barh(0, 0, color=COLOURS[order % len(COLOURS)], alpha=0.8, label=group)
    axis.set_yticks(range(len(plans)), [plan["name"] for plan in plans], fontsize=8)
    axis.set_xlabel("expected information gain [nats]")
    # Above the bars, which may all be long.
    figure.legend(fontsize=8, loc="outside upper center", ncols=len(groups) + 1)
    tidy(axis)
    return figure
