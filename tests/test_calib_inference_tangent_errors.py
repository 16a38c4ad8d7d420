"""Errors of a field with the size that a difference has in the parameters."""

from __future__ import annotations

import numpy as np
import pytest

from calib.data import FieldData
from calib.inference.field_noise import field_covariance
from calib.inference.tangent_errors import TRAVEL_LENGTH, mistaken, tangent_errors
from fe.response import Array

N_STEP, N_POINT, D = 4, 25, 2
TRAVEL = np.array([0.6, 0.8, 1.0, 1.2])


def field() -> FieldData:
    rng = np.random.default_rng(1)
    return FieldData(
        points=rng.random((N_POINT, 2)) * 3,
        displacement=np.zeros((N_STEP, N_POINT, 3)),
        noise_std=np.array([0.01, 0.01, 0.02]),
        correlation_length=0.5,
        reference_share=0.5,
    )


def smooth(n: int) -> Array:
    """(n, ...) changes of a field."""
    x, y = field().points.T
    waves = [np.sin((1 + k) * x) + np.cos((2 + k) * y) for k in range(3 * n)]
    by_step = 0.1 * TRAVEL[:, None, None] ** np.arange(1, n + 1)[:, None, None, None]
    return by_step * np.array(waves).reshape(n, 3, N_POINT).transpose(0, 2, 1)[:, None]


def test_shifts_are_those_of_least_squares_in_the_noise_of_the_field() -> None:
    tangents, difference = smooth(D), np.random.default_rng(2).normal(size=(N_STEP, N_POINT, 3))
    covariance = field_covariance(field())
    gram = covariance.inner(tangents, tangents)
    single = np.einsum("ij,ipx->jipx", np.eye(N_STEP), difference)
    shifts = np.linalg.solve(gram, covariance.inner(tangents, single))
    rho = np.exp(-np.abs(np.subtract.outer(TRAVEL, TRAVEL)) / TRAVEL_LENGTH)
    found = mistaken(field(), TRAVEL, tangents, difference[None])
    assert found @ found.T == pytest.approx(shifts @ rho @ shifts.T, rel=1e-8)


def test_what_looks_like_other_parameters_has_their_size() -> None:
    tangents, shift = smooth(D), np.array([0.03, -0.2])
    difference = np.tensordot(shift, tangents, 1)
    # Travels that are as good as one: the shifts by all increments add up.
    found = mistaken(field(), 1.0 + 1e-9 * TRAVEL, tangents, difference[None])
    assert found @ found.T == pytest.approx(np.outer(shift, shift), rel=1e-6)


def test_a_parameter_that_is_not_seen_is_left_alone() -> None:
    tangents = smooth(D)
    difference = 0.1 * tangents[0]
    unseen = np.concatenate([tangents[:1], np.zeros_like(tangents[:1])])
    # Nor does one that does the same as another blow up.
    twice = np.concatenate([tangents[:1], tangents[:1]])
    known = tangent_errors(mistaken(field(), TRAVEL, tangents[:1], difference[None]), tangents[:1])
    for both in (unseen, twice):
        found = tangent_errors(mistaken(field(), TRAVEL, both, difference[None]), both)
        assert found == pytest.approx(known)
