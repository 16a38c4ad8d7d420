"""`calib evidence`: hypotheses by evidence, leave-one-out and stacking, each with its error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from calib.inference.leave_out import (
    Block,
    Difference,
    Scores,
    Stacking,
    Wider,
    differences,
    increment_blocks,
    leave_out,
    refitted,
    stacking,
    wider_blocks,
)
from calib.inference.nested import nested
from calib.inference.posterior import Posterior
from calib.inference.quadrature import Quadrature, integrate
from calib.study.answers import keep_answer
from calib.study.artifacts import write_json
from calib.study.context import stream
from calib.study.data_stage import load_data
from calib.study.figure_style import COLOURS, INK, save_png, tidy
from calib.study.finished import finished, posteriors
from calib.study.local_design import MOST_CUT, kept_box, mass_beyond
from calib.study.posterior_setup import emulator_posterior
from calib.study.sample_stage import load_samples
from calib.study.tables import Table
from calib.study.unknowns import design_box
from fe.progress_bar import told_one_by_one
from fe.response import Array

FILE = "evidence.json"
FIGURE = "evidence.png"
N_DRAWS = 4000
N_LIVE = 250
MORE = 4
"""times as many live points, where nested sampling and the integral differ"""


@dataclass(frozen=True)
class Standing:
    """How one hypothesis stands, every number with its error."""

    name: str
    integral: tuple[float, float]
    """ln evidence and its error by `method`"""
    method: str
    """quadrature, or importance sampling with many unknowns"""
    nested: tuple[float, float]
    """ln evidence by nested sampling and its SD"""
    increments: Scores
    blocks: Scores | None
    """None where no wider block is to be had"""

    @property
    def log_evidence(self) -> tuple[float, float]:
        """The more exact of the two."""
        return self.integral


@dataclass(frozen=True)
class Ranking:
    """All hypotheses against each other."""

    standings: tuple[Standing, ...]
    """best evidence first"""
    differences: tuple[Difference, ...]
    """of the scores by increment to the best of them, in the same order"""
    stacking: Stacking


def stand(
    name: str,
    posterior: Posterior,
    draws: Array,
    travel: Array,
    rng: np.random.Generator,
    wider: Wider | None = None,
    time: float = 1.0,
) -> Standing:
    """Evidence and scores of one hypothesis from its posterior and equally probable draws.

    `wider` is as in `refitted`; `time` is how many steps of a walker are worth one independent draw
    (the longest autocorrelation time).
    """
    found = integrate(posterior)
    exact = (found.log_evidence, found.log_evidence_error)
    by_nested = nested(posterior, rng, n_live=N_LIVE)
    # dynesty's bound misses some of a posterior now and then, and its error with it.
    if off_by(exact, (by_nested.log_evidence, by_nested.log_evidence_error)) > 0.0:
        by_nested = nested(posterior, rng, n_live=MORE * N_LIVE)
    few = draws[rng.choice(len(draws), min(N_DRAWS, len(draws)), replace=False)]
    likelihood = posterior.likelihood
    # The variance of all draws' mean, and what taking some of them at random adds to it.
    worth = 1.0 / (time / len(draws) + 1.0 / len(few) - 1.0 / len(draws))

    def scored(blocks: tuple[Block, ...]) -> Scores:
        return refitted(posterior, leave_out(likelihood, few, blocks, worth), blocks, wider)

    wide = wider_blocks(likelihood, travel)
    return Standing(
        name,
        exact,
        found.method,
        (by_nested.log_evidence, by_nested.log_evidence_error),
        scored(increment_blocks(travel)),
        scored(wide) if wide else None,
    )


def rank(standings: list[Standing], rng: np.random.Generator) -> Ranking:
    """Order by evidence, difference of scores, stacking weights."""
    ordered = tuple(sorted(standings, key=lambda found: -found.log_evidence[0]))
    scores = tuple(found.increments for found in ordered)
    return Ranking(ordered, differences(scores), stacking(scores, rng))


def evidence(out: Path) -> tuple[list[str], list[Path]]:
    """Rank the hypotheses of a finished study; returns the lines to print and the files.

    Raises ValueError where the folder holds no finished study.
    """
    context = finished(out)
    travel = load_data(out).dataset.travel
    standings = []
    by_name: Mapping[str, Posterior] = posteriors(context)
    for hypothesis in told_one_by_one("evidence", context.study.hypotheses):
        name = hypothesis.name
        # What was sampled, and beyond its box, where it has one, the emulator of the prior's.
        sampled, wider = by_name[name], None
        if (box := kept_box(out, hypothesis)) is not None:
            wider = Wider(sampled, _reached(box, design_box(context.study, hypothesis)))
            sampled = emulator_posterior(context, hypothesis)
        result = load_samples(out, hypothesis).result
        rng = stream(context.study, f"evidence {name}")
        time = float(np.max(result.autocorrelation_time))
        standings.append(stand(name, sampled, result.draws, travel, rng, wider, time))
    ranking = rank(standings, stream(context.study, "stacking"))
    write_json(out / FILE, facts(ranking))
    save_png(evidence_figure(ranking), out / "figures" / FIGURE)
    tables = (ranking_table(ranking), scores_table(ranking))
    keep_answer(context, "evidence", tables, out / "figures" / FIGURE, remarks(ranking))
    lines = []
    for table in tables:
        lines += [table.text(), ""]
    lines += [*remarks(ranking), ""]
    return lines, [out / FILE, out / "figures" / FIGURE]


def _reached(box: Array, design: Array) -> Callable[[Quadrature], bool]:
    """Whether a posterior reaches beyond a box (d, 2) within that of the design."""
    return lambda found: mass_beyond(found, box, design) > MOST_CUT


def facts(ranking: Ranking) -> dict[str, Any]:
    """The ranking as JSON data."""
    weights = ranking.stacking
    return {
        found.name: {
            "log_evidence": found.integral,
            "log_evidence_by": found.method,
            "log_evidence_nested": found.nested,
            "elpd_difference": (ranking.differences[i].mean, ranking.differences[i].error),
            "stacking_weight": (weights.weights[i], weights.low[i], weights.high[i]),
            "increments": _scores(found.increments),
            "blocks": None if found.blocks is None else _scores(found.blocks),
        }
        for i, found in enumerate(ranking.standings)
    }


def _scores(scores: Scores) -> dict[str, Any]:
    return {
        "names": scores.names,
        "log_density": scores.log_density,
        "monte_carlo_error": scores.error,
        "pareto_k": scores.pareto_k,
        "refit": scores.refit,
        "elpd": (scores.total, scores.total_error),
    }


def ranking_table(ranking: Ranking) -> Table:
    """Every number with its error."""
    rows = []
    weights = ranking.stacking
    best = ranking.standings[0].log_evidence
    for i, found in enumerate(ranking.standings):
        value, error = found.log_evidence
        factor = f"{best[0] - value:.2f} ± {np.hypot(best[1], error) if i else 0.0:.2f}"
        difference = ranking.differences[i]
        rows.append(
            (
                found.name,
                f"{_pair(found.integral)} ({found.method})",
                _pair(found.nested),
                factor,
                _pair((found.increments.total, found.increments.total_error)),
                f"{difference.mean:.2f} ± {difference.error:.2f}",
                f"{weights.weights[i]:.2f} [{weights.low[i]:.2f}, {weights.high[i]:.2f}]",
            )
        )
    return Table(
        "Hypotheses by evidence, leave-one-increment-out score and stacking weight",
        (
            "hypothesis",
            "ln evidence ± numerical",
            "nested sampling",
            "ln Bayes factor of the best",
            "elpd by increment",
            "difference",
            "stacking weight",
        ),
        tuple(rows),
        "± of evidences and Bayes factors: numerical, for the emulators and meshes at hand; other "
        "training runs and check meshes move them by more. elpd ± its SD over increments, which is "
        "rough with so few; weights with the 5 and 95 % quantiles of a Bayesian bootstrap over the "
        "increments. The evidence depends on the prior's box; scores hardly do.",
    )


def scores_table(ranking: Ranking) -> Table:
    """Ln predictive density of each block given the rest, with its error and Pareto k."""
    first = ranking.standings[0]
    names = first.increments.names + (() if first.blocks is None else first.blocks.names)
    rows = []
    for found in ranking.standings:
        parts = [found.increments] + ([] if found.blocks is None else [found.blocks])
        density = np.concatenate([part.log_density for part in parts])
        error = np.concatenate([part.error for part in parts])
        shape = np.concatenate([part.pareto_k for part in parts])
        anew = [flag for part in parts for flag in (part.refit or (False,) * len(part.names))]
        cells = [
            f"{d:.2f} ± {e:.2f} (k {k:.1f}{', anew' if again else ''})"
            for d, e, k, again in zip(density, error, shape, anew, strict=True)
        ]
        rows.append((found.name, *cells))
    return Table(
        "Left out: ln predictive density given all other data (PSIS)",
        ("hypothesis", *names),
        tuple(rows),
        "± numerical SD; k: Pareto shape. Above 0.7, of forces alone above 0.5, the posterior "
        "without the block lies too far from the draws, and the score was integrated anew without "
        "it (anew). Others of k from 0.5 on may be some of their SDs too high.",
    )


def off_by(first: tuple[float, float], second: tuple[float, float]) -> float:
    """By how much two values, each with its SD, differ beyond three times their errors."""
    return max(0.0, abs(first[0] - second[0]) - 3.0 * float(np.hypot(first[1], second[1])))


def remarks(ranking: Ranking) -> list[str]:
    """What may and may not be concluded."""
    said = []
    for found in ranking.standings:
        if (beyond := off_by(found.integral, found.nested)) > 0.0:
            off = abs(found.integral[0] - found.nested[0])
            said.append(
                f"{found.name}: {found.method} and nested sampling differ by {off:.2f}, more than "
                f"three times their errors ({off - beyond:.2f}): rely on neither."
            )
    undecided = [
        found.name
        for found, difference in zip(ranking.standings, ranking.differences, strict=True)
        if difference.mean + 2.0 * difference.error >= 0.0
    ]
    if len(undecided) > 1:
        said.append(
            "By prediction of increments left out the data do not separate "
            f"{', '.join(undecided)} (within two SDs of the difference)."
        )
    best = ranking.standings[0].name
    weights = dict(zip((f.name for f in ranking.standings), ranking.stacking.weights, strict=True))
    heaviest = max(weights, key=lambda name: weights[name])
    if heaviest != best:
        said.append(
            f"Evidence prefers {best}, prediction {heaviest}: the evidence counts the share of the "
            "prior's box that fits, prediction does not. Neither alone is a finding."
        )
    return said


def _pair(value: tuple[float, float]) -> str:
    return f"{value[0]:.2f} ± {value[1]:.2f}"


def evidence_figure(ranking: Ranking) -> Figure:
    """Evidence, score differences and stacking weights with their errors."""
    names = [found.name for found in ranking.standings]
    place = np.arange(len(names))[::-1]
    figure = Figure(figsize=(10.0, 1.6 + 0.4 * len(names)), layout="constrained")
    axes = figure.subplots(1, 3, sharey=True)
    value = np.array([found.log_evidence for found in ranking.standings])
    axes[0].errorbar(value[:, 0], place, xerr=value[:, 1], fmt="o", color=COLOURS[0], capsize=3)
    axes[0].set_xlabel("ln evidence (± its error)")
    off = np.array([(d.mean, d.error) for d in ranking.differences])
    axes[1].errorbar(off[:, 0], place, xerr=off[:, 1], fmt="s", color=COLOURS[1], capsize=3)
    axes[1].axvline(0.0, color=INK, lw=0.8, ls=":")
    axes[1].set_xlabel("elpd minus that of the best (± SD)")
    weights = ranking.stacking
    spread = np.maximum([weights.weights - weights.low, weights.high - weights.weights], 0.0)
    axes[2].errorbar(weights.weights, place, xerr=spread, fmt="^", color=COLOURS[2], capsize=3)
    axes[2].set_xlim(-0.03, 1.03)
    axes[2].set_xlabel("stacking weight (5 to 95 %)")
    axes[0].set_yticks(place, names)
    axes[0].set_ylim(-0.6, len(names) - 0.4)
    for axis in axes:
        axis.xaxis.set_major_locator(MaxNLocator(5))
        tidy(axis)
    return figure
