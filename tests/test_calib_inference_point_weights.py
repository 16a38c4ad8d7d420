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
    scale = weights(True) ** -0.5
    expected = scale[:, None] * spatial_correlation(POINTS, 0.3) * scale
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
