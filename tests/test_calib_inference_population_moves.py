"""The moves of the hierarchical model keep its density: where data say nothing, the prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.linear_population import BASE, NOISE, OWN, LinearForward, dataset, prior
from calib.inference import Marginal
from calib.inference.condensed import condense
from calib.inference.hierarchical import HierarchicalPosterior
from calib.inference.hierarchical_sampling import sample_population
from calib.inference.population import Population, ScatterPrior
from calib.inference.population_moves import Moves
from calib.inference.sampling import SamplerSettings

LEVELS = np.array([0.05, 0.25, 0.5, 0.75, 0.95])


@pytest.mark.lasting
def test_where_the_data_say_nothing_draws_are_those_of_the_prior() -> None:
    """Shares below five quantiles of mean and scatter of kappa and r, and of samples' spread.

    30 shares within 5 SDs of as many draws as chains of 64 walkers are worth, by their longest
    autocorrelation time: false alarm below 1e-4 (fixed seed). A move that forgets the prior of x,
    or takes another one of what samples differ by, fails.
    """
    rng = np.random.default_rng(0)
    data = replace(dataset(BASE + rng.standard_normal((3, 3))), force_sd=np.full(3, 1e4))
    silent = replace(NOISE, load_cell_sd=3e3)
    r = Marginal("normal", 0.0, 1.0, mean=0.2, sd=0.25)
    population = Population(prior(r), {"kappa": ScatterPrior(0.5), "r": ScatterPrior(0.3, 4.0)})
    posterior = HierarchicalPosterior(population, condense(data, LinearForward(), silent, OWN))
    settings = SamplerSettings(
        n_ensembles=2, n_walkers=32, n_autocorrelation=1e9, max_r_hat=1.0001, max_steps=300,
        check_every=100,
    )  # fmt: skip
    found = sample_population(posterior, settings, np.random.default_rng(4))
    n = 200_000
    x = population.prior.sample(rng, n)
    tau = np.stack([population.scatter[name].quantile(rng.random(n)) for name in ("kappa", "r")], 1)
    own = population.samples(x, tau, rng.standard_normal((n, 3, 2)))[:, :, :2]
    pairs = [(found.x, x), (found.tau, tau), (np.ptp(found.own, axis=-2), np.ptp(own, axis=-2))]
    worth = found.x[..., 0].size / float(np.max(found.autocorrelation_time))
    sd = np.sqrt(LEVELS * (1.0 - LEVELS) / worth)
    for drawn, known in pairs:
        for column in range(2):
            quantiles = np.quantile(known[:, column], LEVELS)
            shares = np.mean(
                drawn[..., column, None] < quantiles, axis=tuple(range(drawn.ndim - 1))
            )
            assert np.all(np.abs(shares - LEVELS) < 5.0 * sd), (shares, sd)


def test_walkers_that_are_lost_are_put_to_others_of_their_ensemble() -> None:
    """One of sixteen whose samples lie ten SDs from their population; nothing else moves."""
    rng = np.random.default_rng(1)
    data = dataset(BASE + 0.02 * rng.standard_normal((4, 3)))
    population = Population(prior(Marginal("uniform", 0.0, 1.0)), {"kappa": ScatterPrior(0.3)})
    posterior = HierarchicalPosterior(population, condense(data, LinearForward(), NOISE, OWN))
    moves = Moves(posterior, 2, 16, rng)
    walkers = moves.start()
    for _ in range(150):
        walkers = moves.round(walkers)
    same = moves.brought_back(walkers)
    for name in ("y", "v", "z"):
        np.testing.assert_array_equal(getattr(same, name), getattr(walkers, name))
    v = walkers.v.copy()
    v[20] = 10.0
    away = replace(walkers, v=v, white=posterior.white(*moves.globals.split(walkers.y), v))
    back = moves.brought_back(away)
    others = np.delete(np.arange(16, 32), 4)
    [chosen] = [k for k in others if np.array_equal(back.y[20], walkers.y[k])]
    np.testing.assert_array_equal(back.v[20], walkers.v[chosen])
    np.testing.assert_array_equal(back.white.residual[20], away.white.residual[chosen])
    rest = np.delete(np.arange(32), 20)
    np.testing.assert_array_equal(back.y[rest], away.y[rest])
