"""The posterior by FE itself, at every node of a quadrature, beside that by emulator.

One experiment, forces and field, on a coarse mesh; the emulator is refined at its posterior as a
study's is. A tensor Gauss-Legendre rule over (r, s) covers
the emulator's posterior; at each node the mean of the force at kappa = 1 MPa and the field come
from a run, and ln kappa is integrated on a fine even grid, for which no further run is needed.
"""

from __future__ import annotations

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
    ForwardModel,
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
MOST = 16
"""runs that refinement may add"""
N_NODES = 9
"""in r and in s"""
WIDTH = 4.0
"""posterior SDs covered to each side"""
N_KAPPA = 61


def figures(store: Path) -> dict[str, Any]:
    """Means and SDs of both posteriors on the same nodes, and the distance of the two maxima."""
    found = _refined(store)
    posterior = found.posterior
    draws = draw_weighted(posterior, np.random.default_rng(1), 16384)
    nodes, weights = _nodes(draws.mean[1:], draws.sd[1:], posterior.prior.bounds[1:])
    known = _solved(store, "nodes", nodes, runs.told("nodes"))
    ln_kappa = draws.mean[0] + draws.sd[0] * np.linspace(-8.0, 8.0, N_KAPPA)
    exact = DirectForward(_Known(known), with_field=True)
    models: dict[str, ForwardModel] = {
        "emulator": posterior.likelihood.forward,
        "fe": exact,
        "fe_with_emulator_errors": DirectWithErrors(exact, posterior.likelihood.forward),
    }
    moments = {
        name: _moments(posterior.with_forward(model), nodes, weights, ln_kappa)
        for name, model in models.items()
    }
    told: dict[str, Any] = {
        "emulator_vs_fe_contact": CONTACT,
        "emulator_vs_fe_n_runs": len(nodes),
        "emulator_vs_fe_n_training": found.emulator.header.n_train,
        "emulator_vs_fe_predicted_shift_sd": found.shift,
        "emulator_vs_fe_sd": _named(moments["fe"][1]),
    }
    for name, suffix in (("fe", ""), ("fe_with_emulator_errors", "_same_errors")):
        shift = (moments["emulator"][0] - moments[name][0]) / moments[name][1]
        ratio = moments["emulator"][1] / moments[name][1]
        told[f"emulator_vs_fe_mean_sd{suffix}"] = _named(shift)
        told[f"emulator_vs_fe_sd_ratio{suffix}"] = _named(ratio)
    told["emulator_vs_fe_rule_against_draws_sd"] = _named(
        (moments["emulator"][0] - draws.mean) / draws.sd
    )
    return told | _maxima(store, posterior, draws.sd)


def _refined(store: Path) -> Refined:
    """The study's first design on the coarse mesh, refined at the experiment's posterior."""
    first = runs.coarse_design(store, CONTACT)
    started = likelihood_of(trained(store, training_set([first], gradients=True)), points())
    truth = _solved(store, "truth", TRUTH)
    drawn = by_runs(started, sbc_prior(), truth, 1, runs.SEED + 6)

    return refined(
        first,
        lambda own: experiment(own, drawn, 0)[1],
        lambda ratios: _solved(store, "refine", ratios, runs.told("refine")),
        MOST,
        runs.SEED + 9,
    )


def _solved(
    store: Path, part: str, ratios: Array, progress: runs.Progress | None = None
) -> Campaign:
    folder = f"coarse-{CONTACT}-{part}"
    return runs.solved(store, CONTACT, folder, ratios, runs.COARSE_CELLS, progress)


def _nodes(mean: Array, sd: Array, bounds: Array) -> tuple[Array, Array]:
    """(n^2, 2) nodes and weights of a box of so many SDs, cut off at the prior's bounds."""
    unit, weight = np.polynomial.legendre.leggauss(N_NODES)
    low = np.maximum(mean - WIDTH * sd, bounds[:, 0])
    high = np.minimum(mean + WIDTH * sd, bounds[:, 1])
    r, s = (low[i] + (high[i] - low[i]) * 0.5 * (unit + 1.0) for i in range(2))
    nodes = np.stack(np.meshgrid(r, s, indexing="ij"), axis=-1).reshape(-1, 2)
    return nodes, np.outer(weight, weight).ravel()


def _moments(
    posterior: Posterior, nodes: Array, weights: Array, ln_kappa: Array
) -> tuple[Array, Array]:
    """Posterior mean and SD of x by the rule; a run that ended early has no weight."""
    log_weight = []
    for node in nodes:
        x = np.column_stack([ln_kappa, np.tile(node, (len(ln_kappa), 1))])
        log_weight.append(posterior.prior.log_prob(x) + _log_likelihood(posterior.likelihood, x))
    total = np.array(log_weight) + np.log(weights)[:, None]
    total -= logsumexp(total)
    probability = np.exp(total)
    x = np.concatenate(
        [
            np.broadcast_to(ln_kappa[None, :, None], (len(nodes), len(ln_kappa), 1)),
            np.broadcast_to(nodes[:, None], (len(nodes), len(ln_kappa), 2)),
        ],
        axis=2,
    )
    mean = np.einsum("nk,nki->i", probability, x)
    return mean, np.sqrt(np.einsum("nk,nki->i", probability, (x - mean) ** 2))


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
    parts = tuple(store / f"coarse-{CONTACT}{part}" for part in ("", "-refine"))
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
