"""What is said of a posterior that lies far from where its mesh was checked."""

from __future__ import annotations

import numpy as np

from calib.inference.tangent_errors import Mistaken
from calib.study.mesh_remarks import (
    FAR,
    NEAR,
    distance,
    distance_sentence,
    errors_sentence,
)

PLACE = np.array([0.3, 0.1])
EXTENT = np.array([1.0, 0.5])
NAMES = ("r", "s")


def test_a_posterior_beside_its_last_check_is_not_spoken_of() -> None:
    sd = np.array([0.01, 0.01])
    assert distance_sentence(PLACE, PLACE + 0.99 * FAR * sd, sd, EXTENT, NAMES) == ""


def test_the_constant_that_is_furthest_is_named_with_its_distance_and_the_limit() -> None:
    sd = np.array([0.01, 0.002])
    said = distance_sentence(PLACE, PLACE + np.array([0.02, -0.01]), sd, EXTENT, NAMES)
    assert "s = 0.1, 0.01 from the posterior mean: more than 3 posterior SDs" in said


def test_a_wide_posterior_is_far_beyond_a_tenth_of_the_box() -> None:
    sd = np.array([0.2, 0.1])
    off = np.array([0.0, 1.01 * NEAR * EXTENT[1]])
    assert (distance(off, sd, EXTENT) > 1.0).tolist() == [False, True]
    said = distance_sentence(PLACE, PLACE + off, sd, EXTENT, NAMES)
    assert "more than 10% of the prior's range" in said


def test_errors_of_the_mesh_are_told_by_constant_and_nuisance() -> None:
    sizes = np.diag(np.square([0.004, 0.0012]))
    box = np.array([[0.0, 1.0], [0.0, 0.5]])
    names = ("zero of the travel", "scale of the field")
    found = Mistaken(np.array([0.03, 0.0051]), names, sizes, box)
    said = errors_sentence(found, ("r", "s"), ("mm", "1"))
    assert said.endswith(
        "r by 0.03, s by 0.0051, the zero of the travel by 0.004 mm and the scale of the field by "
        "0.0012."
    )
    alone = Mistaken(np.array([0.03]), (), np.zeros((0, 0)), box[:1])
    assert errors_sentence(alone, ("r",), ()).endswith("part of those above, r by 0.03.")
