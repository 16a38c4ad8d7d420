"""Polygons that enclose something."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fe.response import Array

SIMPLE = "corners one after the other around an area, whose sides do not cross"


def encloses(corners: Sequence[tuple[float, float]]) -> bool:
    """Whether a polygon has an area and no two of its sides cross."""
    here = np.array(corners, dtype=np.float64)
    then = np.roll(here, -1, axis=0)

    def turns(places: Array) -> Array:
        """(n, n) on which side of each of the polygon's sides each place lies."""
        side, to = (then - here)[:, None], places - here[:, None]
        signs: Array = np.sign(side[..., 0] * to[..., 1] - side[..., 1] * to[..., 0])
        return signs

    apart = turns(here) * turns(then) < 0  # the line of one side parts the ends of another
    area = 0.5 * np.sum(here[:, 0] * then[:, 1] - here[:, 1] * then[:, 0])
    return bool(abs(area) > 1e-9 and not np.any(apart & apart.T))
