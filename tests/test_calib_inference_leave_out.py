"""Leave-one-out scores against exact integrals, and stacking against known mixtures."""

from __future__ import annotations

from dataclasses import replace

import arviz as az
import numpy as np
import pytest
import xarray as xr
from analytic_models import AnalyticBlock, AnalyticForward

from calib.data import FieldData, thesis_forces
from calib.inference import (
    Marginal,
    NoiseSettings,
    Posterior,
    Prior,
    build_likelihood,
    integrate,
    theta_of,
)
from calib.inference.leave_out import (
    Block,
    Scores,
    Wider,
    block_log_density,
    differences,
    increment_blocks,
    leave_out,
    refitted,
    stacking,
    wider_blocks,
)
from calib.inference.quadrature import Quadrature

PRIOR = Prior(
    Marginal("log_uniform", 0.003, 0.3), Marginal("uniform", 0, 1), Marginal("uniform", 0, 0.5)
)
POINTS = np.random.default_rng(1).random((6, 2)) * 3
TRAVEL = thesis_forces().travel


def posterior(field: bool = False) -> Posterior:
    forward = AnalyticForward(AnalyticBlock(points=POINTS), 0.01, field)
    data = thesis_forces()
    if field:
        clean = forward.block(np.array([0.4, 0.1])).displacement
        noise = np.array([0.05, 0.05, 0.05])
        data = replace(data, field=FieldData(POINTS, clean, noise, 0.5, 0.3))
    return Posterior(
        PRIOR, build_likelihood(data, forward, NoiseSettings(), force_discretisation=0.02)
    )


FORCE = posterior()
QUADRATURE = integrate(FORCE, 24)


def draws(n: int, seed: int) -> np.ndarray:
    weights = QUADRATURE.weights / QUADRATURE.weights.sum()
    return QUADRATURE.x[np.random.default_rng(seed).choice(len(weights), n, p=weights)]


def test_scores_are_the_exact_ones_within_their_errors() -> None:
    """-ln E[1 / p] by quadrature, where Pareto k is below 0.5 and the stated error is one.

    Scores within 5 SDs: false alarm 3e-6 (fixed seed). What is left out further away is told by k.
    """
    blocks = (*increment_blocks(TRAVEL), *wider_blocks(FORCE.likelihood, TRAVEL))
    kept = QUADRATURE.weights > 0
    density = block_log_density(FORCE.likelihood, QUADRATURE.x[kept], blocks)
    exact = -np.log(QUADRATURE.weights[kept] @ np.exp(-density))
    found = leave_out(FORCE.likelihood, draws(8000, 0), blocks)
    off = np.abs(found.log_density - exact)
    good = found.pareto_k < 0.5
    assert good[:4].all() and not good[5:].any()
    # Points of a grid are drawn again and again, so the stated error is a little small here.
    assert np.all(off[good] < 5 * found.error[good] + 0.01)
    assert np.all(off[~good] > off[good].max())


def test_the_error_of_a_score_is_its_spread_over_other_draws() -> None:
    """Over 60 sets of 500 draws, ratio of SDs within 35 %: false alarm 1e-3 (fixed seeds)."""
    blocks = increment_blocks(TRAVEL)[1:3]
    rng = np.random.default_rng(7)
    weights = QUADRATURE.weights / QUADRATURE.weights.sum()
    found = [
        leave_out(FORCE.likelihood, QUADRATURE.x[rng.choice(len(weights), 500, p=weights)], blocks)
        for _ in range(60)
    ]
    spread = np.std([one.log_density for one in found], axis=0, ddof=1)
    stated = np.sqrt(np.mean([one.error**2 for one in found], axis=0))
    assert stated / spread == pytest.approx(np.ones(2), abs=0.35)


def test_draws_worth_a_ninth_have_three_times_the_error() -> None:
    blocks, x = increment_blocks(TRAVEL)[1:3], draws(900, 4)
    found = leave_out(FORCE.likelihood, x, blocks, worth=100.0)
    of_independent = leave_out(FORCE.likelihood, x, blocks)
    # and the tail that is smoothed is three times as long
    assert found.error == pytest.approx(3.0 * of_independent.error, rel=0.1)
    assert np.all(np.abs(found.log_density - of_independent.log_density) < found.error)
    density = xr.DataArray(
        -block_log_density(FORCE.likelihood, x, blocks).T, dims=("k", "__sample__")
    )
    assert found.pareto_k == pytest.approx(az.psislw(density, reff=1 / 9)[1].values)
    # of chains too short to tell their memory
    assert np.isinf(leave_out(FORCE.likelihood, x, blocks, worth=0.0).error).all()


def test_scores_that_the_draws_cannot_give_are_integrated_anew() -> None:
    """Against the same by quadrature over the posterior of all data, and for a sound score too."""
    blocks = (*increment_blocks(TRAVEL)[:1], *wider_blocks(FORCE.likelihood, TRAVEL))
    kept = QUADRATURE.weights > 0
    density = block_log_density(FORCE.likelihood, QUADRATURE.x[kept], blocks)
    exact = -np.log(QUADRATURE.weights[kept] @ np.exp(-density))
    forced = Scores(tuple(b.name for b in blocks), np.zeros(3), np.zeros(3), np.full(3, 1.0))
    found = refitted(FORCE, forced, blocks)
    assert found.refit == (True, True, True) and found.unreliable == ()
    # The grid over the posterior of all data cuts the tail of that without the last two: too high.
    assert found.log_density[:2] == pytest.approx(exact[:2], abs=5e-3)
    assert exact[2] - 0.05 < found.log_density[2] < exact[2]


@pytest.mark.lasting
def test_a_score_is_integrated_in_the_wider_posterior_where_the_rest_reaches_beyond() -> None:
    """The narrow one is known within 0.3 SD of the mean of r and s alone."""
    blocks = increment_blocks(TRAVEL)[:1]
    forced = Scores((blocks[0].name,), np.zeros(1), np.zeros(1), np.full(1, 1.0))
    mean, sd = QUADRATURE.mean[1:], QUADRATURE.sd[1:]
    narrow = replace(FORCE, prior=PRIOR.within(np.column_stack([mean - 0.3 * sd, mean + 0.3 * sd])))
    whole = refitted(FORCE, forced, blocks)
    asked: list[Quadrature] = []

    def reached(left: Quadrature) -> bool:
        asked.append(left)
        return True

    wide = refitted(narrow, forced, blocks, Wider(FORCE, reached))
    assert wide.log_density == pytest.approx(whole.log_density, abs=1e-12)
    assert len(asked) == 1 and asked[0].x[:, 1].max() <= mean[0] + 0.3 * sd[0]
    kept = refitted(narrow, forced, blocks, Wider(FORCE, lambda _: False))
    assert kept.log_density == pytest.approx(refitted(narrow, forced, blocks).log_density)
    assert abs(kept.log_density[0] - whole.log_density[0]) > 1e-3


def test_density_of_a_block_is_the_conditional_one() -> None:
    like = FORCE.likelihood
    x = draws(5, 1)
    [column] = block_log_density(like, x, (Block("last two", (3, 4)),)).T
    prediction = like.forward.predict(theta_of(x))
    for row in range(5):
        covariance = like.force_covariance(prediction)[row]
        residual = like.force - prediction.force[row]
        gain = covariance[3:, :3] @ np.linalg.inv(covariance[:3, :3])
        mean, left = gain @ residual[:3], covariance[3:, 3:] - gain @ covariance[:3, 3:]
        off = residual[3:] - mean
        expected = -0.5 * (
            off @ np.linalg.solve(left, off) + np.log(np.linalg.det(2 * np.pi * left))
        )
        assert column[row] == pytest.approx(expected, rel=1e-9)


def test_force_and_field_are_blocks_of_a_study_with_both() -> None:
    post = posterior(True)
    like = post.likelihood
    blocks = wider_blocks(like, TRAVEL)
    x = draws(4, 2)
    found = block_log_density(like, x, blocks)
    force = replace(like, field=None).log_prob(theta_of(x))
    assert found[:, 1] + force == pytest.approx(like.log_prob(theta_of(x)), rel=1e-12)
    single = block_log_density(like, x, increment_blocks(TRAVEL))
    assert single == pytest.approx(like.pointwise(theta_of(x)), rel=1e-12)
    with pytest.raises(ValueError, match="single increments"):
        block_log_density(like, x, (Block("two", (0, 1)),))
    with pytest.raises(ValueError, match="no field"):
        block_log_density(FORCE.likelihood, x, (Block("field", kind="field"),))


def scores(log_density: list[float]) -> Scores:
    n = len(log_density)
    names = tuple(str(i) for i in range(n))
    return Scores(names, np.array(log_density), np.zeros(n), np.full(n, 0.1))


def test_stacking_gives_all_to_a_hypothesis_that_is_better_everywhere() -> None:
    found = stacking(
        (scores([0.0, 1.0, 0.5]), scores([-2.0, -1.0, -3.0])), np.random.default_rng(0)
    )
    assert found.weights == pytest.approx([1.0, 0.0], abs=1e-4)
    assert found.low[0] > 0.99 and found.high[1] < 0.01


def test_stacking_is_the_maximum_over_a_fine_grid_and_unsure_where_blocks_disagree() -> None:
    first, second = [0.0, -1.0, 0.3, -2.0, 0.1], [-1.0, 0.2, -0.4, -0.3, 0.0]
    found = stacking((scores(first), scores(second)), np.random.default_rng(0))
    share = np.linspace(0, 1, 2001)[:, None]
    mixed = np.log(share * np.exp(first) + (1 - share) * np.exp(second)).sum(axis=1)
    assert found.weights[0] == pytest.approx(share[mixed.argmax(), 0], abs=2e-3)
    assert found.weights.sum() == pytest.approx(1.0)
    assert found.low[0] < 0.3 and found.high[0] > 0.7


def test_differences_are_paired() -> None:
    rows = differences((scores([0.0, 5.0]), scores([-1.0, 4.0])))
    assert rows[0].mean == 0.0
    assert rows[1].mean == pytest.approx(-2.0)
    assert rows[1].error == pytest.approx(0.0, abs=1e-12)
    # SD of sums over n blocks: sqrt(n) SDs of a block, of which n - 1 are free
    of_two = differences((scores([0.0, 5.0]), scores([-1.0, 2.0])))
    assert of_two[1].error == pytest.approx(np.sqrt(2.0) * np.std([1.0, 3.0], ddof=1))
    assert scores([1.0, 4.0, 4.0]).total_error == pytest.approx(np.sqrt(3.0) * np.sqrt(3.0))
    assert np.isnan(scores([1.0]).total_error)


@pytest.mark.lasting
def test_a_draw_that_carries_all_weight_is_told_by_pareto_k() -> None:
    found = leave_out(FORCE.likelihood, draws(2000, 3), increment_blocks(TRAVEL))
    assert found.unreliable == tuple(
        n for n, k in zip(found.names, found.pareto_k, strict=True) if k > 0.7
    )
    again = refitted(FORCE, found, increment_blocks(TRAVEL))
    assert again.unreliable == ()
    shape = np.array([0.2, 0.55, 0.45, 0.3, 0.8])
    by_shape = refitted(FORCE, replace(found, pareto_k=shape), increment_blocks(TRAVEL))
    assert by_shape.refit == (False, True, False, False, True)  # forces alone: from 0.5 on
    far = replace(FORCE.likelihood, force=FORCE.likelihood.force * [1, 1, 1, 1, 1.6])
    assert leave_out(far, draws(2000, 3), increment_blocks(TRAVEL)).unreliable
