"""A sample whose field is turned over, or of another scale, is found beside the others."""

from __future__ import annotations

import numpy as np
import pytest

from calib.data.qc.likeness import FEWEST_POINTS, unlike, unlike_doubts
from calib.data.qc.quality import Rejection

NUMBERS = (3, 4, 5, 6, 7)


def fields(n: int) -> np.ndarray:
    """(n, 5, 60, 3) mm of samples that differ by some percent, as those of a laboratory do."""
    rng = np.random.default_rng(n)
    place = rng.random((60, 2))
    shape = (
        np.stack([0.7 * place[:, 0], -0.3 * place[:, 1], 0.4 * np.cos(place[:, 0])], axis=1)
        * np.linspace(0.4, 1.0, 5)[:, None, None]
    )
    scale = 1.0 + 0.02 * rng.standard_normal((n, 1, 1, 3))
    found: np.ndarray = scale * shape + 0.005 * rng.standard_normal((n, 5, 60, 3))
    return found


def names(n: int) -> list[str]:
    return [f"S{i}" for i in range(n)]


@pytest.mark.parametrize("n", [3, 4, 5, 12])
@pytest.mark.parametrize("component", [0, 1, 2])
def test_a_component_of_the_other_sign_rejects_its_sample_alone(n: int, component: int) -> None:
    measured = fields(n)
    assert unlike(names(n), measured, []) == []
    assert unlike_doubts(names(n), measured, NUMBERS) == []
    measured[1, ..., component] *= -1.0
    [found] = unlike(names(n), measured, [])
    assert (found.sample, found.rule) == ("S1", "protocol")
    assert f"displacement along {'xyz'[component]} over" in found.reason
    assert isinstance(found.value, float) and -1.1 < found.value < -0.9
    assert "expected 0.5 to 2" in found.text()


@pytest.mark.parametrize("n", [3, 5])
def test_another_scale_or_a_frame_that_moved_is_told(n: int) -> None:
    measured = fields(n)
    measured[2, ..., 2] *= 0.6
    [said] = unlike_doubts(names(n), measured, NUMBERS)
    assert said.startswith("the displacement of sample S2 along z is 4")
    measured = fields(n)
    measured[2, 3, :, 1] += 0.1
    [said] = unlike_doubts(names(n), measured, NUMBERS)
    assert "sample S2 along y" in said and "at increment 6" in said
    assert unlike(names(n), measured, []) == []


def test_what_says_nothing_is_not_judged() -> None:
    measured = fields(4)
    measured[1, ..., 0] *= -1.0
    rejected = [Rejection("S1", "protocol", "it broke", 1.0, 0.0, "")]
    assert unlike(names(4), measured, rejected) == []  # it is out already
    assert unlike(names(2), measured[:2], []) == []  # of two neither is the usual one
    few = measured.copy()
    few[0, :, FEWEST_POINTS - 1 :] = np.nan
    assert unlike(names(4), few, []) == []
    noise = fields(4)
    noise[..., 2] = 0.001 * np.random.default_rng(0).standard_normal(noise.shape[:-1])
    assert unlike(names(4), noise, []) == []  # a component of noise alone
    assert unlike_doubts(names(4), noise, NUMBERS) == []
    assert unlike(names(4), np.full((4, 5, 60, 3), np.nan), []) == []
    none = fields(4)
    none[3, ..., 2] = 0.0  # one sample without z: x and y are judged all the same
    none[1, ..., 0] *= -1.0
    assert [one.sample for one in unlike(names(4), none, [])] == ["S1"]
    small = fields(4)
    small[:, 0] = 0.05 * small[:, 0] + 0.01 * np.random.default_rng(0).standard_normal((4, 60, 3))
    assert unlike_doubts(names(4), small, NUMBERS) == []  # an increment of noise
