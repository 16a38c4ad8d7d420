"""Student-t noise of a field by weights of its points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward
from scipy.stats import chi2

from calib.data import FieldData, thesis_forces
from calib.inference import NoiseSettings, build_likelihood
from calib.inference.field_noise import field_covariance, spatial_correlation, step_correlation
from calib.inference.point_weights import point_weights
from fe import BlockPin, BlockPinModel, Contact

X, Y = np.meshgrid(np.linspace(0.2, 4.8, 12), np.linspace(0.2, 2.3, 8), indexing="ij")
POINTS = np.stack([X.ravel(), Y.ravel()], axis=1)
BLOCK = AnalyticBlock(points=POINTS)
STEP = step_correlation(5, 0.5)
OUTLIERS = [7, 40]


def field(outliers: bool) -> FieldData:
    rng = np.random.default_rng(12)
    clean = BLOCK(np.array([0.4, 0.1])).displacement
    std = np.array([0.01, 0.01, 0.02])
    correlation = spatial_correlation(POINTS, 0.3)
    noise = np.einsum(
        "ij,pq,jqc->ipc",
        np.linalg.cholesky(STEP),
        np.linalg.cholesky(correlation),
        rng.standard_normal(clean.shape),
    )
    found = clean + noise * std
    if outliers:
        found[:, OUTLIERS] += 0.3
    return FieldData(POINTS, found, std, 0.3, 0.5)


def weights(outliers: bool, freedom: float = 4.0) -> np.ndarray:
    return point_weights(field(outliers), spatial_correlation(POINTS, 0.3), STEP, freedom)


def test_points_of_normal_noise_keep_their_weight() -> None:
    found = weights(False)
    # (nu + n) / (nu + chi-square of n = 15 values), that in [3.4, 44] but for 1 point in 10,000
    low, high = (19.0 / (4.0 + chi2.ppf(p, 15)) for p in (1.0 - 1e-4, 1e-4))
    assert low < found.min() and found.max() < high
    assert np.median(found) == pytest.approx(1.0, abs=0.35)


@pytest.mark.parametrize("length", [0.01, 0.5, 1.0])
def test_correlated_noise_is_not_taken_for_outliers(length: float) -> None:
    """Weights and what they make of the SD of a scale of the field, over four sets of data."""
    rng, std = np.random.default_rng(3), np.full(3, 0.01)
    clean = BLOCK(np.array([0.4, 0.1])).displacement
    correlation = spatial_correlation(POINTS, length, nugget=0.02)
    roots = np.linalg.cholesky(STEP), np.linalg.cholesky(correlation)
    found, wider = [], []
    for _ in range(4):
        noise = 0.01 * np.einsum("ij,pq,jqc->ipc", *roots, rng.standard_normal(clean.shape))
        data = FieldData(POINTS, clean + noise, std, length, 0.5, nugget=0.02)
        found.append(point_weights(data, correlation, STEP, 4.0))
        information = [
            field_covariance(data, freedom=freedom).inner(clean[None], clean[None])[0, 0]
            for freedom in (4.0, None)
        ]
        wider.append((information[1] / information[0]) ** 0.5)
    low, middle = (19.0 / (4.0 + chi2.ppf(p, 15)) for p in (0.99, 0.5))
    assert np.quantile(found, 0.01) > 0.8 * low
    assert 0.9 * middle < np.median(found) < 1.6 * middle  # a rough field foretells with less
    assert 1.0 <= np.mean(wider) < 1.1


@pytest.mark.parametrize("contact", ["stick", "slide"])
def test_the_bend_of_a_field_at_the_pins_edge_is_no_outlier(contact: str) -> None:
    model = BlockPinModel(
        BlockPin(), Contact(contact, contact), (8, 4, 2), (0.6, 1.0), field_grid=(20, 12)
    )
    response = model(np.array([0.5, 0.05]))
    step, correlation = step_correlation(2, 0.5), spatial_correlation(response.points, 0.3)
    noise = 0.01 * np.einsum(
        "ij,pq,jqc->ipc",
        np.linalg.cholesky(step),
        np.linalg.cholesky(correlation),
        np.random.default_rng(0).standard_normal(response.displacement.shape),
    )
    noisy, std = response.displacement + noise, np.full(3, 0.01)
    of = FieldData(response.points, noisy, std, 0.3, 0.5)
    found = point_weights(of, correlation, step, 4.0)
    assert np.mean(found < 0.3) < 0.1, "more than half of them were"
    far = FieldData(response.points, noisy + 100.0, std, 0.3, 0.5)
    np.testing.assert_allclose(point_weights(far, correlation, step, 4.0), found, rtol=1e-3)


def test_outliers_lose_their_weight_and_others_do_not() -> None:
    found = weights(True)
    assert (found[OUTLIERS] < 0.02).all()
    others = np.delete(found, OUTLIERS)
    assert np.median(others) == pytest.approx(1.0, abs=0.4)
    assert np.argsort(found)[:2].tolist() == sorted(OUTLIERS, key=lambda i: found[i])


def test_many_degrees_of_freedom_are_the_normal() -> None:
    assert weights(True, 1e9) == pytest.approx(np.ones(len(POINTS)), abs=1e-3)


def test_the_covariance_is_that_of_the_weighed_points() -> None:
    data = field(True)
    found = field_covariance(data, floor=0.001, freedom=4.0)
    own = np.maximum(1.0 / weights(True) - 1.0, 0.0)
    expected = spatial_correlation(POINTS, 0.3) + np.diag(own)
    assert found.correlation == pytest.approx(expected, rel=1e-12)
    # V^T S V = I with the S of the weighed points
    assert found.vectors.T @ expected @ found.vectors == pytest.approx(np.eye(96), abs=1e-9)


def test_outliers_move_the_answer_by_less_under_student_t() -> None:
    r = np.linspace(-0.6, 1.0, 321)
    theta = np.column_stack([np.full(321, 0.012), r, np.full(321, 0.1)])
    best = {}
    for outliers in (False, True):
        data = replace(thesis_forces(), field=field(outliers))
        for freedom in (None, 4.0):
            likelihood = build_likelihood(
                data,
                AnalyticForward(BLOCK, 0.0, field=True),
                NoiseSettings(field_freedom=freedom),
                field_floor=0.001,
            )
            best[outliers, freedom] = r[np.argmax(likelihood.log_prob(theta))]
    moved = abs(best[True, 4.0] - best[False, 4.0])
    assert moved <= 0.3 * abs(best[True, None] - best[False, None])


def test_degrees_of_freedom_must_be_positive() -> None:
    with pytest.raises(ValueError, match="freedom: expected degrees of freedom above 0, got 0"):
        weights(False, 0.0)
