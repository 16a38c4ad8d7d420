"""The posterior by FE itself, at every node of a quadrature, beside that by emulator.

One experiment, forces and field, on a coarse mesh; the emulator is refined at its posterior as a
study's is, with a second design in the posterior's box, and without one. A tensor Gauss-Legendre
rule over (r, s) covers the emulator's posterior; at each node the mean of the force at kappa = 1
MPa and the field come from a run, and ln kappa is integrated on a fine even grid, for which no
further run is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import logsumexp

from benchmarks import calibration_runs as runs
from benchmarks.calibration_experiments import by_runs, likelihood_of, sbc_prior
from benchmarks.calibration_figures import points, trained
from benchmarks.calibration_refined import Refined, experiment, refined
from calib.inference import (
    PARAMETERS,
    DirectForward,
    EmulatorForward,
    Likelihood,
    Posterior,
    emulator_map,
    refine_map,
    theta_of,
)
from calib.inference.forward_errors import DirectWithErrors
from calib.inference.gaussian import log_density_along
from calib.inference.shared_error import marginal
from calib.inference.weighted_draws import draw_weighted
from calib.study.context import block_pin_model
from calib.study.simulations import StoredSimulate
from calib.study.training_runs import training_set
from fe.campaign_result import Campaign
from fe.response import Array

TRUTH = np.array([[0.4, 0.25]])
"""(r, s) of the experiment"""
CONTACT = "stuck"
"""hypothesis of the study"""
N_NODES = 9
"""in r and in s"""
WIDTH = 4.0
"""posterior SDs covered to each side"""
N_KAPPA = 61


def figures(store: Path) -> dict[str, Any]:
    """Means and SDs of the posteriors on the same nodes, and the distance of two maxima."""
    first = runs.coarse_design(store, CONTACT)
    started = likelihood_of(trained(store, training_set([first], gradients=True)), points())
    drawn = by_runs(started, sbc_prior(), _solved(store, "truth", TRUTH), 1, runs.SEED + 6)

    def by_study(n_local: int) -> Refined:
        return refined(
            first,
            lambda own: experiment(own, drawn, 0)[1],
            lambda ratios: _solved(store, f"refine-{n_local}", ratios),
            runs.study().design.n_refine,
            runs.SEED + 9,
            n_local,
        )

    whole, found = by_study(0), by_study(runs.study().design.n_local)
    posterior = found.posterior
    draws = draw_weighted(posterior, np.random.default_rng(1), 16384)
    box = _box(draws.mean[1:], draws.sd[1:], posterior.prior.bounds[1:])
    nodes, weights = _nodes(box)
    known = _solved(store, "nodes", nodes, runs.told("nodes"))
    ln_kappa = draws.mean[0] + draws.sd[0] * np.linspace(-8.0, 8.0, N_KAPPA)
    rule = _Rule(nodes, weights, ln_kappa, DirectForward(_Known(known), with_field=True))
    by_fe = rule.moments(posterior.with_forward(rule.exact))
    told: dict[str, Any] = {
        "emulator_vs_fe_contact": CONTACT,
        "emulator_vs_fe_n_runs": len(nodes),
        "emulator_vs_fe_sd": _named(by_fe[1]),
        "emulator_vs_fe_rule_against_draws_sd": _named(
            (rule.moments(posterior)[0] - draws.mean) / draws.sd
        ),
    }
    for name, each in (("", found), ("_whole", whole)):
        told[f"emulator_vs_fe_n_added{name}"] = len(each.loop.ratios)
        told[f"emulator_vs_fe_n_training{name}"] = each.emulator.header.n_train
        told[f"emulator_vs_fe_predicted_shift_sd{name}"] = each.shift
        told[f"emulator_vs_fe_foretold_shift_sd{name}"] = each.foretold
        told[f"emulator_vs_fe_stated_sd_ratio{name}"] = each.sd_ratio
        told |= rule.held_to_fe(each.posterior, by_fe, name)
    return told | _maxima(store, posterior, draws.sd)


def _solved(
    store: Path, part: str, ratios: Array, progress: runs.Progress | None = None
) -> Campaign:
    folder = f"coarse-{CONTACT}-{part}"
    return runs.solved(store, CONTACT, folder, ratios, runs.COARSE_CELLS, progress)


def _box(mean: Array, sd: Array, bounds: Array) -> Array:
    """(2, 2) range of (r, s) of so many SDs, cut off at the prior's bounds."""
    low, high = mean - WIDTH * sd, mean + WIDTH * sd
    return np.column_stack([np.maximum(low, bounds[:, 0]), np.minimum(high, bounds[:, 1])])


def _nodes(box: Array) -> tuple[Array, Array]:
    """(n^2, 2) nodes and weights of a box."""
    unit, weight = np.polynomial.legendre.leggauss(N_NODES)
    r, s = (low + (high - low) * 0.5 * (unit + 1.0) for low, high in box)
    nodes = np.stack(np.meshgrid(r, s, indexing="ij"), axis=-1).reshape(-1, 2)
    return nodes, np.outer(weight, weight).ravel()


@dataclass(frozen=True)
class _Rule:
    """Nodes at which FE runs are known."""

    nodes: Array
    weights: Array
    ln_kappa: Array
    exact: DirectForward

    def moments(self, posterior: Posterior) -> tuple[Array, Array]:
        """Posterior mean and SD of x by the rule; a run that ended early has no weight."""
        n, m = len(self.nodes), len(self.ln_kappa)
        x = np.empty((n, m, 3))
        x[:, :, 0], x[:, :, 1:] = self.ln_kappa, self.nodes[:, None]
        log_weight = [
            posterior.prior.log_prob(row) + _log_likelihood(posterior.likelihood, row) for row in x
        ]
        total = np.array(log_weight) + np.log(self.weights)[:, None]
        probability = np.exp(total - logsumexp(total))
        mean = np.einsum("nk,nki->i", probability, x)
        return mean, np.sqrt(np.einsum("nk,nki->i", probability, (x - mean) ** 2))

    def held_to_fe(
        self, posterior: Posterior, by_fe: tuple[Array, Array], name: str
    ) -> dict[str, Any]:
        """A posterior by emulator beside that by FE, and by FE with the emulator's errors."""
        mean, sd = self.moments(posterior)
        errors = DirectWithErrors(self.exact, posterior.likelihood.forward)
        told: dict[str, Any] = {}
        for suffix, other in (
            ("", by_fe),
            ("_same_errors", self.moments(posterior.with_forward(errors))),
        ):
            told[f"emulator_vs_fe_mean_sd{suffix}{name}"] = _named((mean - other[0]) / other[1])
            told[f"emulator_vs_fe_sd_ratio{suffix}{name}"] = _named(sd / other[1])
        return told


def _log_likelihood(likelihood: Likelihood, x: Array) -> Array:
    """(m,) of rows of x that share (r, s): the field, which does not know kappa, is seen once."""
    theta, errors = theta_of(x), likelihood.errors
    stated = likelihood.forward.predict(theta[:1])
    scale = theta[:, 0] / theta[0, 0]
    force = np.outer(stated.force[0], scale)
    covariance = None
    if stated.force_covariance is not None:
        covariance = scale[:, None, None] ** 2 * stated.force_covariance
    by_force = log_density_along(
        errors.covariance(force, covariance),
        likelihood.force[:, None] - force,
        errors.shifts(force),
    )
    basis = likelihood.forward.field_basis
    assert likelihood.field is not None and basis is not None
    by_field = likelihood.field.with_basis(basis).along(stated)
    return marginal([by_force, by_field])


class _Known:
    """Runs of a campaign, by their ratios."""

    def __init__(self, campaign: Campaign) -> None:
        self._runs = {
            row.tobytes(): run for row, run in zip(campaign.theta, campaign.responses, strict=True)
        }

    def __call__(self, ratios: Array) -> Any:
        return self._runs[np.ascontiguousarray(ratios).tobytes()]


def _maxima(store: Path, posterior: Posterior, sd: Array) -> dict[str, Any]:
    """The emulator's maximum refined by FE, as `calib map` does."""
    model = block_pin_model(runs.study(), runs.hypothesis(CONTACT), runs.COARSE_CELLS)
    parts = tuple(
        store / f"coarse-{CONTACT}{part}" for part in ("", f"-refine-{runs.study().design.n_local}")
    )
    simulate = StoredSimulate(model, store / f"coarse-{CONTACT}-map", parts)
    start = emulator_map(posterior, sd, np.random.default_rng(2))
    assert isinstance(posterior.likelihood.forward, EmulatorForward)
    found = refine_map(posterior, DirectForward(simulate, with_field=True), start, sd)
    return {
        "map_difference_sd": _named(found.difference_sd),
        "map_fe_solves": found.n_solves,
        "map_status": str(found.status),
    }


def _named(values: Array) -> dict[str, float]:
    return dict(zip(PARAMETERS, values.tolist(), strict=True))
