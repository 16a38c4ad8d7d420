"""Stage `prior`: what the priors say of the forces before the data have been looked at.

Draws of the prior go through the first emulator, with every error that the likelihood knows; the
error of the mesh, not measured yet, is nominal. A prior under which the data are impossible is
found here, before anything is sampled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calib.data import Dataset
from calib.inference.forward import EmulatorForward
from calib.inference.likelihood import build_likelihood
from calib.inference.prediction import predictive_forces
from calib.plot_scales import plain_log
from calib.study.artifacts import write_json
from calib.study.context import Context, stream
from calib.study.data_stage import load_data
from calib.study.figure_style import COLOURS, INK, save_png, tidy
from calib.study.posterior_setup import noise_of, sizes_of
from calib.study.sections import Hypothesis
from calib.study.tables import Table, number
from calib.study.train_stage import FIRST, load_emulator
from calib.study.unknowns import prior_of
from fe.response import Array
from surrogate import ScaledEmulator

N_DRAWS = 4000
NOMINAL_FORCE_ERROR = 0.02
"""relative error that stands in for the mesh's"""
LEVELS = (0.03, 0.25, 0.5, 0.75, 0.97)
"""quantiles that are kept: of the median, and of what holds 50 % and 94 %"""
FACTS = "prior_predictive.json"
FIGURE = Path("prior") / "prior_predictive.png"


def run(context: Context) -> list[Path]:
    """Write quantiles and figure of the prior predictive forces; returns their paths."""
    dataset = load_data(context.out).dataset
    found = {h.name: _described(context, h, dataset) for h in context.study.hypotheses}
    for name, facts in found.items():
        for sentence in _surprises(name, facts):
            context.echo(f"  {sentence}")
    write_json(context.out / FACTS, found)
    save_png(figure_of(dataset, found), context.out / FIGURE)
    return [context.out / FACTS, context.out / FIGURE]


def _described(context: Context, hypothesis: Hypothesis, dataset: Dataset) -> dict[str, Any]:
    force = prior_predictive(context, hypothesis, dataset, N_DRAWS)
    below = np.mean(force < dataset.force_mean, axis=0)
    return {
        "travel": dataset.travel,
        "levels": LEVELS,
        "quantiles": np.quantile(force, LEVELS, axis=0),
        "share_below_data": below,
        "units": {"travel": "mm", "quantiles": "N"},
    }


def prior_predictive(context: Context, hypothesis: Hypothesis, dataset: Dataset, n: int) -> Array:
    """(n, n_step) replicates of the measured mean force for draws of the prior, N."""
    study, forces = context.study, replace(dataset, field=None)
    prior = prior_of(study, hypothesis, with_field=False)
    emulator = ScaledEmulator(load_emulator(context.out / FIRST, hypothesis))
    likelihood = build_likelihood(
        forces,
        EmulatorForward(emulator),
        noise_of(study),
        force_discretisation=NOMINAL_FORCE_ERROR,
        unknown=sizes_of(prior),
    )
    rng = stream(study, f"prior predictive {hypothesis.name}")
    return predictive_forces(likelihood, prior.sample(rng, n), rng)


def _surprises(name: str, facts: Mapping[str, Any]) -> list[str]:
    """Increments at which the data lie outside all but 1 in 1000 draws of the prior."""
    below = np.asarray(facts["share_below_data"])
    out = np.asarray(facts["travel"])[(below < 5e-4) | (below > 1 - 5e-4)]
    if not out.size:
        return []
    places = ", ".join(f"{travel:g}" for travel in out)
    return [f"{name}: the prior leaves the force at {places} mm almost no probability"]


def figure_of(dataset: Dataset, found: Mapping[str, Any]) -> Figure:
    """Bands of the prior predictive forces beside the measured means, a panel a hypothesis."""
    kind = "synthetic data" if dataset.synthetic else "data"
    lows = np.concatenate([facts["quantiles"][0] for facts in found.values()])
    smallest, most = float(dataset.force_mean.min()), 1.0
    if (lows > 0.0).any():
        most = float(lows[lows > 0.0].min()) / smallest
    least = smallest * float(np.clip(0.8 * most, 0.01, 0.1))  # two powers of ten are enough to see
    figure = Figure(figsize=(max(5.0, 4.2 * len(found)), 4.2), layout="constrained")
    axes = figure.subplots(1, len(found), squeeze=False, sharey=True)[0]
    for order, (axis, (name, facts)) in enumerate(zip(axes, found.items(), strict=True)):
        colour = COLOURS[order % len(COLOURS)]
        low, quarter, middle, three, high = np.asarray(facts["quantiles"])
        # A force below zero is noise of a very soft draw: its band runs out of a logarithmic axis.
        for bottom, top, alpha, label in (
            (low, high, 0.18, "94 % of the draws"),
            (quarter, three, 0.32, "50 % of the draws"),
        ):
            edges = np.maximum(bottom, 0.1 * least), np.maximum(top, 0.1 * least)
            axis.fill_between(dataset.travel, *edges, color=colour, alpha=alpha, lw=0)
            # In no hypothesis' colour, since all have one.
            axis.fill_between([], [], color=INK, alpha=alpha, lw=0, label=label)
        axis.plot(dataset.travel, np.maximum(middle, 0.1 * least), color=colour)
        axis.plot([], [], color=INK, label="median")
        axis.errorbar(
            dataset.travel,
            dataset.force_mean,
            dataset.force_sd,
            fmt="o",
            ms=4,
            color=INK,
            label=f"{kind}, SD between samples",
        )
        axis.set_title(f"prior of {name}", fontsize=10)
        axis.set_xlabel("pin travel [mm]")
        axis.set_xticks(dataset.travel)
        tidy(axis)
    axes[0].set_ylim(bottom=least)
    axes[0].set_ylabel("force of the whole sample [N], log scale")
    plain_log(axes[0].yaxis)
    handles, _ = axes[0].get_legend_handles_labels()
    figure.legend(handles=handles, loc="outside upper center", ncols=2, fontsize=9)
    return figure


def prior_table(found: Mapping[str, Any]) -> Table:
    """Where the data lie in what the prior expects; `found` is prior_predictive.json."""
    rows = []
    for name, facts in found.items():
        low, *_, high = facts["quantiles"]
        bands = zip(low, high, strict=True)
        rows.append((f"{name}, 94 % [N]", *(f"{number(a, 3)} to {number(b, 3)}" for a, b in bands)))
        rows.append((f"{name}, share below data", *(f"{v:.3f}" for v in facts["share_below_data"])))
    first = next(iter(found.values()))
    return Table(
        "Prior predictive: forces expected before the data were looked at",
        ("hypothesis", *(f"{travel:g} mm" for travel in first["travel"])),
        tuple(rows),
        "A share near 0 or 1 at any increment says that prior or model leave the data almost no "
        "room.",
    )
