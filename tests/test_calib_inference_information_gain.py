"""Information gains: closed forms, bounds that hold the truth, a reduction that loses nothing."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward
from scipy.signal import lfilter

from calib.data import thesis_forces
from calib.inference.coordinates import theta_of
from calib.inference.information_gain import Gain, NestedGain, laplace_gain, nested_gain
from calib.inference.likelihood import Likelihood, build_likelihood
from calib.inference.noise import NoiseSettings
from calib.inference.planned import FirstOrderForward, reduce_experiment
from calib.virtual import VirtualNoise, virtual_experiment


def test_the_gain_of_a_linear_experiment_is_the_fall_of_the_entropy() -> None:
    rng = np.random.default_rng(1)
    jacobian = rng.standard_normal((1, 4, 3))
    noise = np.diag([0.5, 1.0, 2.0, 0.3])
    prior = np.cov(rng.standard_normal((3, 50)))
    after = np.linalg.inv(np.linalg.inv(prior) + jacobian[0].T @ np.linalg.inv(noise) @ jacobian[0])
    expected = 0.5 * (np.linalg.slogdet(prior)[1] - np.linalg.slogdet(after)[1])
    found = laplace_gain(np.repeat(jacobian, 2, axis=0), noise, prior)
    assert found.mean == pytest.approx(expected, rel=1e-10) and found.error < 1e-12


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_the_error_holds_that_the_covariance_is_of_so_many_draws(size: float) -> None:
    """The SD of 400 gains; within 12 % of the stated one but for 1 in 1000 (chi-square)."""
    rng = np.random.default_rng(11)
    jacobian = np.stack([size * rng.standard_normal((4, 3))] * 2)
    truth = np.linalg.cholesky(np.cov(rng.standard_normal((3, 12))))
    sets = rng.standard_normal((400, 500, 3)) @ truth.T
    found = [laplace_gain(jacobian, np.eye(4), np.cov(x, rowvar=False), 500) for x in sets]
    stated = np.mean([gain.error for gain in found])
    assert np.std([gain.mean for gain in found]) == pytest.approx(stated, rel=0.12)


def test_the_error_holds_that_the_draws_are_of_a_short_chain() -> None:
    """400 chains: their gains' spread is known to 4 %, the bound is five times that."""
    rng = np.random.default_rng(11)
    n_step, kept, share = 4000, 1500, 0.95  # worth n_step (1 - share) / (1 + share), some 103
    gains, stated = [], []
    for _ in range(400):
        pushes = rng.standard_normal((n_step, 2)) * np.sqrt(1.0 - share**2)
        chain = lfilter([1.0], [1.0, -share], pushes, axis=0)
        x = chain[rng.choice(n_step, kept, replace=False)]
        slopes = np.stack([1.0 + 0.5 * x, 2.0 - x], axis=1)[:400]
        worth = n_step * (1.0 - share) / (1.0 + share)
        found = laplace_gain(slopes, np.eye(2), np.cov(x, rowvar=False), kept, worth)
        gains.append(found.mean)
        stated.append(found.error)
    assert np.std(gains) == pytest.approx(np.mean(stated), rel=0.2)


def test_errors_of_draws_are_those_of_their_chain_too() -> None:
    """By n = 100 draws of a chain that is worth as many, each is sqrt(2) larger."""
    draws = np.random.default_rng(4).standard_normal((300, 2))
    rows = (draws[:100], draws[100:], np.eye(2))
    alone, of_chain = (
        nested_gain(*rows, np.random.default_rng(1), chain) for chain in (np.inf, 100.0)
    )
    for bound in ("lower", "upper"):
        one, other = getattr(alone, bound), getattr(of_chain, bound)
        assert other.mean == one.mean
        assert other.error == pytest.approx(np.sqrt(2.0) * one.error)
    slopes = np.random.default_rng(5).standard_normal((100, 2, 2))
    one, other = (laplace_gain(slopes, np.eye(2), np.eye(2), chain=c) for c in (np.inf, 100.0))
    assert other.error == pytest.approx(np.sqrt(2.0) * one.error)


def test_nested_monte_carlo_holds_the_closed_form_between_its_bounds() -> None:
    rng = np.random.default_rng(2)
    jacobian = rng.standard_normal((5, 3))
    noise = 0.3 * np.eye(5) + 0.1
    outer, inner = rng.standard_normal((900, 3)), rng.standard_normal((2500, 3))
    exact = laplace_gain(np.stack([jacobian] * 2), noise, np.eye(3))
    found = nested_gain(outer @ jacobian.T, inner @ jacobian.T, noise, rng)
    assert found.lower.mean <= found.upper.mean
    assert found.agrees_with(exact)
    assert not found.agrees_with(Gain(exact.mean + 0.5, 0.0))
    assert found.upper.error < 0.08


def test_few_inner_draws_leave_wide_bounds_not_wrong_ones() -> None:
    rng = np.random.default_rng(3)
    jacobian = 8.0 * np.eye(3)
    exact = laplace_gain(np.stack([jacobian] * 2), np.eye(3), np.eye(3))
    draws = rng.standard_normal((2, 2000, 3))
    few = nested_gain(draws[0] @ jacobian, draws[1, :40] @ jacobian, np.eye(3), rng)
    many = nested_gain(draws[0] @ jacobian, draws[1] @ jacobian, np.eye(3), rng)
    assert few.lower.mean < exact.mean < few.upper.mean
    assert few.upper.mean - few.lower.mean > 2 * (many.upper.mean - many.lower.mean)
    assert few.lower.mean <= np.log(41) + 1e-9  # it cannot tell more than the inner draws apart


def _likelihood() -> Likelihood:
    grid = np.meshgrid(np.linspace(0.3, 4.7, 4), np.linspace(0.2, 2.3, 3))
    points = np.stack([axis.ravel() for axis in grid], axis=1)
    block = AnalyticBlock(points=points)
    noise = VirtualNoise(load_cell_sd=0.01, travel_zero_sd=0.02)
    rng = np.random.default_rng(4)
    data = virtual_experiment(block, np.array([0.012, 0.3, 0.2]), noise, rng, points=points)
    settings = NoiseSettings(load_cell_sd=0.01, travel_zero_sd=0.02)
    return build_likelihood(
        data, AnalyticForward(block, field=True), settings, force_discretisation=0.01
    )


def _dense(likelihood: Likelihood, x: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """(3, 3) information of all forces and field values with every covariance written out."""
    theta = theta_of(x)[None]
    forward, field = likelihood.forward, likelihood.field
    prediction, slope = forward.predict(theta), forward.jacobian(theta)
    force = prediction.force.T
    basis = forward.field_basis
    n_step, n_point, _ = basis.offset.shape
    unit = np.eye(n_step * n_point * 3).reshape(-1, n_step, n_point, 3)
    covariance = field.covariance.with_patterns(basis.truncation)
    by_field = np.linalg.inv(covariance.inner(unit, unit))
    keep = np.zeros((n_step, n_point, 3), dtype=bool)
    keep[steps] = True
    flat = keep.ravel()
    fields = basis.fields(prediction.weights)[0]
    moved = np.einsum("ij,jpc->ipc", field.shifts[0], fields).ravel()[flat]
    shift = np.concatenate([likelihood.errors.shifts(force)[0, steps, 0], moved])
    noise = np.zeros((shift.size, shift.size))
    m = steps.size
    noise[:m, :m] = likelihood.errors.covariance(force, None)[np.ix_(steps, steps)][:, :, 0]
    noise[m:, m:] = by_field[np.ix_(flat, flat)]
    noise += np.outer(shift, shift)
    by_weights = np.tensordot(slope.weights[0].T, basis.modes, axes=1).reshape(3, -1)[:, flat]
    jacobian = np.vstack([slope.force[0][steps], by_weights.T])
    return jacobian.T @ np.linalg.solve(noise, jacobian)


@pytest.mark.parametrize("steps", [[0, 1, 2, 3, 4], [1, 4], [2]])
def test_the_reduced_experiment_has_all_the_information_of_the_dense_one(steps: list[int]) -> None:
    likelihood, x = _likelihood(), np.array([np.log(0.012), 0.3, 0.2])
    chosen = np.array(steps)
    reduced = reduce_experiment(likelihood, x[None], chosen)
    found = reduced.jacobian[0].T @ np.linalg.solve(reduced.covariance, reduced.jacobian[0])
    assert found == pytest.approx(_dense(likelihood, x, chosen), rel=1e-6)


def test_student_t_forces_tell_the_share_of_normal_ones_that_their_tails_leave() -> None:
    """Of n forces together, (nu + n) / (nu + n + 2) of it (Lange, Little & Taylor 1989, JASA 84,
    881, their scale being the normal SD)."""
    x, steps = np.array([[np.log(0.012), 0.3, 0.2]]), np.arange(5)
    covariance = []
    for freedom in (None, 4.0):
        noise = NoiseSettings(force_freedom=freedom, travel_zero_sd=0.0)
        forward = AnalyticForward(AnalyticBlock(), 0.0)
        likelihood = build_likelihood(thesis_forces(), forward, noise)
        covariance.append(reduce_experiment(likelihood, x, steps, with_field=False).covariance)
    assert covariance[1] == pytest.approx(covariance[0] * (4.0 + 7.0) / (4.0 + 5.0), rel=1e-9)


def test_more_increments_and_a_camera_never_tell_less() -> None:
    likelihood = _likelihood()
    rng = np.random.default_rng(5)
    x = np.array([np.log(0.012), 0.3, 0.2]) + [0.03, 0.02, 0.01] * rng.standard_normal((40, 3))
    prior = np.cov(x, rowvar=False)

    def gain(steps: list[int], with_field: bool) -> float:
        planned = reduce_experiment(likelihood, x, np.array(steps), with_field=with_field)
        return laplace_gain(planned.jacobian, planned.covariance, prior).mean

    assert gain([0], False) < gain([0, 4], False) < gain([0, 1, 2, 3, 4], False)
    assert gain([0, 1, 2, 3, 4], False) < gain([0, 1, 2, 3, 4], True)


def test_a_first_order_model_has_value_and_slope_of_its_run() -> None:
    points = np.array([[1.0, 0.5], [3.0, 2.0]])
    block, at = AnalyticBlock(points=points), np.array([0.3, 0.2])
    run = block(at)
    model = FirstOrderForward(
        at, run.force, run.force_gradient, run.displacement, run.displacement_gradient
    )
    exact = AnalyticForward(block, field=True)
    theta = np.array([[0.012, *at]])
    assert model.predict(theta).force == pytest.approx(exact.predict(theta).force)
    assert model.jacobian(theta).force == pytest.approx(exact.jacobian(theta).force)
    near = theta + np.array([0.0, 1e-3, -1e-3])
    fields = model.field_basis.fields(model.predict(near).weights)[0]
    assert fields == pytest.approx(block(near[0, 1:]).displacement, abs=1e-5)


def test_bounds_agree_with_what_lies_between_them() -> None:
    nested = NestedGain(Gain(1.0, 0.0), Gain(1.2, 0.0))
    assert nested.agrees_with(Gain(1.1, 0.0)) and not nested.agrees_with(Gain(1.3, 0.01))
