"""Products with an inverse covariance of unknown sizes are met at any of these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ortho_group

from calib.data import FieldData
from calib.inference.field_noise import FieldCovariance, field_covariance
from calib.inference.field_table import FieldTable

RNG = np.random.default_rng(20261129)
X, Y = np.meshgrid(np.linspace(0.0, 3.0, 5), np.linspace(0.2, 2.0, 4), indexing="ij")
POINTS = np.stack([X.ravel(), Y.ravel()], axis=1)
SHAPE = (3, len(POINTS), 3)
FIELDS = RNG.standard_normal((4, *SHAPE)) * np.array([0.5, 0.1, 0.02, 1e-3])[:, None, None, None]
PATTERNS = 0.3 * RNG.standard_normal((6, *SHAPE))
NOISE, SHARE = (0.2, 5.0), (1e-3, 2.0)
UPPER = np.triu_indices(len(FIELDS))


def covariance() -> FieldCovariance:
    field = FieldData(POINTS, np.zeros(SHAPE), np.array([0.01, 0.01, 0.02]), 0.5, 0.5)
    return field_covariance(field, floor=0.003, patterns=0.005 * RNG.standard_normal((2, *SHAPE)))


COVARIANCE = covariance()


def table(noise: tuple[float, float] | None, share: tuple[float, float] | None) -> FieldTable:
    patterns = PATTERNS if share is not None else PATTERNS[:0]
    return FieldTable(FIELDS, COVARIANCE, patterns, noise, share)


def direct(noise: float, share: float) -> np.ndarray:
    """By the covariance at the sizes themselves."""
    own = replace(COVARIANCE, noise_variance=COVARIANCE.noise_variance * noise**2)
    own = own.with_patterns(share * PATTERNS)
    logdet = own.logdet - 2.0 * FIELDS[0].size * np.log(noise)
    return np.append(noise**2 * own.inner(FIELDS, FIELDS)[UPPER], logdet)


def off(found: np.ndarray, noise: float, share: float) -> float:
    """Largest error, in units of the fields' own products and of the number of values."""
    expected = direct(noise, share)
    own = np.sqrt(expected[:-1][UPPER[0] == UPPER[1]])
    size = np.append(own[UPPER[0]] * own[UPPER[1]], FIELDS[0].size)
    return float(np.max(np.abs(found - expected) / size))


def test_products_are_met_everywhere_within_the_bounds() -> None:
    """At draws, at the corners and on the edges of tiles."""
    noise = np.exp(RNG.uniform(*np.log(NOISE), 60))
    share = np.exp(RNG.uniform(*np.log(SHARE), 60))
    noise[:4], share[:4] = np.repeat(NOISE, 2), np.tile(SHARE, 2)
    known = table(NOISE, SHARE)
    for index, edges in enumerate(known._edges):
        n = len(edges)
        (noise, share)[index][10 : 10 + n] = np.exp(edges)
    for found, b, a in zip(known.at(noise, share), noise, share, strict=True):
        assert off(found, b, a) < 1e-9


@pytest.mark.parametrize("which", ["noise", "share"])
def test_a_size_that_is_known_is_one(which: str) -> None:
    known = table(*((NOISE, None) if which == "noise" else (None, SHARE)))
    size = np.array([0.25, 0.9, 1.7])
    one = np.ones(3)
    found = known.at(*((size, one) if which == "noise" else (one, size)))
    for row, value in zip(found, size, strict=True):
        assert off(row, *((value, 0.0) if which == "noise" else (1.0, value))) < 1e-8


def test_bounds_that_are_equal_are_one_size() -> None:
    found = table((0.7, 0.7), SHARE).at(np.array([0.7]), np.array([0.1]))
    assert off(found[0], 0.7, 0.1) < 1e-8


def test_what_is_found_does_not_depend_on_what_was_asked_before() -> None:
    noise, share = np.array([0.3, 1.1, 4.0]), np.array([0.002, 0.1, 1.5])
    first, second = table(NOISE, SHARE), table(NOISE, SHARE)
    forward = [first.at(noise[i : i + 1], share[i : i + 1]) for i in range(3)]
    backward = [second.at(noise[i : i + 1], share[i : i + 1]) for i in (2, 1, 0)]
    assert np.array_equal(np.array(forward), np.array(backward[::-1]))


def test_sizes_beyond_the_bounds_are_taken_to_these() -> None:
    known = table(NOISE, SHARE)
    found = known.at(np.array([0.1, 9.0]), np.array([1e-4, 3.0]))
    np.testing.assert_allclose(found, known.at(np.array(NOISE), np.array(SHARE)), rtol=1e-12)


def test_an_unknown_size_that_is_no_number_gives_none() -> None:
    found = table(NOISE, SHARE).at(np.array([np.nan, 1.0]), np.array([0.1, 0.1]))
    assert np.isnan(found[0]).all() and np.isfinite(found[1]).all()


def test_many_patterns_of_one_direction_are_no_trouble() -> None:
    """The discrepancy's products with itself are singular then."""
    turned = ortho_group.rvs(12, random_state=1)[:, :6] @ PATTERNS.reshape(6, -1)
    known = FieldTable(FIELDS, COVARIANCE, turned.reshape(12, *SHAPE), NOISE, SHARE)
    assert off(known.at(np.array([0.7]), np.array([0.3]))[0], 0.7, 0.3) < 1e-8
