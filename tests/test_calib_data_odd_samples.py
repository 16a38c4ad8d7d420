"""A sample that is not as stiff as the others is named."""

from __future__ import annotations

import numpy as np
import pytest

from calib.data.dataset import SampleData
from calib.data.odd_samples import FEWEST, RARE, odd_samples

CURVE = np.array([1.0, 2.1, 4.4])


def samples(level: np.ndarray) -> SampleData:
    names = tuple(f"S{i}" for i in range(len(level)))
    force = np.exp(level)[:, None] * CURVE
    return SampleData(names, force, np.zeros((len(level), len(CURVE), 0, 3)))


def test_a_sample_of_twice_the_stiffness_is_named_and_no_other() -> None:
    level = 0.05 * np.random.default_rng(3).standard_normal(8)
    assert odd_samples(samples(level)) == []
    level[5] = np.log(2.0)
    [said] = odd_samples(samples(level))
    assert said.startswith("sample S5 takes 2.")
    level[5] = -np.log(2.0)
    [said] = odd_samples(samples(level))
    assert said.startswith("sample S5 takes 0.")


@pytest.mark.parametrize("n", [FEWEST, 8, 23])
def test_of_samples_alike_one_set_in_a_hundred_is_doubted(n: int) -> None:
    """False alarm 1e-4: the share, at most 1 %, is held to four standard errors."""
    rng, sets = np.random.default_rng(n), 2000
    doubted = sum(bool(odd_samples(samples(0.1 * rng.standard_normal(n)))) for _ in range(sets))
    assert doubted / sets < RARE + 4.0 * np.sqrt(RARE / sets)
    assert doubted / sets > RARE - 4.0 * np.sqrt(RARE / sets)


def test_too_few_samples_and_forces_that_pull_say_nothing() -> None:
    assert odd_samples(None) == []
    assert odd_samples(samples(np.array([0.0, 0.01, 3.0]))) == []
    assert odd_samples(samples(np.zeros(5))) == []
    pulled = samples(np.array([0.0, 0.02, -0.02, 0.01, 3.0]))
    pulled.force[0, 0] = -0.1
    assert odd_samples(pulled) == []
