"""Figures of forces: measured and predicted, and the emulator's error on runs held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from calib.plot_scales import plain_log
from calib.study.figure_style import (
    COLOURS,
    INK,
    INTERVAL,
    LINES,
    MARKERS,
    MUTED,
    SHARE,
    Array,
    tidy,
)


@dataclass(frozen=True)
class MeasuredForce:
    """Forces that the posterior is conditioned on."""

    label: str
    """legend text; says "synthetic" when they are"""
    travel: Array
    """(n_step,) mm"""
    mean: Array
    """(n_step,) N"""
    sd: Array
    """(n_step,) standard deviation between samples, N"""
    n_samples: int

    def __post_init__(self) -> None:
        if not self.travel.shape == self.mean.shape == self.sd.shape:
            raise ValueError(
                f"travel, mean, sd: expected one shape, found {self.travel.shape}, "
                f"{self.mean.shape}, {self.sd.shape}"
            )


@dataclass(frozen=True)
class PredictedForce:
    """Forces predicted under one hypothesis."""

    name: str
    predictive: Array
    """(n_draw, n_step) posterior predictive draws of the mean force, N"""
    published: Array | None
    """(n_step,) force predicted by the published constants, N"""


@dataclass(frozen=True)
class EmulatorErrors:
    """Errors of one emulator on runs it was not trained on."""

    name: str
    relative_force: Array
    """(n_run, n_step) emulator over FE minus one"""
    standardised: Array
    """(n_run, n_step) residual over the standard deviation that the emulator states"""
    tolerance: float
    """largest relative error accepted"""


def force_travel(measured: MeasuredForce, predicted: Sequence[PredictedForce]) -> Figure:
    """Measured and predicted force, their deviation, and what the published constants predict.

    The last only where there are published constants.
    """
    published = any(force.published is not None for force in predicted)
    figure = Figure(figsize=(10.5, 5.6 if published else 4.4), layout="constrained")
    axes = figure.subplot_mosaic("fd\nfp" if published else "fd")
    _draw_forces(axes["f"], measured, predicted)
    _draw_deviation(axes["d"], measured, predicted)
    if published:
        _draw_published(axes["p"], measured, predicted)
    for axis in axes.values():
        axis.set_xlabel("pin travel [mm]")
        axis.set_xticks(measured.travel)
        axis.xaxis.set_minor_locator(NullLocator())
        tidy(axis)
    return figure


def emulator_errors(errors: Sequence[EmulatorErrors], travel: Array) -> Figure:
    """Relative force error and standardised residual on runs that were held out."""
    figure = Figure(figsize=(9.5, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    spread = 0.02 * (travel[-1] - travel[0] if travel.size > 1 else 1.0)
    worst = 0.0
    for order, error in enumerate(errors):
        colour, marker = COLOURS[order % len(COLOURS)], MARKERS[order % len(MARKERS)]
        x = np.broadcast_to(
            travel + spread * (2 * order - len(errors) + 1), error.standardised.shape
        )
        percent = 100 * error.relative_force
        worst = max(worst, float(np.max(np.abs(percent), initial=0.0)))
        style = {"ls": "", "marker": marker, "color": colour, "ms": 5, "alpha": 0.75}
        left.plot(x.ravel(), percent.ravel(), label=error.name, **style)
        right.plot(x.ravel(), error.standardised.ravel(), **style)
    tolerance = 100 * max(error.tolerance for error in errors)
    # A tolerance far beyond the errors would flatten them to a line: it is then named, not drawn.
    if tolerance < 6 * worst:
        left.axhspan(-tolerance, tolerance, color=MUTED, alpha=0.15, lw=0)
    left.set_title(f"runs held out, accepted: ±{tolerance:.3g} %", fontsize=10)
    left.set_ylabel("emulator force error [%]")
    right.axhspan(-2, 2, color=MUTED, alpha=0.15, lw=0)
    right.set_title("95 % belong within the band of ±2", fontsize=10)
    right.set_ylabel("error / SD stated by the emulator [-]")
    for axis in (left, right):
        axis.axhline(0, color=MUTED, lw=0.8)
        axis.set_xticks(travel)
        axis.set_xlabel("pin travel [mm]")
        tidy(axis)
        if not any(error.relative_force.size for error in errors):
            axis.text(0.5, 0.6, "no run was held out", transform=axis.transAxes, ha="center")
    # Beside the points: which corner is free differs from study to study.
    figure.legend(loc="outside upper center", ncols=4)
    return figure


def _draw_forces(axis: Axes, measured: MeasuredForce, predicted: Sequence[PredictedForce]) -> None:
    for order, force in enumerate(predicted):
        low, middle, high = _band(force.predictive)
        colour = COLOURS[order % len(COLOURS)]
        axis.fill_between(measured.travel, low, high, color=colour, alpha=0.25, lw=0)
        axis.plot(
            measured.travel,
            middle,
            color=colour,
            ls=LINES[order % len(LINES)],
            label=f"{force.name}: predictive median, {SHARE} band",
        )
    _draw_measured(axis, measured, measured.mean, measured.sd)
    axis.set_ylim(bottom=0)
    axis.set_ylabel("force of the whole sample [N]")
    axis.legend(loc="upper left")


def _draw_deviation(
    axis: Axes, measured: MeasuredForce, predicted: Sequence[PredictedForce]
) -> None:
    spread = 100 * measured.sd / measured.mean
    furthest = []
    for order, force in enumerate(predicted):
        low, middle, high = (100 * (f / measured.mean - 1) for f in _band(force.predictive))
        furthest.append(float(np.max(np.abs([low, high]))))
        colour = COLOURS[order % len(COLOURS)]
        axis.fill_between(measured.travel, low, high, color=colour, alpha=0.25, lw=0)
        axis.plot(measured.travel, middle, color=colour, ls=LINES[order % len(LINES)])
    _draw_measured(axis, measured, np.zeros_like(measured.mean), spread)
    # A hypothesis far off would flatten the others; it is seen in full in the panel of forces.
    seen = max(float(spread.max()), min(furthest))
    limit = 1.15 * (max(furthest) if seen <= max(furthest) < 2 * seen else seen)
    axis.set_ylim(-limit, limit)
    axis.axhline(0, color=MUTED, lw=0.8)
    axis.set_ylabel(f"off the {measured.label} mean [%]")
    beyond = [
        force.name for force, far in zip(predicted, furthest, strict=True) if far > 1.001 * limit
    ]
    if beyond:
        axis.set_title(f"goes beyond this panel: {', '.join(beyond)}", fontsize=9)


def _draw_published(
    axis: Axes, measured: MeasuredForce, predicted: Sequence[PredictedForce]
) -> None:
    _draw_measured(axis, measured, measured.mean, measured.sd)
    for order, force in enumerate(predicted):
        if force.published is None:
            continue
        axis.plot(
            measured.travel,
            force.published,
            color=COLOURS[order % len(COLOURS)],
            ls=LINES[order % len(LINES)],
            marker=MARKERS[order % len(MARKERS)],
            ms=5,
            label=f"published constants, {force.name}",
        )
    axis.set_yscale("log")
    axis.set_ylabel("force [N], log scale")
    handles, labels = axis.get_legend_handles_labels()
    kept = [i for i, label in enumerate(labels) if label.startswith("published")]
    low, high = axis.get_ylim()
    axis.set_ylim(low, high * (high / low) ** 0.45)
    plain_log(axis.yaxis)
    axis.legend([handles[i] for i in kept], [labels[i] for i in kept], loc="upper left")


def _draw_measured(axis: Axes, measured: MeasuredForce, centre: Array, sd: Array) -> None:
    """Between-sample SD as thin bars, standard error of the mean as thick ones."""
    error = sd / np.sqrt(measured.n_samples)
    axis.errorbar(
        measured.travel,
        centre,
        yerr=sd,
        fmt="none",
        ecolor=INK,
        elinewidth=0.8,
        capsize=4,
        label="SD between samples",
    )
    axis.errorbar(
        measured.travel,
        centre,
        yerr=error,
        fmt="o",
        ms=4,
        color=INK,
        elinewidth=2.6,
        label=f"{measured.label}: mean of {measured.n_samples}, standard error",
    )


def _band(draws: Array) -> tuple[Array, Array, Array]:
    """Equal-tailed band and median over draws (n_draw, n_step)."""
    tail = (1 - INTERVAL) / 2
    low, middle, high = np.quantile(draws, [tail, 0.5, 1 - tail], axis=0)
    return low, middle, high
