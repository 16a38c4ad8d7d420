"""Figures of an experiment's analysis, one function each (thesis, Figures 5.1 to 5.5)."""

from __future__ import annotations

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from calib.data.qc.pipeline import QcResult
from calib.data.qc.statistics import box
from fe.response import Array

COLOURS = tuple(style.library["tableau-colorblind10"]["axes.prop_cycle"].by_key()["color"])
GREY = "#777777"


def all_figures(result: QcResult) -> dict[str, Figure]:
    """Figures by the names of their files; those of a data set only where there is one."""
    figures = {"placement": placement_figure(result), "machine": machine_figure(result)}
    if any(sample.machine and sample.machine.cycles for sample in result.samples):
        figures["cycles"] = cycles_figure(result)
    if result.dataset is not None:
        figures |= {
            "forces": forces_figure(result),
            "boxes": boxes_figure(result),
            "field": field_figure(result),
            "noise": noise_figure(result),
        }
    return figures


def _new(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def placement_figure(result: QcResult) -> Figure:
    """Angle and x-shift of every sample, with the limits."""
    figure = _new(6.0, 4.6)
    axis = figure.subplots()
    quality = result.experiment.quality
    for sample, kept in zip(result.samples, result.kept, strict=True):
        if sample.face is None:
            continue
        at = sample.face.placement
        colour, marker = (COLOURS[0], "o") if kept else (COLOURS[1], "x")
        axis.plot(at.x_shift, at.angle_deg, marker, color=colour)
        axis.annotate(
            sample.name,
            (at.x_shift, at.angle_deg),
            fontsize=7,
            xytext=(3, 3),
            textcoords="offset points",
        )
    for sign in (-1, 1):
        axis.axvline(sign * quality.max_x_shift_mm, color=GREY, ls=":")
        axis.axhline(sign * quality.max_angle_deg, color=GREY, ls=":")
    axis.set(xlabel="x-shift [mm]", ylabel="angular deviation [degrees]")
    _title(axis, result, "kept: dots, rejected: crosses; dotted: limits")
    return figure


def machine_figure(result: QcResult) -> Figure:
    """Travel and force over time of every sample (Figures 5.2 and 5.3)."""
    figure = _new(8.0, 5.6)
    top, bottom = figure.subplots(2, 1, sharex=True)
    for sample, kept in zip(result.samples, result.kept, strict=True):
        test = sample.machine
        if test is None:
            continue
        every = max(test.time.size // 3000, 1)
        look = {"color": COLOURS[0] if kept else COLOURS[1], "lw": 0.5, "alpha": 0.6}
        top.plot(test.time[::every], test.travel[::every], **look)
        bottom.plot(test.time[::every], test.force[::every], **look)
        for hold, plateau in zip(test.holds, test.plateaus, strict=True):
            bottom.plot([hold.start, hold.end], [plateau.force] * 2, color="black", lw=0.8)
    top.set_ylabel("travel from contact [mm]")
    bottom.set(xlabel="time [s]", ylabel="force [N]")
    _title(top, result, "kept: blue, rejected: orange; black: force of a hold")
    return figure


def cycles_figure(result: QcResult) -> Figure:
    """Peak force over preconditioning cycles, by that of the last, with its SD (Figure 5.1)."""
    figure = _new(6.0, 4.0)
    axis = figure.subplots()
    n = len(result.samples)
    for order, (sample, kept) in enumerate(zip(result.samples, result.kept, strict=True)):
        cycles = sample.machine.cycles if sample.machine else ()
        if cycles:
            peaks = np.array([cycle.peak_force for cycle in cycles])
            sds = np.array([cycle.peak_sd for cycle in cycles]) / peaks[-1]
            # Side by side: bars of many samples at one place are one bar.
            number = np.arange(1, peaks.size + 1) + 0.4 * (order - 0.5 * (n - 1)) / n
            look = {"color": COLOURS[0] if kept else COLOURS[1], "alpha": 0.7}
            axis.errorbar(number, peaks / peaks[-1], sds, fmt="o-", ms=3, lw=0.7, **look)
    axis.axhspan(0.99, 1.01, color=GREY, alpha=0.2, lw=0)
    axis.set(xlabel="cycle", ylabel="peak force over that of the last cycle [-]")
    axis.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    _title(axis, result, "kept: blue, rejected: orange; bars: SD; grey: within 1 %")
    return figure


def forces_figure(result: QcResult) -> Figure:
    """Force over travel of the kept samples, mean, one and two SDs (Figure 5.5)."""
    dataset = result.dataset
    assert dataset is not None
    figure = _new(6.0, 4.6)
    axis = figure.subplots()
    mean, sd = dataset.force_mean, dataset.force_sd
    for n, alpha in ((2, 0.15), (1, 0.3)):
        label = f"{n} SD"
        axis.fill_between(
            dataset.travel,
            mean - n * sd,
            mean + n * sd,
            color=COLOURS[0],
            alpha=alpha,
            lw=0,
            label=label,
        )
    for sample, kept in zip(result.samples, result.kept, strict=True):
        if kept and sample.machine is not None:
            _, travel, force = sample.machine.loaded()
            axis.plot(travel, force, ".", color=GREY, ms=3)
    axis.plot([], [], ".", color=GREY, ms=3, label="samples")
    axis.plot(dataset.travel, mean, "k-o", ms=4, label=f"mean of {dataset.n_samples}")
    axis.set(xlabel="travel [mm]", ylabel="force of the whole sample [N]")
    axis.set_ylim(0, float((mean + 3 * sd).max()))
    axis.set_xlim(0.8 * dataset.travel[0], 1.05 * dataset.travel[-1])
    axis.legend(loc="upper left")
    _title(axis, result, "kept samples, bands about their mean")
    return figure


def boxes_figure(result: QcResult) -> Figure:
    """Box plots of travel and force at each increment, of all samples (Figure 5.4)."""
    figure = _new(8.0, 4.0)
    left, right = figure.subplots(1, 2)
    protocol = result.experiment.protocol
    travel: dict[int, list[float]] = {}
    force: dict[int, list[float]] = {}
    for sample in result.samples:
        if sample.machine is None:
            continue
        for number, place, value in zip(*sample.machine.loaded(), strict=True):
            off = 1e3 * float(place - number * protocol.increment_mm)
            travel.setdefault(int(number), []).append(off)
            force.setdefault(int(number), []).append(float(value))
    _boxes(left, travel, "travel less its nominal [µm]")
    _boxes(right, force, "force of the whole sample [N]")
    right.set_ylim(bottom=0)
    _title(left, result, "all samples; boxes: quartiles and median")
    right.set_title("whiskers: within 1.5 boxes; circles: beyond", fontsize=10)
    return figure


def _boxes(axis: Axes, values: dict[int, list[float]], label: str) -> None:
    numbers = sorted(values)
    stats = []
    for number in numbers:
        here = np.array(values[number])
        low, q1, median, q3, high = box(here)
        fliers = here[(here < low) | (here > high)]
        stats.append(
            {"med": median, "q1": q1, "q3": q3, "whislo": low, "whishi": high, "fliers": fliers}
        )
    axis.bxp(
        stats, positions=numbers, flierprops={"ms": 3}, medianprops={"color": COLOURS[1], "lw": 1.5}
    )
    axis.set(xlabel="increment", ylabel=label)


def field_figure(result: QcResult) -> Figure:
    """Mean field at the last increment used, and what its error is beside noise."""
    dataset = result.dataset
    assert dataset is not None and dataset.field is not None
    field = dataset.field
    figure = _new(10.0, 3.6)
    axes = figure.subplots(2, 3, sharex=True, sharey=True)
    patterns = field.patterns
    spread = (
        np.zeros_like(field.displacement)
        if patterns is None
        else np.sqrt((patterns**2).sum(axis=0))
    )
    error = np.sqrt(spread**2 + field.noise_std**2)
    for column, name in enumerate("xyz"):
        _points(
            figure,
            axes[0, column],
            field.points,
            field.displacement[-1, :, column],
            f"$u_{name}$ [mm]",
        )
        _points(
            figure,
            axes[1, column],
            field.points,
            1e3 * error[-1, :, column],
            f"SD of mean $u_{name}$ [µm]",
            1e3 * float(error[-1].max()),
        )
    for axis in axes[1]:
        axis.set_xlabel("x [mm]")
    for axis in axes[:, 0]:
        axis.set_ylabel("y [mm]")
    kind = "synthetic, " if result.experiment.synthetic else ""
    figure.suptitle(
        f"{kind}travel {dataset.travel[-1]:.4g} mm, mean of {dataset.n_samples} samples",
        fontsize=10,
    )
    return figure


def _points(
    figure: Figure, axis: Axes, points: Array, values: Array, label: str, top: float | None = None
) -> None:
    """Values at the points; those that cannot be negative from 0 to `top`."""
    drawn = axis.scatter(points[:, 0], points[:, 1], c=values, s=12, marker="s", cmap="viridis")
    if top is not None:
        drawn.set_clim(0.0, top)
    axis.set_aspect("equal")
    axis.set_title(label, fontsize=9)
    figure.colorbar(drawn, ax=axis, shrink=0.8, ticks=MaxNLocator(4))


def _title(axis: Axes, result: QcResult, text: str) -> None:
    """What is seen, and whether a model made it."""
    axis.set_title(f"synthetic; {text}" if result.experiment.synthetic else text, fontsize=10)


def noise_figure(result: QcResult) -> Figure:
    """Correlation of the noise over the distance, measured and fitted."""
    noise = result.noise
    assert noise is not None
    figure = _new(6.0, 4.0)
    axis = figure.subplots()
    floors = (
        ("static frames, DIC points", noise.at_points),
        ("static frames, field", noise.static),
        ("samples, field", noise.repeats),
    )
    for index, (name, floor) in enumerate(floors):
        if floor is None:
            continue
        axis.plot(floor.distance, floor.correlation, "o", ms=3, color=COLOURS[index], label=name)
        nearest, furthest = float(floor.distance.min()), float(floor.distance.max())
        # Nearer than the nearest two points nothing was measured: there the fit is a guess.
        for start, end, line in ((nearest, furthest, "-"), (0.0, nearest, ":")):
            fine = np.linspace(start, end, 200)
            fitted = (1 - floor.nugget) * floor.correlation_at(fine)
            axis.plot(fine, fitted, line, color=COLOURS[index], lw=0.9)
    axis.axhline(0, color=GREY, lw=0.8)
    axis.set(xlabel="distance of two points [mm]", ylabel="correlation of their noise [-]")
    # The fit allows for the mean that was taken off every frame, which draws the dots down.
    _title(axis, result, "dots: less each frame's mean; lines: fitted, dotted: none so near")
    figure.legend(fontsize=8, loc="outside lower center", ncols=3)
    return figure
