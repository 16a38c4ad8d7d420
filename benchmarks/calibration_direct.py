"""The posterior by FE itself, at every node of a quadrature, beside that by emulator.

A few experiments, forces and field, on a coarse mesh; the emulator is refined at the posterior of
each as a study's is, with a second design in the posterior's box, and for the first one without,
too. A tensor Gauss-Legendre rule over (r, s) covers the emulator's posterior; at each node the mean
of the force at kappa = 1 MPa and the field come from a run, and ln kappa is integrated on a fine
even grid, for which no further run is needed.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_refined import Refined, experiment, refined
from benchmarks.direct_case import CONTACT, DirectCase, cases
from benchmarks.direct_rule import Moments, Rule
from calib.inference import (
    PARAMETERS,
    DirectForward,
    EmulatorForward,
    Posterior,
    emulator_map,
    refine_map,
)
from calib.inference.forward_errors import DirectWithErrors
from calib.inference.weighted_draws import WeightedDraws, draw_weighted
from calib.study.context import block_pin_model
from calib.study.simulations import StoredSimulate
from fe.response import Array


def figures(store: Path) -> dict[str, Any]:
    """Of all experiments the worst, by parameter, and each by itself."""
    each = [
        runs.kept(store / f"direct-{case.index}.json", partial(_figures, case))
        for case in cases(store, "direct")
    ]
    told: dict[str, Any] = {
        f"emulator_vs_fe_{name}": _worst([one[name] for one in each], about)
        for name, about in (("mean_sd", 0.0), ("sd_ratio", 1.0))
    }
    return told | {
        "emulator_vs_fe_contact": CONTACT,
        "emulator_vs_fe_cells": list(runs.COARSE_CELLS),
        "emulator_vs_fe_experiments": each,
        "map_difference_sd": _worst([one["map_difference_sd"] for one in each], 0.0),
        "map_fe_solves": max(one["map_fe_solves"] for one in each),
        "map_status": sorted({one["map_status"] for one in each}),
    }


def _worst(each: list[dict[str, float]], about: float) -> dict[str, float]:
    """By parameter the value furthest from `about`."""
    return {
        name: max((one[name] for one in each), key=lambda value: abs(value - about))
        for name in PARAMETERS
    }


def _figures(case: DirectCase) -> dict[str, Any]:
    """Means and SDs of the posteriors on the same nodes, and the distance of two maxima."""
    found = by_study(case, runs.study().design.n_local)
    draws = _draws(found.posterior)
    rule = case.rule(draws.mean, draws.sd)
    by_fe = rule.moments(found.posterior.with_forward(rule.exact))
    off = rule.moments(found.posterior).mean - draws.mean
    told: dict[str, Any] = {
        "ratios": case.truth.tolist(),
        "n_fe_nodes": len(rule.nodes),
        "fe_sd": _named(by_fe.sd),
        "fe_error_sd": _named(by_fe.error / by_fe.sd),
        "rule_against_draws_sd": _named(off / draws.sd),
    }
    told |= _held(found, rule, by_fe) | _maxima(case, found.posterior, draws.sd)
    if not case.index:
        told["whole_box"] = _held(by_study(case, 0), rule, by_fe)
    return told


def rule_of(case: DirectCase, posterior: Posterior) -> Rule:
    """The nodes over a posterior by emulator, with FE at each."""
    draws = _draws(posterior)
    return case.rule(draws.mean, draws.sd)


def _draws(posterior: Posterior) -> WeightedDraws:
    return draw_weighted(posterior, np.random.default_rng(1), 16384)


def by_study(case: DirectCase, n_local: int) -> Refined:
    """The emulator of a case refined as a study's is, with so many runs in its second design."""
    return refined(
        case.first,
        lambda own: experiment(own, case.drawn, 0)[1],
        lambda ratios: case.solved(f"refine{n_local}", ratios),
        runs.study().design.n_refine,
        runs.SEED + 9,
        n_local,
    )


def _maxima(case: DirectCase, posterior: Posterior, sd: Array) -> dict[str, Any]:
    """The emulator's maximum refined by FE, as `calib map` does."""
    model = block_pin_model(runs.study(), runs.hypothesis(CONTACT), runs.COARSE_CELLS)
    refinement = case.store / case.folder(f"refine{runs.study().design.n_local}")
    parts = (case.store / f"coarse-{CONTACT}", refinement)
    simulate = StoredSimulate(model, case.store / case.folder("map"), parts)
    start = emulator_map(posterior, sd, np.random.default_rng(2))
    assert isinstance(posterior.likelihood.forward, EmulatorForward)
    found = refine_map(posterior, DirectForward(simulate, with_field=True), start, sd)
    return {
        "map_difference_sd": _named(found.difference_sd),
        "map_fe_solves": found.n_solves,
        "map_status": str(found.status),
    }


def _held(found: Refined, rule: Rule, by_fe: Moments) -> dict[str, Any]:
    """A posterior by emulator beside that by FE, and what was foretold of their distance."""
    return {
        "n_added": len(found.loop.ratios),
        "n_training": found.emulator.header.n_train,
        "predicted_shift_sd": found.shift,
        "foretold_shift_sd": found.foretold,
        "stated_sd_ratio": found.sd_ratio,
    } | _held_to_fe(rule, found.posterior, by_fe)


def _held_to_fe(rule: Rule, posterior: Posterior, by_fe: Moments) -> dict[str, Any]:
    """A posterior by emulator beside that by FE, and by FE with the emulator's errors."""
    own = rule.moments(posterior)
    errors = DirectWithErrors(rule.exact, posterior.likelihood.forward)
    told: dict[str, Any] = {}
    for suffix, other in (
        ("", by_fe),
        ("_same_errors", rule.moments(posterior.with_forward(errors))),
    ):
        told[f"mean_sd{suffix}"] = _named((own.mean - other.mean) / other.sd)
        told[f"sd_ratio{suffix}"] = _named(own.sd / other.sd)
    return told


def _named(values: Array) -> dict[str, float]:
    return dict(zip(PARAMETERS, values.tolist(), strict=True))
