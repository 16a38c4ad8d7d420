"""The likelihood of a field by tables, in the fields that are independent of each other."""

from __future__ import annotations

import numpy as np
from test_calib_inference_nuisances import BOUNDS, NOISE, THETA, build

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
