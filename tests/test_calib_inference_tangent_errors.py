"""Errors of a field with the size that a difference has in the parameters."""

from __future__ import annotations

import numpy as np
import pytest

from calib.data import FieldData
from calib.inference.field_noise import field_covariance
from calib.inference.noise import ZERO, slope_matrix
from calib.inference.shared_error import SharedError
from calib.inference.tangent_errors import TRAVEL_LENGTH, mistaken, with_shared
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
    assert found**2 == pytest.approx(np.diag(shifts @ rho @ shifts.T), rel=1e-8)


def test_what_looks_like_other_parameters_has_their_size() -> None:
    tangents, shift = smooth(D), np.array([0.03, -0.2])
    difference = np.tensordot(shift, tangents, 1)
    # Travels that are as good as one: the shifts by all increments add up.
    found = mistaken(field(), 1.0 + 1e-9 * TRAVEL, tangents, difference[None])
    assert found == pytest.approx(np.abs(shift), rel=1e-6)


def test_a_parameter_that_is_not_seen_is_left_alone() -> None:
    tangents = smooth(D)
    difference = 0.1 * tangents[0]
    unseen = np.concatenate([tangents[:1], np.zeros_like(tangents[:1])])
    known = mistaken(field(), TRAVEL, tangents[:1], difference[None])
    assert mistaken(field(), TRAVEL, unseen, difference[None]) == pytest.approx([known[0], 0.0])
    # Nor does one that does the same as another blow up: each is half of it.
    twice = np.concatenate([tangents[:1], tangents[:1]])
    assert mistaken(field(), TRAVEL, twice, difference[None]) == pytest.approx(known[0] / 2)


def test_what_is_known_of_a_parameter_holds_it() -> None:
    tangents, difference = smooth(D), np.random.default_rng(3).normal(size=(N_STEP, N_POINT, 3))
    free = mistaken(field(), TRAVEL, tangents, difference[None])
    for sd, expected in (
        (1e3, free),
        (0.0, mistaken(field(), TRAVEL, tangents[:1], difference[None])),
    ):
        found = mistaken(field(), TRAVEL, tangents, difference[None], np.array([np.inf, sd]))
        assert found[: len(expected)] == pytest.approx(expected, rel=1e-6)
    assert found[1] == 0.0


def test_two_differences_add_up_and_the_sizes_do_not_hang_on_the_other_parameters_sign() -> None:
    tangents, shift = smooth(D), np.array([0.03, -0.2])
    same, turned = (np.tensordot(shift * sign, tangents, 1) for sign in ([1, 1], [1, -1]))
    found = mistaken(field(), 1.0 + 1e-9 * TRAVEL, tangents, np.stack([same, turned]))
    assert found == pytest.approx(np.sqrt(2) * np.abs(shift), rel=1e-6)


def test_a_shared_error_moves_a_field_as_in_the_likelihood() -> None:
    displacement = 0.1 * TRAVEL[:, None, None] ** 2 * np.ones((N_STEP, N_POINT, 3))
    slope = slope_matrix(TRAVEL)
    zero = SharedError(ZERO, "mm", 0.02, 0.02 * slope, 0.02 * slope)
    found = with_shared(smooth(D), displacement, [zero])
    assert found[:D] == pytest.approx(smooth(D))
    expected = 0.2 * TRAVEL[:, None, None] * np.ones((N_STEP, N_POINT, 3))
    assert found[D] == pytest.approx(expected, rel=1e-9)
    assert with_shared(smooth(D), displacement, []) == pytest.approx(smooth(D))
