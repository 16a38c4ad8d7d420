"""The likelihood equals the dense multivariate normal, in forces and in fields."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import TRAVEL, AnalyticBlock, AnalyticForward
from scipy.stats import multivariate_normal

from calib.data import Dataset, FieldData, thesis_forces
from calib.inference import DirectForward, Likelihood, NoiseSettings, build_likelihood
from calib.inference.field_floor import FieldFloor
from calib.inference.field_noise import (
    FLOOR_LENGTH,
    FLOOR_NUGGET,
    FieldCovariance,
    field_covariance,
    spatial_correlation,
)
from calib.inference.noise import between_sample_covariance, mean_covariance, slope_matrix
from fe.response import Array

RNG = np.random.default_rng(20)
POINTS = RNG.random((7, 2)) * 3.0
BLOCK = AnalyticBlock(points=POINTS)
THETA = np.array([[0.012, 0.1, 0.05], [0.02, 0.6, 0.3], [0.05, 0.9, 0.01]])


def field_data() -> FieldData:
    clean = BLOCK(np.array([0.4, 0.1])).displacement
    noise = 0.01 * RNG.standard_normal(clean.shape)
    return FieldData(POINTS, clean + noise, np.array([0.01, 0.02, 0.03]), 0.8, 0.4)


FIELD = field_data()
PATTERNS = 0.02 * RNG.standard_normal((2, 5, 7, 3))
FLOOR = np.linspace(0.001, 0.006, 15).reshape(5, 3)
PROFILE = np.linspace(0.3, 2.0, len(POINTS))


def dataset(with_field: bool) -> Dataset:
    return replace(thesis_forces(), field=FIELD if with_field else None)


def dense_field(covariance: FieldCovariance) -> Array:
    """The definition, element by element of the Kronecker product."""
    n_step, n_point, _ = covariance.shape
    smooth = spatial_correlation(POINTS, FLOOR_LENGTH, nugget=FLOOR_NUGGET)
    smooth = PROFILE[:, None] * smooth * PROFILE
    noise = np.einsum(
        "ij,pq,cd->ipcjqd",
        covariance.step,
        covariance.correlation,
        np.diag(covariance.noise_variance),
    )
    floor = np.einsum("cij,pq,cd->ipcjqd", covariance.floor, smooth, np.eye(3))
    total = (noise + floor).reshape(n_step * n_point * 3, -1)
    flat = covariance.patterns.reshape(-1, len(total))
    return total + flat.T @ flat


def likelihood(with_field: bool, error: float = 0.02) -> Likelihood:
    return build_likelihood(
        dataset(with_field),
        AnalyticForward(BLOCK, error, with_field),
        NoiseSettings(),
        force_discretisation=np.array([0.01, 0.02, 0.03, 0.04, 0.06]),
        field_floor=FieldFloor(FLOOR, PROFILE),
        field_patterns=PATTERNS,
    )


def dense_force(like: Likelihood, theta: Array) -> tuple[Array, Array]:
    """Residual and covariance of the force written out term by term."""
    prediction = like.forward.predict(theta[None])
    f = prediction.force[0]
    data, noise = thesis_forces(), NoiseSettings()
    own = np.sqrt(data.force_sd**2 - noise.load_cell_sd**2)
    rho = noise.sample_correlation
    e = like.errors.discretisation
    slope = slope_matrix(TRAVEL) @ f
    total = np.zeros((5, 5))
    for i in range(5):
        for j in range(5):
            same = float(i == j)
            total[i, j] = (own[i] * own[j] * rho ** abs(i - j) + same * noise.load_cell_sd**2) / 23
            total[i, j] += e[i] * f[i] * e[j] * f[j] * (0.5 + 0.5 * same)
            total[i, j] += noise.travel_zero_sd**2 * slope[i] * slope[j]
    if prediction.force_covariance is not None:
        total += prediction.force_covariance[0]
    return data.force_mean - f, total


def dense_joint(
    like: Likelihood, theta: Array, residual: Array, covariance: Array
) -> tuple[Array, Array]:
    """Residual and covariance of force and field, with the travel's zero that they share.

    `residual` and `covariance` are the field's, without the zero.
    """
    force_residual, force_covariance = dense_force(like, theta)
    slope = slope_matrix(TRAVEL)
    by_force = slope @ like.forward.predict(theta[None]).force[0]
    predicted = FIELD.displacement - residual.reshape(FIELD.displacement.shape)
    by_field = np.tensordot(slope, predicted, axes=1).ravel()
    sd = NoiseSettings().travel_zero_sd
    cross = sd**2 * np.outer(by_force, by_field)
    own = covariance + sd**2 * np.outer(by_field, by_field)
    both = np.block([[force_covariance, cross], [cross.T, own]])
    return np.concatenate([force_residual, residual]), both


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_force_likelihood_equals_the_dense_normal(error: float) -> None:
    like = likelihood(False, error)
    values = like.log_prob(THETA)
    for theta, value in zip(THETA, values, strict=True):
        residual, covariance = dense_force(like, theta)
        dense = multivariate_normal.logpdf(residual, cov=covariance)
        assert value == pytest.approx(dense, abs=1e-8, rel=1e-8)


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_field_likelihood_equals_the_dense_normal(error: float) -> None:
    like = likelihood(True, error)
    assert like.field is not None
    basis = like.field.basis
    assert basis.modes is not None
    modes = basis.modes.reshape(4, -1)
    total = dense_field(like.field.covariance.with_patterns(basis.truncation))
    prediction = like.forward.predict(THETA)
    assert prediction.weights is not None
    for i, theta in enumerate(THETA):
        covariance = total
        if prediction.weight_variance is not None:
            covariance = total + modes.T @ np.diag(prediction.weight_variance[i]) @ modes
        residual = FIELD.displacement.ravel() - prediction.weights[i] @ modes
        joint, both = dense_joint(like, theta, residual, covariance)
        dense = multivariate_normal.logpdf(joint, cov=both)
        assert like.log_prob(theta[None])[0] == pytest.approx(dense, rel=1e-8)


def test_direct_model_and_error_free_emulator_of_it_have_the_same_likelihood() -> None:
    like = likelihood(True, 0.0)
    assert like.field is not None
    bare = replace(like.field.basis, truncation=like.field.basis.truncation[:0])
    exact = AnalyticForward(BLOCK, 0.0, True)
    exact.basis = bare
    direct = DirectForward(BLOCK, with_field=True)
    by_emulator = like.with_forward(exact).log_prob(THETA)
    assert like.with_forward(direct).log_prob(THETA) == pytest.approx(by_emulator, rel=1e-10)


def conditional(mean: Array, covariance: Array, y: Array, rows: Array) -> float:
    """Log density of y[rows] given the others, by the textbook formula."""
    rest = np.setdiff1d(np.arange(y.size), rows)
    gain = covariance[np.ix_(rows, rest)] @ np.linalg.inv(covariance[np.ix_(rest, rest)])
    centre = mean[rows] + gain @ (y[rest] - mean[rest])
    spread = covariance[np.ix_(rows, rows)] - gain @ covariance[np.ix_(rest, rows)]
    return float(multivariate_normal.logpdf(y[rows], centre, 0.5 * (spread + spread.T)))


def test_pointwise_force_likelihood_is_the_conditional_normal() -> None:
    like = likelihood(False)
    values = like.pointwise(THETA)
    for theta, found in zip(THETA, values, strict=True):
        residual, covariance = dense_force(like, theta)
        expected = [conditional(np.zeros(5), covariance, residual, np.array([i])) for i in range(5)]
        assert found == pytest.approx(np.array(expected), rel=1e-8)


@pytest.mark.parametrize("direct", [False, True])
def test_pointwise_field_likelihood_is_the_conditional_normal_of_an_increment(
    direct: bool,
) -> None:
    like = likelihood(True)
    if direct:
        like = like.with_forward(DirectForward(BLOCK, with_field=True))
    theta = THETA[1:2]
    prediction = like.forward.predict(theta)
    like.log_prob(theta)
    assert like.field is not None and prediction.weights is not None
    basis = like.field.basis
    covariance = dense_field(like.field.covariance.with_patterns(basis.truncation))
    if basis.modes is not None and prediction.weight_variance is not None:
        modes = basis.modes.reshape(4, -1)
        covariance = covariance + modes.T @ np.diag(prediction.weight_variance[0]) @ modes
    field_residual = FIELD.displacement.ravel() - basis.fields(prediction.weights)[0].ravel()
    residual, both = dense_joint(like, theta[0], field_residual, covariance)
    rows = 5 + np.arange(5 * 21).reshape(5, 21)
    expected = [
        conditional(np.zeros(len(both)), both, residual, np.append(rows[i], i)) for i in range(5)
    ]
    assert like.pointwise(theta)[0] == pytest.approx(np.array(expected), rel=1e-7)


@pytest.mark.parametrize("smoothing", [0.0, 0.05, 1.0])
def test_field_covariance_contract_holds_against_the_dense_matrix(smoothing: float) -> None:
    patterns = 0.02 * RNG.standard_normal((3, 5, 7, 3))
    smooth = replace(FIELD, smoothing=smoothing)
    covariance = field_covariance(smooth, floor=FieldFloor(FLOOR, PROFILE), patterns=patterns)
    for case in (covariance, covariance.without_step(2), field_covariance(FIELD)):
        dense = dense_field(case)
        fields = RNG.standard_normal((2, *case.shape))
        flat = fields.reshape(2, -1)
        assert case.logdet == pytest.approx(np.linalg.slogdet(dense)[1], rel=1e-9)
        solved = np.linalg.solve(dense, flat.T)
        assert case.inner(fields, fields) == pytest.approx(flat @ solved, rel=1e-8)


def test_field_noise_samples_have_the_stated_covariance() -> None:
    """Largest of 8 whitened-product z scores below 5: false alarm 5e-6 (fixed seed)."""
    patterns = 0.02 * RNG.standard_normal((2, 5, 7, 3))
    covariance = field_covariance(FIELD, floor=FieldFloor(FLOOR, PROFILE), patterns=patterns)
    dense = dense_field(covariance)
    n = 4000
    draws = covariance.sample(np.random.default_rng(3), n).reshape(n, -1)
    for seed in range(8):
        direction = np.random.default_rng(seed).standard_normal(draws.shape[1])
        direction /= np.sqrt(direction @ dense @ direction)
        assert abs(np.var(draws @ direction) - 1) < 5 * np.sqrt(2 / n)


def test_covariance_of_the_mean_shrinks_with_the_number_of_samples_only_there() -> None:
    data = thesis_forces()
    single = between_sample_covariance(data.force_sd, 0.05, 0.7)
    assert np.sqrt(np.diag(single)) == pytest.approx(data.force_sd)
    mean = mean_covariance(data, NoiseSettings(0.05, 0.7))
    assert mean == pytest.approx(single / 23)


def test_quarter_newton_cannot_be_the_sd_of_the_load_cell() -> None:
    with pytest.raises(ValueError, match=r"load_cell_sd.*0\.091"):
        mean_covariance(thesis_forces(), NoiseSettings(load_cell_sd=0.25))


def test_slope_matrix_is_exact_for_cubics_through_the_origin() -> None:
    slope = slope_matrix(TRAVEL)
    force = 2 * TRAVEL - 3 * TRAVEL**2 + 1.5 * TRAVEL**3
    assert slope @ force == pytest.approx(2 - 6 * TRAVEL + 4.5 * TRAVEL**2)


def test_failed_solve_has_zero_likelihood_and_no_warning() -> None:
    like = likelihood(True).with_forward(
        DirectForward(AnalyticBlock(r_fails=0.5, points=POINTS), with_field=True)
    )
    values = like.log_prob(THETA)
    assert np.isfinite(values[0])
    assert values[1] == values[2] == -np.inf


def test_direct_model_runs_once_for_all_kappa() -> None:
    direct = DirectForward(BLOCK)
    theta = np.array([[0.01, 0.3, 0.1], [0.02, 0.3, 0.1]])
    force = direct.predict(theta).force
    direct.jacobian(theta)
    assert direct.n_solves == 1
    assert force[1] == pytest.approx(2 * force[0])


@pytest.mark.parametrize("with_field", [False, True])
def test_jacobian_is_the_derivative_by_ln_kappa_r_s(with_field: bool) -> None:
    direct = DirectForward(AnalyticBlock(0.1, points=POINTS), with_field=with_field)
    slope = direct.jacobian(THETA[:1])
    h = 1e-6
    for i in range(3):
        sides = []
        for sign in (1, -1):
            theta = THETA[:1].copy()
            theta[0, i] = theta[0, i] * np.exp(sign * h) if i == 0 else theta[0, i] + sign * h
            sides.append(direct.predict(theta))
        difference = (sides[0].force - sides[1].force) / (2 * h)
        assert slope.force[:, :, i] == pytest.approx(difference, rel=1e-6)
        if with_field:
            assert slope.weights is not None
            assert sides[0].weights is not None and sides[1].weights is not None
            difference = (sides[0].weights - sides[1].weights) / (2 * h)
            assert slope.weights[:, :, i] == pytest.approx(difference, rel=1e-5, abs=1e-8)
