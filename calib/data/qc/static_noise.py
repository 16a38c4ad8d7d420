"""Noise of an instrument from static frames, taken through the same steps as a sample's field."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from calib.data.qc.experiment_file import Experiment
from calib.data.qc.lattice import Lattice, lattice_of
from calib.data.qc.masks import inside
from calib.data.qc.noise_floor import NoiseFloor, noise_floor
from calib.data.qc.outliers import without_outliers
from calib.data.qc.registration import Placement
from calib.data.qc.sample import FaceField
from calib.data.readers import WrongFile, read_dic
from calib.data.readers.frames import STATIC
from fe.response import Array

MOST_NOISE = 0.25
"""of an increment: frames that differ by more are those of a test, or of no use"""


class StaticNoise(NamedTuple):
    """What frames in which nothing moves tell."""

    at_points: NoiseFloor
    """of the DIC points as they are"""
    mapped: NoiseFloor
    """of the data set's field: mapped, freed of rigid motion and folded as a sample's is"""
    fields: Array
    """(n_frame, n, 3) the frames so treated, mm"""


def static_noise(folder: Path, experiment: Experiment, points: Array) -> StaticNoise:
    """Noise of static frames, at their points and at `points` (n, 2) [mm] of the data set's field.

    Raises WrongFile for frames that cannot be read or say nothing of noise.
    """
    series = read_dic(folder)
    try:
        lattice = lattice_of(
            series.frames, experiment.axes.matrix, partial(inside, experiment.mask)
        )
        lattice = _without_reference(lattice)
        _check_copies(lattice)
        quality = experiment.quality
        cleaned = without_outliers(
            lattice.displacement, quality.outlier_mad, quality.outlier_floor_mm
        )
        present = lattice.present()
        raw = noise_floor(cleaned.displacement[:, present], lattice.position[present][:, :2])
        if (largest := float(np.max(raw.std))) > MOST_NOISE * experiment.protocol.increment_mm:
            raise ValueError(
                f"expected frames in which nothing moves, found an SD of {largest:.2g} mm"
            )
        steps = np.arange(1.0, len(lattice.displacement) + 1)
        face = FaceField(lattice, steps, _centred(lattice), cleaned)
        options = experiment.field
        mapped, _ = face.mapped(points, options.mapping, options.rigid_body)
        return StaticNoise(raw, noise_floor(mapped, points), mapped)
    except ValueError as error:
        expected, _, found = str(error).partition(", found ")
        raise WrongFile(folder, None, expected.removeprefix("expected "), found) from error


def _without_reference(lattice: Lattice) -> Lattice:
    """Without a frame in which nothing has moved to the last digit: it is the reference itself."""
    with np.errstate(invalid="ignore"):
        moved = np.nan_to_num(np.abs(lattice.displacement)).max(axis=(1, 2, 3)) > STATIC
    return lattice._replace(displacement=lattice.displacement[moved])


def _check_copies(lattice: Lattice) -> None:
    """Raise ValueError for two frames that are the same to the last bit: noise never is."""
    seen: set[bytes] = set()
    for frame in lattice.displacement:
        if (found := frame.tobytes()) in seen:
            raise ValueError("expected frames of their own, found one twice, to the last bit")
        seen.add(found)


def _centred(lattice: Lattice) -> Placement:
    """Our frame at the middle of the lowest row; nothing moves, so that there is no pin to find."""
    cloud = lattice.position[lattice.present()]
    low, high = np.percentile(cloud, [0.5, 99.5], axis=0)
    origin = np.array([0.5 * (low[0] + high[0]), low[1] - 0.5 * lattice.spacing, low[2]])
    width = float(high[0] - low[0])
    return Placement(np.eye(3), origin, 0.0, 0.0, 0.0, 0.0, width, 0.0)
