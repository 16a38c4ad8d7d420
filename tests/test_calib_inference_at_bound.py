"""Bounds of the prior that a posterior leans on are named, and others are not."""

from __future__ import annotations

import numpy as np
import pytest

from calib.inference.at_bound import AtBound, at_bound, leaning_sentence

BOUNDS = np.array([[np.log(0.001), np.log(0.1)], [0.0, 1.0], [0.0, 0.25]])
N = 20_000


def _draws() -> np.ndarray:
    """Far from all bounds: the nearest is ten SDs away."""
    rng = np.random.default_rng(8)
    return np.array([-4.5, 0.5, 0.1]) + np.array([0.05, 0.05, 0.01]) * rng.standard_normal((N, 3))


def test_a_posterior_inside_leans_on_nothing() -> None:
    assert at_bound(_draws(), BOUNDS) == ()
    assert leaning_sentence("stuck", ()) == ""


def test_exponential_posteriors_at_zero_are_named_with_what_zero_means() -> None:
    rng = np.random.default_rng(9)
    draws = _draws()
    draws[:, 1:] = rng.exponential([0.01, 0.0005], (N, 2))
    found = at_bound(draws, BOUNDS)
    assert [(entry.parameter, entry.side, entry.value) for entry in found] == [
        ("r", "low", 0.0),
        ("s", "low", 0.0),
    ]
    # An exponential is highest at its bound.
    assert [entry.density_ratio for entry in found] == [1.0, 1.0]
    text = leaning_sentence("stuck", found)
    assert "r = 0 (C01 is not negative) and s = 0 (C11 is not negative)" in text
    assert "convention of the prior" in text


@pytest.mark.parametrize(("distance", "leans"), [(1.5, True), (2.8, False)])
def test_a_normal_leans_when_its_bound_is_within_two_sds(distance: float, leans: bool) -> None:
    """Density ratios 0.32 and 0.02 against 0.135, known to 0.01: false alarm below 1e-9."""
    rng = np.random.default_rng(10)
    draws = _draws()
    normal = 1.0 - 0.1 * (distance - rng.standard_normal(4 * N))
    draws[:, 1] = normal[normal < 1.0][:N]
    found = at_bound(draws, BOUNDS)
    assert [(entry.parameter, entry.side) for entry in found] == [("r", "high")] * leans


@pytest.mark.parametrize("share", [0.2, 0.3, 0.4, 0.5])
def test_two_narrow_ranges_lean_on_no_bound_that_is_far_in_their_own_sds(share: float) -> None:
    """Five SDs from the bounds each, though a quarter of the SD of both would reach them."""
    rng = np.random.default_rng(12)
    draws = _draws()
    places = rng.choice([0.1, 0.9], N, p=[share, 1.0 - share])
    draws[:, 1] = places + 0.02 * rng.standard_normal(N)
    assert at_bound(draws, BOUNDS) == ()


def test_a_bound_of_kappa_is_given_in_mpa() -> None:
    draws = _draws()
    draws[:, 0] = np.random.default_rng(11).uniform(*BOUNDS[0], N)
    found = at_bound(draws, BOUNDS)
    assert [entry.value for entry in found] == pytest.approx([0.001, 0.1])
    assert found[0].text == "kappa = 0.001 MPa"


def test_a_side_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="expected low or high"):
        AtBound("r", "left", 0.0, 1.0)


def test_where_the_constants_have_the_priors_their_bounds_count() -> None:
    """C10 lies at its lower bound, r inside and at the edge of the box about both."""
    rng = np.random.default_rng(12)
    c10, c01 = 0.001 + rng.exponential(0.0005, N), rng.normal(0.006, 0.0004, N)
    kappa, s = c10 + c01, rng.normal(0.1, 0.005, N)
    draws = np.column_stack([np.log(kappa), c01 / kappa, s])
    stated = np.array([[0.001, 0.02], [0.0, 0.02], [0.0, 0.004]])
    bounds = np.array([[np.log(0.001), np.log(0.04)], [0.0, draws[:, 1].max()], [0.0, 0.1]])
    found = at_bound(draws, bounds, None, stated)
    assert [(entry.parameter, entry.side) for entry in found] == [("C10", "low")]
    assert found[0].text == "C10 = 0.001 MPa"
    assert "s" in {entry.parameter for entry in at_bound(draws, bounds)}
