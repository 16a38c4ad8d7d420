"""Whether a block that is pressed moves as one: a wrong sign of an axis turns its field over."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.data.qc.experiment_file import Experiment, refused
from fe.response import Array

UP = 0.2
"""of the travel: under its pin no face moves up by so much; a round one lifts it by 0.07 at most"""
IN = 0.02
"""of the travel: the face of a block that is nearly incompressible does not cave in by more"""
MIDDLE = 1.0 / 6.0
"""of the width, to each side: what is under the pin, or under most of it"""


def check_senses(folder: Path, experiment: Experiment, points: Array, fields: Array) -> None:
    """Raise FileRefused, at its key, for an axis by which the face moves up under the pin.

    `fields` (n_sample, n_step, n, 3) mm at points (n, 2) mm of half the face, NaN where there is
    none.
    """
    middle = points[:, 0] <= MIDDLE * experiment.specimen.width_mm
    up = _usual(fields[:, -1, middle, 1])
    if up > UP * float(experiment.protocol.travel[-1]):
        expected = (
            "the other sign, or the letter of the axis that points up: by it the middle of the "
            f"face moves up by {up:.2g} mm when pressed (where the base moves, "
            'field.rigid_body = "base")'
        )
        raise refused(folder, "axes.y", experiment.axes.y, expected)


def sense_doubts(experiment: Experiment, fields: Array) -> list[str]:
    """A sentence where the face of pressed blocks goes in, `fields` as in `check_senses`."""
    out = _usual(fields[:, -1, :, 2])
    if not out < -IN * float(experiment.protocol.travel[-1]):
        return []
    return [
        f"the face goes in by {-out:.2g} mm in the mean when the block is pressed, where all but "
        f'very compressible ones come out: is axes.z = "{experiment.axes.z}" the axis towards the '
        "camera?"
    ]


def _usual(motion: Array) -> float:
    """Median over samples of their mean motion (n_sample, n) mm, points without one left out."""
    known = np.isfinite(motion)
    has = known.any(axis=1)
    if not has.any():
        return 0.0
    sums = np.where(known, motion, 0.0).sum(axis=1)
    return float(np.median(sums[has] / known.sum(axis=1)[has]))
