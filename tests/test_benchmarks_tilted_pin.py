"""A tilted pin, by an independent code: the front face sees it as travel, the force does not."""

from __future__ import annotations

from functools import cache

import pytest

pytest.importorskip("felupe")

from benchmarks.tilted_pin import Tilt, tilt


@cache
def tilted(angle: float) -> Tilt:
    """By `angle` degrees at a travel of 0.6 mm."""
    return tilt((6, 3, 6), 0.6, angle)


def test_the_face_sees_a_tilt_as_two_thirds_of_the_travel_at_its_place() -> None:
    found = tilted(0.5)
    assert 0.6 < found.share < 0.75
    # Upwards it is all of it: the face is pressed as the slice behind it.
    assert found.by_component[1] == pytest.approx(1.0, abs=0.06)
    assert found.left < 0.5 * found.rms
    assert abs(found.force) < 0.002  # 0.11 for as much travel everywhere


def test_the_change_is_linear_in_the_tilt() -> None:
    one, two = (tilted(angle) for angle in (0.25, 0.5))
    assert two.rms / one.rms == pytest.approx(2.0, rel=0.02)
    assert two.share == pytest.approx(one.share, rel=0.02)
