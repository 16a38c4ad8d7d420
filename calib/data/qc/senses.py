"""Whether a block that is pressed moves as one: an axis with the wrong sign turns a field over."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.data.qc.experiment_file import Experiment, refused
from fe.response import Array

CLEAR = 0.02
"""of the travel: smaller motions of a face tell nothing of an axis"""
MIDDLE = 1.0 / 6.0
"""of the width, to each side: what is under the pin, or under most of it"""


def check_senses(folder: Path, experiment: Experiment, points: Array, fields: Array) -> None:
    """Raise FileRefused, at its key, for an axis by which a pressed block moves up or caves in.

    `fields` (n_sample, n_step, n, 3) mm at points (n, 2) mm of half the face, NaN where there is
    none.  Under the pin the face goes down, and taken over all points it comes out.
    """
    last = fields[:, -1]
    middle = points[:, 0] <= MIDDLE * experiment.specimen.width_mm
    clear = CLEAR * float(experiment.protocol.travel[-1])
    up, out = _usual(last[:, middle, 1]), _usual(last[:, :, 2])
    if up > clear:
        expected = (
            f"the other sign, or the letter of the axis that points up: by it the middle of the "
            f"face moves up by {up:.2g} mm when pressed"
        )
        raise refused(folder, "axes.y", experiment.axes.y, expected)
    if out < -clear:
        expected = (
            f"the other sign, or the letter of the axis towards the camera: by it the face of a "
            f"pressed block caves in by {-out:.2g} mm"
        )
        raise refused(folder, "axes.z", experiment.axes.z, expected)


def _usual(motion: Array) -> float:
    """Median over samples of their mean motion (n_sample, n) mm, points without one left out."""
    known = np.isfinite(motion)
    has = known.any(axis=1)
    if not has.any():
        return 0.0
    sums = np.where(known, motion, 0.0).sum(axis=1)
    return float(np.median(sums[has] / known.sum(axis=1)[has]))
