"""Figures of a population: how samples are drawn together, and what a new one will show."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from calib.plot_scales import thousandths
from calib.study.figure_style import COLOURS, INK, MUTED, SHARE, Array, symbol, tidy
from calib.study.population_summary import PopulationSummary


def shrinkage(found: PopulationSummary) -> Figure:
    """Each sample by itself and within its population, and the band of the population."""
    names = [name for name in found.samples if name in (*found.varying, "mu")]
    n = len(found.sample_names)
    figure = Figure(figsize=(0.6 + 3.2 * len(names), 1.4 + 0.24 * n), layout="constrained")
    rows = np.arange(n)
    grid = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    for axis, name in zip(grid, names, strict=True):
        new, centre = found.new[name], found.population[name]
        axis.axvspan(new.hdi_low, new.hdi_high, color=COLOURS[0], alpha=0.12, lw=0,
                     label=f"a new sample, {SHARE}")  # fmt: skip
        axis.axvline(centre.mean, color=COLOURS[0], lw=1.2, label="mean of the population")
        for spreads, offset, colour, marker, label in (
            (found.alone[name], 0.14, MUTED, "o", "by itself, one SD"),
            (found.samples[name], -0.14, INK, "s", "within the population, one SD"),
        ):
            axis.errorbar(
                [spread.mean for spread in spreads],
                rows + offset,
                xerr=[spread.sd for spread in spreads],
                fmt=marker, ms=3.5, lw=1.0, color=colour, label=label,
            )  # fmt: skip
        unit = found.samples[name][0].unit
        axis.set_xlabel(f"{symbol(name)} [{'-' if unit == '1' else unit}]")
        axis.xaxis.set_major_locator(MaxNLocator(4))
        thousandths(axis.xaxis)
        tidy(axis)
    grid[0].set_yticks(rows, found.sample_names)
    grid[0].invert_yaxis()
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


def new_sample_forces(found: PopulationSummary, forces: Array) -> Figure:
    """Forces (n, n_step) of the samples, N, over what is predicted of a new one."""
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axis = figure.subplots()
    travel = np.array(found.travel)
    low = np.array([spread.hdi_low for spread in found.force_new])
    high = np.array([spread.hdi_high for spread in found.force_new])
    mean = np.array([spread.mean for spread in found.force_new])
    # relative, since the band of a stiff force curve would hide all that differs
    axis.fill_between(travel, low / mean, high / mean, color=COLOURS[0], alpha=0.2, lw=0,
                      label=f"a new sample, {SHARE}")  # fmt: skip
    axis.plot(travel, (forces / mean).T, "-", color=INK, lw=0.7, alpha=0.7)
    axis.plot([], [], "-", color=INK, lw=0.7, label="samples")
    axis.set(xlabel="pin travel [mm]", ylabel="force over the predictive mean [-]")
    axis.set_xticks(travel)
    tidy(axis)
    figure.legend(loc="outside upper center", ncols=2)
    return figure
