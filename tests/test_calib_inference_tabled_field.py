"""The likelihood of a field by tables, in the fields that are independent of each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_calib_inference_nuisances import BOUNDS, NOISE, THETA, build

from calib.inference.field_scales import FieldSizes
from calib.inference.forward import FieldBasis, Prediction

NAMES = ("field_noise", "discrepancy")


def test_changes_that_are_the_same_but_for_a_factor_are_held_once() -> None:
    """Zero of the travel, tilt and scale share shapes with each other and with the modes."""
    like = build(NOISE, {name: BOUNDS[name] for name in NAMES}, 0.02)
    assert like.field is not None and like.field.basis.modes is not None
    tabled, k = like.field._tabled, len(like.field.basis.modes)
    # modes, the measured field; slopes of k + 1 fields, these times the force, the offset
    assert len(tabled.shared) == 5
    assert tabled.table.s <= k + 1 + 2 * (k + 1) + 1


def test_a_batch_of_any_length_has_the_densities_of_its_rows() -> None:
    like = build(NOISE, {name: BOUNDS[name] for name in NAMES}, 0.02)
    rng = np.random.default_rng(3)
    low, high = np.log([BOUNDS[name] for name in NAMES]).T
    assert like.field is not None
    sizes = low + (high - low) * rng.random((2 * like.field._tabled.rows + 7, 2))
    theta = np.column_stack([THETA[np.arange(len(sizes)) % len(THETA)], sizes])
    together = like.log_prob(theta)
    some = np.arange(0, len(theta), 29)
    single = np.concatenate([like.log_prob(row[None]) for row in theta[some]])
    np.testing.assert_allclose(together[some], single, rtol=1e-10)
    assert like.log_prob(theta[:0]).shape == (0,)


@pytest.mark.parametrize("apart", [1e-3, 1e-6, 1e-10, 0.0])
def test_modes_that_are_nearly_one_leave_the_density_right(apart: float) -> None:
    """Held to the direct covariance; the weights of such modes would be large and cancel."""
    rng = np.random.default_rng(5)
    like = build(NOISE, {name: BOUNDS[name] for name in NAMES}, 0.0).field
    assert like is not None and like.basis.modes is not None
    modes = like.basis.modes[:3].copy()
    size = np.sqrt(np.mean(modes[0] ** 2))
    modes[1] = 0.7 * modes[0] + apart * size * rng.standard_normal(modes[0].shape)
    like = like.with_basis(replace(like.basis, modes=modes))
    weights = rng.standard_normal((4, 3))
    sizes = FieldSizes(np.array([0.3, 1.0, 2.0, 3.9]), np.array([0.002, 0.01, 0.1, 0.29]))
    found = like.along(Prediction(np.ones((4, 5)), None, weights), None, sizes)
    whole = FieldBasis(like.basis.offset, None, like.basis.truncation)
    fields = (like.basis.fields(weights) - like.basis.offset).reshape(4, -1)
    expected = like.with_basis(whole).along(Prediction(np.ones((4, 5)), None, fields), None, sizes)
    np.testing.assert_allclose(found.value, expected.value, rtol=1e-9)
    np.testing.assert_allclose(found.slope, expected.slope, rtol=1e-7, atol=1e-6)
