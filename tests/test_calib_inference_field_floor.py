"""Where on the face a model's errors of unknown shape are large."""

from __future__ import annotations

import numpy as np
import pytest

from calib.data import FieldData
from calib.inference.field_floor import PROFILE_LEAST, PROFILE_LENGTH, FieldFloor, local_profile
from calib.inference.field_noise import (
    FLOOR_LENGTH,
    FLOOR_NUGGET,
    FLOOR_SHARED,
    field_covariance,
    spatial_correlation,
    step_correlation,
)

N_STEP = 2
LINE = np.column_stack([np.linspace(0.0, 5.0, 26), np.zeros(26)])
"""mm; points 0.2 mm apart"""
SD = np.array([[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]])


def test_the_profile_is_larger_where_models_differ_more_and_has_a_size_of_one() -> None:
    rng = np.random.default_rng(1)
    wide = np.where(LINE[:, 0] < 2.5, 1.0, 0.1)[:, None]
    profile = local_profile(LINE, wide * rng.normal(size=(2, N_STEP, 26, 3)))
    assert np.mean(profile**2) == pytest.approx(1.0)
    far = 3 * PROFILE_LENGTH
    inner, outer = LINE[:, 0] < 2.5 - far, LINE[:, 0] > 2.5 + far
    assert profile[inner].min() > 0.9
    # Differences are a tenth there; what is stated does not go below its least.
    assert profile[outer] == pytest.approx(PROFILE_LEAST * profile.max(), rel=0.5)
    assert np.ptp(profile[outer]) == pytest.approx(0.0, abs=1e-12)


def test_the_profile_does_not_depend_on_the_sizes_of_increments_and_components() -> None:
    difference = np.random.default_rng(2).normal(size=(1, N_STEP, 26, 3))
    sizes = np.array([[1.0, 50.0, 3.0], [1e-3, 1.0, 7.0]])[:, None]
    found = local_profile(LINE, sizes * difference)
    assert found == pytest.approx(local_profile(LINE, difference), rel=1e-12)


def test_no_difference_has_an_even_profile() -> None:
    none = np.zeros((1, N_STEP, 26, 3))
    assert np.array_equal(local_profile(LINE, none), np.ones(26))
    # Nor does a component in which nothing differs take part.
    difference = np.random.default_rng(3).normal(size=(1, N_STEP, 26, 3))
    difference[..., 2] = 0.0
    assert np.isfinite(local_profile(LINE, difference)).all()


def test_the_covariance_has_the_profile_at_each_point() -> None:
    """Against the dense covariance, entry by entry."""
    noise = 1e-6
    field = FieldData(
        points=LINE,
        displacement=np.zeros((N_STEP, 26, 3)),
        noise_std=np.full(3, noise),
        correlation_length=0.5,
        reference_share=0.5,
    )
    profile = np.linspace(0.5, 2.0, 26)
    covariance = field_covariance(field, floor=FieldFloor(SD, profile))
    smooth = spatial_correlation(LINE, FLOOR_LENGTH, nugget=FLOOR_NUGGET)
    shared = step_correlation(N_STEP, FLOOR_SHARED)
    for i, p, c in ((0, 3, 0), (1, 25, 2)):
        unit = np.zeros((1, N_STEP, 26, 3))
        unit[0, i, p, c] = 1.0
        column = covariance.applied(unit)[0, :, :, c]
        over_steps = shared[:, i] * SD[:, c] * SD[i, c]
        expected = np.outer(over_steps, profile * profile[p] * smooth[:, p])
        np.testing.assert_allclose(column, expected, rtol=1e-6, atol=2 * noise**2)
    one = field_covariance(field, floor=FieldFloor(SD, np.ones(26)))
    even = field_covariance(field, floor=FieldFloor(SD, profile).even)
    np.testing.assert_allclose(one.logdet, even.logdet, rtol=1e-12)
    assert covariance.logdet != pytest.approx(even.logdet, rel=1e-4)


def test_a_scaled_floor_keeps_its_profile() -> None:
    profile = np.linspace(0.5, 2.0, 26)
    found = FieldFloor(SD, profile).scaled(0.4)
    assert np.array_equal(found.sd, 0.4 * SD)
    assert found.profile is profile


@pytest.mark.parametrize(
    ("floor", "named"),
    [
        (FieldFloor(SD, np.ones(25)), "profile of 26"),
        (FieldFloor(SD, np.full(26, -1.0)), "profile of 26"),
        (FieldFloor(SD, np.full(26, np.nan)), "profile of 26"),
        (FieldFloor(SD[:1]), "expected 2 x 3 SDs"),
        (FieldFloor(-SD), "expected 2 x 3 SDs"),
        (-1e-3, "expected 2 x 3 SDs"),
    ],
)
def test_a_floor_that_does_not_fit_the_field_is_refused(
    floor: FieldFloor | float, named: str
) -> None:
    field = FieldData(LINE, np.zeros((N_STEP, 26, 3)), np.full(3, 0.01), 0.5, 0.5)
    with pytest.raises(ValueError, match=named):
        field_covariance(field, floor=floor)
