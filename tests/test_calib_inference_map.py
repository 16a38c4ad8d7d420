"""The refined maximum is that of the direct model, whatever the emulator's error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward
from scipy.optimize import minimize

from calib.data import FieldData, thesis_forces
from calib.inference import (
    DirectForward,
    ForwardModel,
    MapStatus,
    Marginal,
    NoiseSettings,
    Posterior,
    Prior,
    build_likelihood,
    emulator_map,
    refine_map,
)
from calib.inference.corrected import correct
from calib.inference.forward_errors import DirectWithErrors
from calib.inference.map_estimate import GAIN_TOLERANCE, MapPoint
from calib.inference.minimise import gradient, projected_gradient
from fe.response import Array, Response

SD = np.array([0.05, 0.2, 0.07])
POINTS = np.random.default_rng(1).random((6, 2)) * 3
INFORMED = Prior(
    Marginal("log_uniform", 0.003, 0.3),
    Marginal("normal", 0, 1, 0.5, 0.2),
    Marginal("normal", 0, 0.5, 0.15, 0.05),
)
FLAT = Prior(
    Marginal("log_uniform", 0.003, 0.3), Marginal("uniform", 0, 1), Marginal("uniform", 0, 0.5)
)


def posterior(prior: Prior, *, field: bool = False) -> Posterior:
    data = thesis_forces()
    block = AnalyticBlock(points=POINTS)
    if field:
        clean = block(np.array([0.4, 0.1])).displacement
        noise = np.array([0.01, 0.01, 0.02])
        data = replace(data, field=FieldData(POINTS, clean, noise, 0.5, 0.3))
    forward = AnalyticForward(block, 0.01, field)
    return Posterior(
        prior, build_likelihood(data, forward, NoiseSettings(), force_discretisation=0.02)
    )


def optimum(post: Posterior, direct: DirectForward, start: Array) -> Array:
    """Direct maximum by Nelder-Mead and a bounded polish, without any of the code under test."""
    exact = post.with_forward(DirectWithErrors(direct, post.likelihood.forward))

    def objective(x: Array) -> float:
        value = -float(exact.log_prob(x[None])[0])
        return value if np.isfinite(value) else 1e9

    bounds = [tuple(b) for b in post.prior.bounds]
    options = {"xatol": 1e-8, "fatol": 1e-12, "maxiter": 4000}
    x = start
    for _ in range(3):
        x = minimize(objective, x, method="Nelder-Mead", bounds=bounds, options=options).x
    return np.asarray(x)


@pytest.mark.parametrize("field", [False, True])
def test_without_slopes_of_the_direct_model_secants_lead_to_its_maximum(field: bool) -> None:
    block = AnalyticBlock(bend=0.1, points=POINTS)

    def no_slopes(ratios: Array) -> Response:
        found = block(ratios)
        return replace(
            found,
            force_gradient=np.full_like(found.force_gradient, np.nan),
            displacement_gradient=np.full_like(found.displacement_gradient, np.nan),
        )

    post = posterior(INFORMED, field=field)
    start = emulator_map(post, SD, np.random.default_rng(0))
    found = refine_map(post, DirectForward(no_slopes, with_field=field), start, SD, max_solves=30)
    best = optimum(post, DirectForward(block, with_field=field), start.x)
    assert found.by_secants and found.direct is not None
    assert np.isfinite(found.direct.gradient).all()
    # It starts off by more than it may end off.
    assert np.abs((best - start.x) / SD).max() > 0.3
    assert np.abs((best - found.direct.x) / SD).max() < 0.15


@pytest.mark.parametrize("field", [False, True])
def test_refinement_reaches_the_maximum_of_a_direct_model_that_differs(field: bool) -> None:
    post = posterior(INFORMED, field=field)
    start = emulator_map(post, SD, np.random.default_rng(0))
    direct = DirectForward(AnalyticBlock(0.04, points=POINTS), with_field=field)
    result = refine_map(post, direct, start, SD)
    expected = optimum(post, DirectForward(direct._simulate, with_field=field), start.x)
    assert result.status is MapStatus.CONVERGED
    assert result.direct is not None
    again = DirectForward(direct._simulate, with_field=field)
    exact = post.with_forward(DirectWithErrors(again, post.likelihood.forward))
    exact.log_prob(expected[None])  # shows the shape of the field
    # What the rule for stopping promises: no more than that is left to gain.
    assert exact.log_prob(expected[None])[0] - result.direct.log_prob < GAIN_TOLERANCE
    assert np.abs((result.direct.x - expected) / SD).max() < 0.1
    assert np.abs((start.x - expected) / SD).max() > 0.1  # the emulator alone is off
    assert result.n_solves == direct.n_solves <= 12
    assert result.maximum is not None
    assert result.difference_sd == pytest.approx((result.maximum - start.x) / SD)
    off, solved_off = (np.abs((x - expected) / SD).max() for x in (result.maximum, result.direct.x))
    assert off < max(0.02, solved_off)


@pytest.mark.parametrize("field", [False, True])
def test_a_difference_too_small_for_a_step_is_told(field: bool) -> None:
    """The search ends at the emulator's maximum, which the direct slopes there say is off."""
    post = posterior(INFORMED, field=field)
    start = emulator_map(post, SD, np.random.default_rng(0))
    block = AnalyticBlock(0.001, points=POINTS)
    result = refine_map(post, DirectForward(block, with_field=field), start, SD)
    expected = (optimum(post, DirectForward(block, with_field=field), start.x) - start.x) / SD
    assert result.status is MapStatus.CONVERGED and result.n_solves == 1
    assert result.direct is not None and np.array_equal(result.direct.x, start.x)
    assert np.abs(expected).max() > 0.01
    assert result.difference_sd == pytest.approx(expected, abs=0.1 * np.abs(expected).max())


def test_maximum_on_a_bound_has_zero_projected_gradient() -> None:
    post = posterior(FLAT)
    start = emulator_map(post, SD, np.random.default_rng(0))
    direct = DirectForward(AnalyticBlock(-0.15, points=POINTS))
    result = refine_map(post, direct, start, SD)
    expected = optimum(post, direct, start.x)
    assert result.direct is not None
    bounds = post.prior.bounds
    distance = np.abs(expected[:, None] - bounds).min(axis=1)
    assert distance[1:].min() < 1e-6  # a bound of r or s is active in this case
    assert result.status is MapStatus.CONVERGED
    assert np.abs((result.direct.x - expected) / SD).max() < 0.05
    active = np.abs(result.direct.x[:, None] - bounds).min(axis=1) < 1e-6
    assert active.any()
    assert np.all(result.direct.gradient[active] == 0.0)
    exact = post.with_forward(DirectWithErrors(direct, post.likelihood.forward))
    assert exact.log_prob(expected[None])[0] - result.direct.log_prob < GAIN_TOLERANCE


def test_failing_solves_shrink_the_step_and_never_raise() -> None:
    post = posterior(INFORMED)
    start = emulator_map(post, SD, np.random.default_rng(0))
    free = optimum(post, DirectForward(AnalyticBlock(-0.04)), start.x)
    # Solves fail between the emulator's maximum and the direct one.
    edge = 0.5 * (start.x[1] + free[1])
    direct = DirectForward(AnalyticBlock(-0.04, r_fails=edge))
    assert free[1] > edge > start.x[1]
    result = refine_map(post, direct, start, SD, max_solves=25)
    assert result.status in (MapStatus.BLOCKED, MapStatus.MAX_SOLVES)
    assert result.direct is not None
    assert result.direct.x[1] <= edge
    assert np.array_equal(result.maximum, result.direct.x)
    # What could not be solved counts against the emulator: the maximum beyond is foretold.
    expected = (free - start.x) / SD
    assert result.foretold_sd[1] == pytest.approx(expected[1], abs=0.3 * expected[1])
    assert result.foretold_sd[1] > result.difference_sd[1]
    exact = post.with_forward(DirectWithErrors(direct, post.likelihood.forward))
    assert result.direct.log_prob >= float(exact.log_prob(start.x[None])[0])


def test_failing_start_is_left_for_a_point_that_solves() -> None:
    post = posterior(INFORMED)
    start = MapPoint(np.array([-3.6, 0.9, 0.2]), 0.0, np.zeros(3))
    result = refine_map(post, DirectForward(AnalyticBlock(0.04, r_fails=0.8)), start, SD)
    assert result.direct is not None
    assert result.direct.x[1] <= 0.8
    assert result.status is MapStatus.CONVERGED


def test_model_that_never_solves_is_reported_not_raised() -> None:
    post = posterior(INFORMED)
    start = emulator_map(post, SD, np.random.default_rng(0))
    result = refine_map(post, DirectForward(AnalyticBlock(r_fails=-1)), start, SD, max_solves=4)
    assert result.status is MapStatus.NO_SOLVE
    assert result.direct is None and result.maximum is None
    assert result.n_solves == 4
    assert np.all(np.isnan(result.difference_sd))


@pytest.mark.parametrize("field", [False, True])
def test_corrected_emulator_agrees_with_the_direct_model_to_first_order(field: bool) -> None:
    post = posterior(INFORMED, field=field)
    direct = DirectForward(AnalyticBlock(0.1, points=POINTS), with_field=field)
    x = np.array([-3.6, 0.4, 0.1])
    exact = post.with_forward(DirectWithErrors(direct, post.likelihood.forward))
    model = post.with_forward(correct(post.likelihood.forward, direct, x))
    errors = []
    for step in (0.02, 0.01):
        at = np.array([x, x + step * np.array([0.1, 1.0, 0.5])])
        difference = model.log_prob(at) - exact.log_prob(at)
        assert difference[0] == pytest.approx(0, abs=1e-8)
        errors.append(abs(difference[1]))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.2)


@pytest.mark.parametrize("field", [False, True])
def test_a_direct_model_that_the_emulator_matches_has_the_same_posterior(field: bool) -> None:
    """The emulator's errors stay, so that only its means can move the maximum."""
    post = posterior(INFORMED, field=field)
    direct = DirectForward(AnalyticBlock(points=POINTS), with_field=field)
    exact = post.with_forward(DirectWithErrors(direct, post.likelihood.forward))
    x = np.array([[-3.6, 0.4, 0.1], [-3.5, 0.7, 0.2]])
    assert exact.log_prob(x) == pytest.approx(post.log_prob(x), abs=1e-6)
    theta = np.exp(x[:, 0])[:, None] * [1, 0, 0] + x * [0, 1, 1]
    leave_one_out = exact.likelihood.pointwise(theta)
    assert leave_one_out == pytest.approx(post.likelihood.pointwise(theta), abs=1e-6)
    bare = post.with_forward(DirectForward(AnalyticBlock(points=POINTS), with_field=field))
    assert np.abs(bare.log_prob(x) - post.log_prob(x)).min() > 1e-3


def test_one_simulation_is_not_called_simulations() -> None:
    post = posterior(INFORMED)
    start = emulator_map(post, SD, np.random.default_rng(0))
    result = refine_map(post, DirectForward(AnalyticBlock()), start, SD)
    assert result.message == "converged after 1 direct simulation"


@pytest.mark.parametrize("negative", ["emulator", "direct"])
def test_forces_that_are_not_positive_are_not_corrected(negative: str) -> None:
    """An emulator of forces may predict them; their logarithm would be NaN from there on."""
    block, x = AnalyticBlock(0.1, points=POINTS), np.array([-3.6, 0.4, 0.1])
    emulator: ForwardModel = AnalyticForward(AnalyticBlock(points=POINTS))
    direct = DirectForward(block)
    if negative == "emulator":
        emulator = DirectForward(lambda ratios: _pulling(block(ratios)))
    else:
        direct = DirectForward(lambda ratios: _pulling(block(ratios)))
    with pytest.raises(ValueError, match=f"{negative}: forces must be positive to be corrected"):
        correct(emulator, direct, x)


def _pulling(response: Response) -> Response:
    return replace(response, force=response.force - response.force[1])


def test_emulator_map_is_a_stationary_point_and_the_highest() -> None:
    post = posterior(FLAT)
    point = emulator_map(post, SD, np.random.default_rng(0))
    assert np.abs(point.gradient).max() < 1e-5
    draws = post.prior.sample(np.random.default_rng(1), 50_000)
    assert post.log_prob(draws).max() <= point.log_prob + 1e-9


@pytest.mark.parametrize("place", [0.0, 1e-5, 0.5, 1.0])
def test_gradient_is_exact_for_quartics_inside_and_at_bounds(place: float) -> None:
    bounds = np.array([[0.0, 1.0]] * 3)
    x = np.full(3, place)

    def quartic(points: Array) -> Array:
        outside = np.any((points < 0) | (points > 1), axis=1)
        value: Array = np.sum(points**4 - 2 * points**3 + points, axis=1)
        return np.where(outside, -np.inf, value)

    expected = 4 * place**3 - 6 * place**2 + 1
    found = gradient(quartic, x, bounds, np.ones(3))
    assert found == pytest.approx(np.full(3, expected), abs=1e-9)
    if place == 0.0:  # the density rises inwards: nothing is held
        assert projected_gradient(quartic, x, bounds, np.ones(3)) == pytest.approx(-np.ones(3))
    if place == 1.0:  # falls inwards as well: -1 slope means inward uphill
        assert np.all(projected_gradient(quartic, x, bounds, np.ones(3)) > 0)


class RoughBlock:
    """A direct model with ripples of 0.02 % in its forces: slopes are off by 10 % and more."""

    def __call__(self, ratios: Array) -> Response:
        smooth = AnalyticBlock(0.04, points=POINTS)(ratios)
        wave = 2e-4 * np.sin(800.0 * ratios[0] + 1500.0 * ratios[1] + np.arange(5))
        slope = 2e-4 * np.cos(800.0 * ratios[0] + 1500.0 * ratios[1] + np.arange(5))
        by_ratios = smooth.force[:, None] * slope[:, None] * np.array([800.0, 1500.0])
        return replace(
            smooth,
            force=smooth.force * (1.0 + wave),
            force_gradient=smooth.force_gradient * (1.0 + wave)[:, None] + by_ratios,
        )


def test_ripples_of_the_direct_forces_do_not_stop_the_search() -> None:
    post = posterior(INFORMED)
    start = emulator_map(post, SD, np.random.default_rng(0))
    result = refine_map(post, DirectForward(RoughBlock()), start, SD)
    smooth = DirectForward(AnalyticBlock(0.04, points=POINTS))
    expected = optimum(post, smooth, start.x)
    assert result.status is MapStatus.CONVERGED, result.message
    assert result.direct is not None
    # The gain rule alone leaves sqrt(2 * 0.01) = 0.14 SD open, the ripples about as much again.
    assert np.abs((result.direct.x - expected) / SD).max() < 0.3
    assert np.abs((start.x - expected) / SD).max() > 0.7
