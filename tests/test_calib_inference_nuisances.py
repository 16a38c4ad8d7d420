"""Nuisances of the test and unknown sizes of the errors: all equal to the dense normal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import TRAVEL, AnalyticBlock, AnalyticForward
from scipy.stats import multivariate_normal
from sklearn.gaussian_process.kernels import Matern

from calib.data import Dataset, FieldData, thesis_forces
from calib.inference import Likelihood, NoiseSettings, build_likelihood
from calib.inference.discrepancy import discrepancy_patterns, size_of, smooth_over
from calib.inference.field_floor import FieldFloor
from calib.inference.field_noise import FLOOR_LENGTH, FLOOR_NUGGET, spatial_correlation
from calib.inference.field_scales import rigid_patterns
from calib.inference.forward import DirectForward
from calib.inference.forward_errors import DirectWithErrors
from calib.inference.likelihood import SIZES
from calib.inference.noise import mean_covariance, slope_matrix
from fe.response import Array

RNG = np.random.default_rng(31)
POINTS = RNG.random((6, 2)) * np.array([4.0, 2.0])
BLOCK = AnalyticBlock(points=POINTS)
CLEAN = BLOCK(np.array([0.4, 0.1])).displacement
FIELD = FieldData(
    POINTS,
    CLEAN + 0.01 * RNG.standard_normal(CLEAN.shape),
    np.array([0.01, 0.02, 0.03]),
    0.8,
    0.4,
)
DATA: Dataset = replace(thesis_forces(), field=FIELD)
NOISE = NoiseSettings(
    travel_zero_sd=0.02,
    compliance_sd=0.03,
    face_travel_sd=0.015,
    gain_sd=0.01,
    field_scale_sd=0.004,
    translation_sd=0.006,
    rotation_sd=0.2,
)
BOUNDS = {
    "force_noise": (0.3, 3.0),
    "field_noise": (0.2, 4.0),
    "discrepancy": (1e-3, 0.3),
    "discrepancy_of_force": (0.5, 4.0),
}
THETA = np.array([[0.012, 0.1, 0.05], [0.02, 0.6, 0.3]])
RELATIVE = np.array([0.01, 0.02, 0.03, 0.04, 0.06])
FLOOR = np.linspace(0.001, 0.006, 15).reshape(5, 3)


def build(
    noise: NoiseSettings, unknown: dict[str, tuple[float, float]], error: float
) -> Likelihood:
    return build_likelihood(
        DATA,
        AnalyticForward(BLOCK, error, field=True),
        noise,
        force_discretisation=RELATIVE,
        field_floor=FieldFloor(FLOOR),
        unknown=unknown,
    )


def dense(
    like: Likelihood, theta: Array, noise: NoiseSettings, sizes: dict[str, float]
) -> tuple[Array, Array]:
    """Residual and covariance of forces and field, each error written out as it is defined."""
    prediction = like.forward.predict(theta[None])
    basis = like.forward.field_basis
    assert prediction.weights is not None and basis is not None and basis.modes is not None
    f, u = prediction.force[0], basis.fields(prediction.weights)[0]
    n = 5 + u.size
    total = np.zeros((n, n))
    force, field = slice(0, 5), slice(5, n)
    e = RELATIVE * f
    model = np.outer(e, e) * (0.5 + 0.5 * np.eye(5))
    if prediction.force_covariance is not None:
        model = model + prediction.force_covariance[0]
    share = sizes.get("discrepancy", noise.discrepancy)
    common = sizes.get("discrepancy_of_force", noise.discrepancy_of_force)
    over = smooth_over(TRAVEL, noise.discrepancy_travel_length)
    y = DATA.force_mean
    # With a factor the normal is of y ln(y / f), to which errors of f come as y / f of them.
    scale = y / f if share > 0 else np.ones(5)
    total[force, force] = sizes.get("force_noise", 1.0) ** 2 * mean_covariance(DATA, noise)
    total[force, force] += np.outer(scale, scale) * model
    total[force, force] += share**2 * np.outer(y, y) * (common**2 + over)
    near = 0.6 * np.eye(5) + 0.4
    spatial = spatial_correlation(POINTS, FIELD.correlation_length)
    variance = sizes.get("field_noise", 1.0) ** 2 * FIELD.noise_std**2
    own = np.einsum("ij,pq,cd->ipcjqd", near, spatial, np.diag(variance))
    smooth = spatial_correlation(POINTS, FLOOR_LENGTH, nugget=FLOOR_NUGGET)
    half = 0.5 * np.eye(5) + 0.5
    floor = np.einsum("ic,jc,ij->cij", FLOOR, FLOOR, half)
    own = own + np.einsum("cij,pq,cd->ipcjqd", floor, smooth, np.eye(3))
    shapes = [basis.truncation, rigid(noise)]
    size = np.sqrt(np.mean(FIELD.displacement**2, axis=1)).max(axis=1)
    lengths = noise.discrepancy_length, noise.discrepancy_travel_length
    shapes.append(share * discrepancy_patterns(POINTS, TRAVEL, size, *lengths))
    if prediction.weight_variance is not None:
        root = np.sqrt(prediction.weight_variance[0])
        shapes.append(root[:, None, None, None] * basis.modes)
    flat = np.concatenate(shapes).reshape(-1, u.size)
    total[field, field] = own.reshape(u.size, u.size) + flat.T @ flat
    for vector in shared(noise, f, u):
        vector[force] *= scale
        total += np.outer(vector, vector)
    off = y * np.log(y / f) if share > 0 else y - f
    residual = np.concatenate([off, (FIELD.displacement - u).ravel()])
    return residual, total


def rigid(noise: NoiseSettings) -> Array:
    """Rigid motions by cross products, one increment at a time."""
    place = np.column_stack([POINTS - POINTS.mean(axis=0), np.zeros(len(POINTS))])
    found = []
    for step in range(5):
        for axis in np.eye(3):
            for motion in (
                noise.translation_sd * np.tile(axis, (len(POINTS), 1)),
                np.radians(noise.rotation_sd) * np.cross(axis, place),
            ):
                field = np.zeros((5, len(POINTS), 3))
                field[step] = motion
                found.append(field)
    return np.array(found)


def shared(noise: NoiseSettings, f: Array, u: Array) -> list[Array]:
    """Changes of forces and field by one SD of each nuisance that they share."""
    slope = slope_matrix(TRAVEL)
    by_travel = np.tensordot(slope, u, axes=1)
    less = DATA.force_mean[:, None, None] * by_travel
    pairs = [
        (noise.travel_zero_sd * slope @ f, noise.travel_zero_sd * by_travel),
        (-noise.compliance_sd * DATA.force_mean * (slope @ f), -noise.compliance_sd * less),
        (np.zeros_like(f), noise.face_travel_sd * by_travel),
        (noise.gain_sd * f, np.zeros_like(u)),
        (np.zeros_like(f), noise.field_scale_sd * u),
    ]
    return [np.concatenate([force, field.ravel()]) for force, field in pairs]


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_all_nuisances_together_equal_the_dense_normal(error: float) -> None:
    like = build(NOISE, {}, error)
    assert len(like.errors.shared) == 5
    for theta in THETA:
        residual, covariance = dense(like, theta, NOISE, {})
        expected = multivariate_normal.logpdf(residual, cov=covariance)
        assert like.log_prob(theta[None])[0] == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("names", [("force_noise",), ("field_noise",), ("discrepancy",), SIZES])
def test_unknown_sizes_of_errors_equal_the_dense_normal(names: tuple[str, ...]) -> None:
    like = build(NOISE, {name: BOUNDS[name] for name in names}, 0.02)
    rng = np.random.default_rng(7)
    for theta in THETA:
        for share in (np.zeros(len(names)), np.ones(len(names)), rng.random(len(names))):
            logs = [
                np.log(BOUNDS[name][0]) + s * np.log(BOUNDS[name][1] / BOUNDS[name][0])
                for name, s in zip(names, share, strict=True)
            ]
            sizes = dict(zip(names, np.exp(logs), strict=True))
            residual, covariance = dense(like, theta, NOISE, sizes)
            expected = multivariate_normal.logpdf(residual, cov=covariance)
            found = like.log_prob(np.concatenate([theta, logs])[None])[0]
            assert found == pytest.approx(expected, rel=1e-8, abs=1e-7)


def test_the_direct_model_has_the_same_density_at_unknown_sizes() -> None:
    names = ("field_noise", "discrepancy")
    like = build(NOISE, {name: BOUNDS[name] for name in names}, 0.02)
    direct = DirectWithErrors(DirectForward(BLOCK, with_field=True), like.forward)
    theta = np.array([[*THETA[0], np.log(1.7), np.log(0.004)]])
    # the emulator here is the model itself, so only the way of computing differs
    assert like.with_forward(direct).log_prob(theta)[0] == pytest.approx(
        like.log_prob(theta)[0], rel=1e-8
    )


def test_scores_by_increment_are_conditional_densities_of_the_dense_normal() -> None:
    names = ("force_noise", "field_noise", "discrepancy")
    like = build(NOISE, {name: BOUNDS[name] for name in names}, 0.0)
    logs = np.log([1.4, 0.7, 0.1])
    theta = np.concatenate([THETA[0], logs])[None]
    residual, covariance = dense(like, THETA[0], NOISE, dict(zip(names, np.exp(logs), strict=True)))
    index = np.arange(5)
    step = np.concatenate([index, np.repeat(index, 3 * len(POINTS))])
    whole = multivariate_normal.logpdf(residual, cov=covariance)
    for i, found in enumerate(like.pointwise(theta)[0]):
        kept = step != i
        rest = multivariate_normal.logpdf(residual[kept], cov=covariance[np.ix_(kept, kept)])
        assert found == pytest.approx(whole - rest, rel=1e-7)


def test_nuisances_have_the_posterior_of_linear_regression() -> None:
    like = build(NOISE, {}, 0.0)
    found = like.shared_posterior(THETA[:1])
    residual, covariance = dense(like, THETA[0], NOISE, {})
    f = like.forward.predict(THETA[:1])
    basis = like.forward.field_basis
    assert f.weights is not None and basis is not None
    vectors = np.array(shared(NOISE, f.force[0], basis.fields(f.weights)[0]))
    solved = np.linalg.solve(covariance, np.column_stack([residual, vectors.T]))
    assert found.mean[0] == pytest.approx(vectors @ solved[:, 0], rel=1e-6, abs=1e-9)
    left = np.eye(5) - vectors @ solved[:, 1:]
    assert found.covariance[0] == pytest.approx(left, rel=1e-6, abs=1e-9)


def test_a_discrepancy_of_known_size_equals_the_dense_normal() -> None:
    noise = replace(NOISE, discrepancy=0.07, discrepancy_of_force=1.3, discrepancy_length=0.9)
    like = build(noise, {"field_noise": BOUNDS["field_noise"]}, 0.02)
    residual, covariance = dense(like, THETA[0], noise, {"field_noise": 1.2})
    expected = multivariate_normal.logpdf(residual, cov=covariance)
    theta = np.array([[*THETA[0], np.log(1.2)]])
    assert like.log_prob(theta)[0] == pytest.approx(expected, rel=1e-8)
    unknown = {name: BOUNDS[name] for name in SIZES}
    same = np.concatenate([THETA[0], np.log([1.0, 1.2, 0.07, 1.3])])[None]
    wide = build(replace(NOISE, discrepancy_length=0.9), unknown, 0.02)
    assert wide.log_prob(same)[0] == pytest.approx(expected, rel=1e-8)


def test_the_factor_of_the_forces_is_its_conditional_mean() -> None:
    like = build(NOISE, {"discrepancy": (1e-3, 0.3)}, 0.02)
    theta = np.array([[*THETA[0], np.log(0.08)]])
    y = DATA.force_mean
    part = 0.08**2 * (2.0**2 + smooth_over(TRAVEL, NOISE.discrepancy_travel_length))
    residual, total = (
        each[..., :5] for each in dense(like, THETA[0], NOISE, {"discrepancy": 0.08})
    )
    expected = part @ (y * np.linalg.solve(total[:5], residual))
    assert like.force_factor(theta)[0] == pytest.approx(expected, rel=1e-9)
    found = like.force_misfit(theta)[0]
    assert found == pytest.approx(residual @ np.linalg.solve(total[:5], residual), rel=1e-9)


def test_a_rigid_motion_of_the_field_changes_the_fit_little_where_it_is_allowed_for() -> None:
    moved = replace(FIELD, displacement=FIELD.displacement + np.array([0.02, -0.02, 0.02]))
    data = replace(DATA, field=moved)
    change = {}
    for name, sd in (("fixed", 0.0), ("free", 0.1)):
        noise = NoiseSettings(translation_sd=sd)
        values = [
            build_likelihood(
                d, AnalyticForward(BLOCK, 0.0, field=True), noise, field_floor=FieldFloor(FLOOR)
            ).log_prob(THETA[:1])[0]
            for d in (DATA, data)
        ]
        change[name] = values[0] - values[1]
    assert abs(change["free"]) < 0.1 * abs(change["fixed"])


def test_patterns_of_a_discrepancy_have_the_size_of_the_field() -> None:
    size = size_of(FIELD.displacement)
    patterns = discrepancy_patterns(POINTS, TRAVEL, size, 1.5, 0.8).reshape(-1, 5, len(POINTS), 3)
    variance = np.sum(patterns**2, axis=0) / size[:, None, None] ** 2
    assert variance == pytest.approx(np.ones_like(variance), abs=0.012)
    assert 1.0 - 5e-3 <= variance.mean() <= 1.0
    covariance = np.einsum("qpc,qrd->pcrd", patterns[:, 0], patterns[:, 0]) / size[0] ** 2
    expected = Matern(length_scale=1.5, nu=1.5)(POINTS)
    assert covariance[:, 0, :, 0] == pytest.approx(expected, abs=0.012)
    assert covariance[:, 0, :, 1] == pytest.approx(np.zeros((6, 6)), abs=1e-12)
    over = np.einsum("qi,qj->ij", patterns[:, :, 0, 0], patterns[:, :, 0, 0])
    assert over / np.outer(size, size) == pytest.approx(smooth_over(TRAVEL, 0.8), abs=0.012)


@pytest.mark.parametrize("fold", [0.0, 0.4])
def test_the_share_found_is_within_1_6_times_what_a_field_errs_by(fold: float) -> None:
    """Of the root mean square of a wave 0.65, and of one with a fold over 1.2 mm 1.15.

    A squared exponential makes 1.06 and 2.4 of them.
    """
    grid = np.linspace(0.1, 4.9, 36), np.linspace(0.1, 2.4, 18)
    points = np.stack(np.meshgrid(*grid), axis=-1).reshape(-1, 2)
    x, y = points.T
    wave, crease = np.cos(1.2 * x) * (1 + y), np.maximum(1 - abs(x - 2) / 0.6, 0.0) * (y < 1.2)
    wave, crease = (form / np.sqrt(np.mean(form**2)) for form in (wave, crease))
    wrong = np.stack([wave + fold * crease, 0.5 * wave, -wave - fold * crease], axis=1)
    error = 0.3 * TRAVEL[:, None, None] / TRAVEL.max() * wrong / np.sqrt(np.mean(wrong**2))
    noise = 0.03
    seen = error + noise * np.random.default_rng(3).standard_normal(error.shape)
    shapes = discrepancy_patterns(points, TRAVEL, np.ones(5), 1.5, 0.8).reshape(-1, seen.size)
    values, vectors = np.linalg.eigh(shapes @ shapes.T / noise**2)
    along = vectors.T @ (shapes @ seen.ravel() / noise**2)
    share = np.geomspace(0.02, 5.0, 120)
    variance = share[:, None] ** 2 * np.maximum(values, 0.0)
    gain = share[:, None] ** 2 * along**2 / (1.0 + variance) - np.log1p(variance)
    found = share[np.argmax(gain.sum(axis=1))]
    assert 1 / 1.6 < found / np.sqrt(np.mean(error**2)) < 1.6


def test_no_rigid_motion_is_no_pattern() -> None:
    assert rigid_patterns(POINTS, 5, 0.0, 0.0).shape == (0, 5, len(POINTS), 3)


def test_an_unknown_name_of_a_size_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown: expected some of"):
        build(NOISE, {"size": (1.0, 2.0)}, 0.0)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("name", ["discrepancy_length", "discrepancy_travel_length"])
def test_lengths_that_are_none_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name}: expected a length in mm"):
        NoiseSettings(discrepancy=0.05, **{name: value})


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
@pytest.mark.parametrize("name", ["force_freedom", "field_freedom"])
def test_degrees_of_freedom_that_are_none_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name}: expected 1 or more"):
        NoiseSettings(**{name: value})
