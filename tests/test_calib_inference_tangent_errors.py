"""Errors of a field with the size that a difference has in the parameters."""

from __future__ import annotations

import numpy as np
import pytest

from calib.data import FieldData
from calib.inference.field_floor import FieldFloor
from calib.inference.field_noise import field_covariance
from calib.inference.noise import ZERO, slope_matrix
from calib.inference.shared_error import SharedError
from calib.inference.tangent_errors import TRAVEL_LENGTH, apart, mistaken, with_nuisances
from fe.response import Array

N_STEP, N_POINT, D = 4, 25, 2
TRAVEL = np.array([0.6, 0.8, 1.0, 1.2])
BOX = np.array([[0.0, 1.0], [0.0, 0.5]])


def field() -> FieldData:
    rng = np.random.default_rng(1)
    return FieldData(
        points=rng.random((N_POINT, 2)) * 3,
        displacement=np.zeros((N_STEP, N_POINT, 3)),
        noise_std=np.array([0.01, 0.01, 0.02]),
        correlation_length=0.5,
        reference_share=0.5,
    )


NOISE = field_covariance(field())


def smooth(n: int) -> Array:
    """(n, ...) changes of a field."""
    x, y = field().points.T
    waves = [np.sin((1 + k) * x) + np.cos((2 + k) * y) for k in range(3 * n)]
    by_step = 0.1 * TRAVEL[:, None, None] ** np.arange(1, n + 1)[:, None, None, None]
    return by_step * np.array(waves).reshape(n, 3, N_POINT).transpose(0, 2, 1)[:, None]


def test_shifts_are_those_of_least_squares_in_the_noise_of_the_field() -> None:
    tangents, difference = smooth(D), np.random.default_rng(2).normal(size=(N_STEP, N_POINT, 3))
    gram = NOISE.inner(tangents, tangents)
    single = np.einsum("ij,ipx->jipx", np.eye(N_STEP), difference)
    shifts = np.linalg.solve(gram, NOISE.inner(tangents, single))
    rho = np.exp(-np.abs(np.subtract.outer(TRAVEL, TRAVEL)) / TRAVEL_LENGTH)
    found = mistaken(NOISE, TRAVEL, tangents, difference[None])
    assert found == pytest.approx(shifts @ rho @ shifts.T, rel=1e-8)


def test_what_looks_like_other_parameters_has_their_size() -> None:
    tangents, shift = smooth(D), np.array([0.03, -0.2])
    difference = np.tensordot(shift, tangents, 1)
    # Travels that are as good as one: the shifts by all increments add up.
    found = mistaken(NOISE, 1.0 + 1e-9 * TRAVEL, tangents, difference[None])
    assert found == pytest.approx(np.outer(shift, shift), rel=1e-6)


def test_what_the_other_errors_hold_is_not_mistaken_for_parameters() -> None:
    """A difference at one place, where a model is stated to err: almost nothing is left of it."""
    tangents, difference = smooth(D), np.zeros((N_STEP, N_POINT, 3))
    difference[:, 7] = 0.05
    profile = np.full(N_POINT, 0.01)
    profile[7] = 5.0
    floors = [FieldFloor(np.full((N_STEP, 3), 0.1), own) for own in (None, profile)]
    even, local = (
        np.sqrt(np.diag(mistaken(errors, TRAVEL, tangents, difference[None])))
        for errors in (field_covariance(field(), floor=floor) for floor in floors)
    )
    assert np.all(local < 0.1 * even)


def test_a_parameter_that_is_not_seen_is_left_alone() -> None:
    tangents = smooth(D)
    difference = 0.1 * tangents[0]
    unseen = np.concatenate([tangents[:1], np.zeros_like(tangents[:1])])
    [[known]] = mistaken(NOISE, TRAVEL, tangents[:1], difference[None])
    found = mistaken(NOISE, TRAVEL, unseen, difference[None])
    assert found == pytest.approx(np.array([[known, 0.0], [0.0, 0.0]]))
    # Nor does one that does the same as another blow up: each is half of it.
    twice = np.concatenate([tangents[:1], tangents[:1]])
    found = mistaken(NOISE, TRAVEL, twice, difference[None])
    assert found == pytest.approx(np.full((2, 2), known / 4))


def test_what_is_known_of_a_parameter_holds_it() -> None:
    [tangent], difference = smooth(1), np.random.default_rng(3).normal(size=(N_STEP, N_POINT, 3))
    [[free]] = mistaken(NOISE, TRAVEL, tangent[None], difference[None])
    [[information]] = NOISE.inner(tangent[None], tangent[None])
    for sd in (0.0, 0.5 / np.sqrt(information), 3.0 / np.sqrt(information)):
        held = 0.0 if sd == 0 else free * (information / (information + sd**-2)) ** 2
        found = mistaken(NOISE, TRAVEL, tangent[None], difference[None], np.array([sd]))
        assert found == pytest.approx(held, rel=1e-8)


def test_ratios_are_stated_each_on_its_own_and_nuisances_together() -> None:
    tangents = smooth(4)
    shift = np.array([0.03, -0.2, 0.01, -0.02])
    found = apart(np.outer(shift, shift), ("zero", "scale"), BOX)
    patterns = found.patterns(tangents)
    expected = np.concatenate(
        [
            np.abs(shift[:2, None, None, None]) * tangents[:2],
            np.tensordot(shift[2:], tangents[2:], 1)[None],
        ]
    ).reshape(3, -1)
    stated = patterns.reshape(4, -1)
    np.testing.assert_allclose(stated.T @ stated, expected.T @ expected, atol=1e-12)


def test_a_second_nuisance_that_does_the_same_takes_nothing_from_what_is_stated() -> None:
    tangents = smooth(D)
    difference = 0.1 * tangents[1] + 0.05 * tangents[0]
    total = []
    for copies in (1, 3):
        more = np.concatenate([tangents, *[tangents[1:]] * (copies - 1)])
        names = tuple(f"nuisance {k}" for k in range(copies))
        found = apart(mistaken(NOISE, TRAVEL, more, difference[None]), names, BOX)
        stated = found.patterns(more).reshape(len(more), -1)
        total.append(stated.T @ stated)
    np.testing.assert_allclose(total[0], total[1], atol=1e-10 * np.abs(total[0]).max())


def test_a_nuisance_moves_a_field_as_in_the_likelihood() -> None:
    displacement = 0.1 * TRAVEL[:, None, None] ** 2 * np.ones((N_STEP, N_POINT, 3))
    slope = slope_matrix(TRAVEL)
    zero = SharedError(ZERO, "mm", 0.02, 0.02 * slope, 0.02 * slope)
    found = with_nuisances(smooth(D), displacement, [zero])
    assert found[:D] == pytest.approx(smooth(D))
    expected = 0.2 * TRAVEL[:, None, None] * np.ones((N_STEP, N_POINT, 3))
    assert found[D] == pytest.approx(expected, rel=1e-9)
    assert with_nuisances(smooth(D), displacement, []) == pytest.approx(smooth(D))
