"""The posterior by FE itself, at every node of a quadrature, beside that by emulator.

A few experiments, forces and field, on a coarse mesh; the emulator is refined at the posterior of
each as a study's is, with a second design in the posterior's box, and for the first one without,
too. A tensor Gauss-Legendre rule over (r, s) covers the emulator's posterior; at each node the mean
of the force at kappa = 1 MPa and the field come from a run, and ln kappa is integrated on a fine
even grid, for which no further run is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import logsumexp

from benchmarks import calibration_runs as runs
from benchmarks.calibration_experiments import Experiments, by_runs, likelihood_of, sbc_prior
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
from calib.inference.weighted_draws import WeightedDraws, draw_weighted
from calib.study.context import block_pin_model
from calib.study.simulations import StoredSimulate
from calib.study.training_runs import training_set
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import sobol_design

FIRST_TRUTH = (0.4, 0.25)
N_FURTHER = 3
"""experiments at other ratios"""
CONTACT = "stuck"
"""hypothesis of the study"""
N_NODES = 9
"""in r and in s"""
WIDTH = 4.0
"""posterior SDs covered to each side"""
N_KAPPA = 61
DEGREE = 4
"""of the polynomial of the nodes' ln density that counts as smooth"""


def truths() -> Array:
    """(1 + N_FURTHER, 2) ratios (r, s) of the experiments: one, and those of a Sobol sequence."""
    further = sobol_design(N_FURTHER, runs.prior().bounds[1:], runs.SEED, n_corners=0)
    return np.vstack([FIRST_TRUTH, further])


def figures(store: Path) -> dict[str, Any]:
    """Of all experiments the worst, by parameter, and each by itself."""
    each = []
    for index, truth in enumerate(truths()):
        each.append(_Case(store, index, truth).figures())
        print(f"  {truth}: {each[-1]}", flush=True)
    told: dict[str, Any] = {
        f"emulator_vs_fe_{name}": _worst([one[name] for one in each], about)
        for name, about in (("mean_sd", 0.0), ("sd_ratio", 1.0))
    }
    return told | {
        "emulator_vs_fe_contact": CONTACT,
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


@dataclass(frozen=True)
class _Case:
    """One experiment, its runs in folders of its own."""

    store: Path
    index: int
    truth: Array
    """(2,) (r, s)"""

    def figures(self) -> dict[str, Any]:
        """Means and SDs of the posteriors on the same nodes, and the distance of two maxima."""
        first = runs.coarse_design(self.store, CONTACT)
        known = trained(self.store, training_set([first], gradients=True))
        truth = self._solved("truth", self.truth[None])
        seed = runs.SEED + 6 + self.index
        drawn = by_runs(likelihood_of(known, points()), sbc_prior(), truth, 1, seed)
        found = self._by_study(first, drawn, runs.study().design.n_local)
        draws = draw_weighted(found.posterior, np.random.default_rng(1), 16384)
        rule = self._rule(found.posterior, draws)
        by_fe = rule.moments(found.posterior.with_forward(rule.exact))
        off = rule.moments(found.posterior).mean - draws.mean
        told: dict[str, Any] = {
            "ratios": self.truth.tolist(),
            "n_fe_nodes": len(rule.nodes),
            "fe_sd": _named(by_fe.sd),
            "fe_error_sd": _named(by_fe.error / by_fe.sd),
            "rule_against_draws_sd": _named(off / draws.sd),
        }
        told |= _held(found, rule, by_fe) | self._maxima(found.posterior, draws.sd)
        if not self.index:
            told["whole_box"] = _held(self._by_study(first, drawn, 0), rule, by_fe)
        return told

    def _by_study(self, first: Campaign, drawn: Experiments, n_local: int) -> Refined:
        return refined(
            first,
            lambda own: experiment(own, drawn, 0)[1],
            lambda ratios: self._solved(f"refine-{n_local}", ratios),
            runs.study().design.n_refine,
            runs.SEED + 9,
            n_local,
        )

    def _rule(self, posterior: Posterior, draws: WeightedDraws) -> _Rule:
        """FE runs at the nodes that cover a posterior."""
        nodes, weights = _nodes(_box(draws.mean[1:], draws.sd[1:], posterior.prior.bounds[1:]))
        known = self._solved("nodes", nodes, runs.told("nodes"))
        ln_kappa = draws.mean[0] + draws.sd[0] * np.linspace(-8.0, 8.0, N_KAPPA)
        return _Rule(nodes, weights, ln_kappa, DirectForward(_Known(known), with_field=True))

    def _solved(self, part: str, ratios: Array, progress: runs.Progress | None = None) -> Campaign:
        folder = self._folder(part)
        return runs.solved(self.store, CONTACT, folder, ratios, runs.COARSE_CELLS, progress)

    def _folder(self, part: str) -> str:
        return f"coarse-{CONTACT}-{part}" + (f"-{self.index}" if self.index else "")

    def _maxima(self, posterior: Posterior, sd: Array) -> dict[str, Any]:
        """The emulator's maximum refined by FE, as `calib map` does."""
        model = block_pin_model(runs.study(), runs.hypothesis(CONTACT), runs.COARSE_CELLS)
        refinement = self._folder(f"refine-{runs.study().design.n_local}")
        parts = (self.store / f"coarse-{CONTACT}", self.store / refinement)
        simulate = StoredSimulate(model, self.store / self._folder("map"), parts)
        start = emulator_map(posterior, sd, np.random.default_rng(2))
        assert isinstance(posterior.likelihood.forward, EmulatorForward)
        found = refine_map(posterior, DirectForward(simulate, with_field=True), start, sd)
        return {
            "map_difference_sd": _named(found.difference_sd),
            "map_fe_solves": found.n_solves,
            "map_status": str(found.status),
        }


def _held(found: Refined, rule: _Rule, by_fe: Moments) -> dict[str, Any]:
    """A posterior by emulator beside that by FE, and what was foretold of their distance."""
    return {
        "n_added": len(found.loop.ratios),
        "n_training": found.emulator.header.n_train,
        "predicted_shift_sd": found.shift,
        "foretold_shift_sd": found.foretold,
        "stated_sd_ratio": found.sd_ratio,
    } | rule.held_to_fe(found.posterior, by_fe)


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


class Moments(NamedTuple):
    """Of x = (ln kappa, r, s), (3,) each."""

    mean: Array
    sd: Array
    error: Array
    """SD of the mean by this rule, where the model is rough from node to node"""


@dataclass(frozen=True)
class _Rule:
    """Nodes at which FE runs are known."""

    nodes: Array
    weights: Array
    ln_kappa: Array
    exact: DirectForward

    def moments(self, posterior: Posterior) -> Moments:
        """Of x by the rule; a run that ended early has no weight."""
        n, m = len(self.nodes), len(self.ln_kappa)
        x = np.empty((n, m, 3))
        x[:, :, 0], x[:, :, 1:] = self.ln_kappa, self.nodes[:, None]
        log_density = np.array(
            [
                posterior.prior.log_prob(row) + _log_likelihood(posterior.likelihood, row)
                for row in x
            ]
        )
        total = log_density + np.log(self.weights)[:, None]
        probability = np.exp(total - logsumexp(total))
        mean = np.einsum("nk,nki->i", probability, x)
        sd = np.sqrt(np.einsum("nk,nki->i", probability, (x - mean) ** 2))
        share = probability.sum(axis=1)
        off = np.einsum("nk,nki->ni", probability, x) / share[:, None] - mean
        error = rough_error(
            logsumexp(log_density, axis=1), share, off, (self.nodes - mean[1:]) / sd[1:]
        )
        return Moments(mean, sd, error)

    def held_to_fe(self, posterior: Posterior, by_fe: Moments) -> dict[str, Any]:
        """A posterior by emulator beside that by FE, and by FE with the emulator's errors."""
        own = self.moments(posterior)
        errors = DirectWithErrors(self.exact, posterior.likelihood.forward)
        told: dict[str, Any] = {}
        for suffix, other in (
            ("", by_fe),
            ("_same_errors", self.moments(posterior.with_forward(errors))),
        ):
            told[f"mean_sd{suffix}"] = _named((own.mean - other.mean) / other.sd)
            told[f"sd_ratio{suffix}"] = _named(own.sd / other.sd)
        return told


def rough_error(value: Array, share: Array, off: Array, place: Array) -> Array:
    """(d,) SD of a mean by what is rough in a density, taken as independent at the nodes.

    `value` (n,) is ln density at the nodes, `share` (n,) their probabilities, `off` (n, d) of what
    the mean is taken, less the mean, `place` (n, 2) where they are. Rough is what a polynomial of
    degree `DEGREE` leaves, which itself is fitted and takes part of it along.
    """
    powers = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
    terms = np.array([place[:, 0] ** i * place[:, 1] ** j for i, j in powers]).T
    weight = np.sqrt(share)[:, None]
    fit = np.linalg.lstsq(terms * weight, value * weight[:, 0], rcond=None)[0]
    hat = np.einsum("ni,in->n", terms * weight, np.linalg.pinv(terms * weight))
    freedom = np.sum(share * (1.0 - hat))
    rough = np.sum(share * (value - terms @ fit) ** 2) / freedom
    found: Array = np.sqrt(rough * np.sum((share[:, None] * off) ** 2, axis=0))
    return found


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


def _named(values: Array) -> dict[str, float]:
    return dict(zip(PARAMETERS, values.tolist(), strict=True))
