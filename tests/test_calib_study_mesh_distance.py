"""What is said of a posterior that lies far from where its mesh was checked."""

from __future__ import annotations

import numpy as np

from calib.study.mesh_distance import FAR, NEAR, too_far, unsettled

PLACE = np.array([0.3, 0.1])
EXTENT = np.array([1.0, 0.5])
NAMES = ("r", "s")


def test_a_posterior_beside_its_last_check_is_not_spoken_of() -> None:
    sd = np.array([0.01, 0.01])
    assert unsettled(PLACE, PLACE + 0.99 * FAR * sd, sd, EXTENT, NAMES) == ""


def test_one_beyond_three_sds_is_named_with_the_worst_constant_and_its_distance() -> None:
    sd = np.array([0.01, 0.002])
    said = unsettled(PLACE, PLACE + np.array([0.02, -0.01]), sd, EXTENT, NAMES)
    assert "s = 0.1, 5.0 SD from the posterior mean 0.09" in said


def test_a_wide_posterior_is_far_beyond_a_tenth_of_the_box() -> None:
    sd = np.array([0.2, 0.1])
    off = np.array([0.0, 1.01 * NEAR * EXTENT[1]])
    assert too_far(off, sd, EXTENT).tolist() == [False, True]
    assert not too_far(0.98 * off, sd, EXTENT).any()
