"""Whether the points seen fill the face that `[specimen]` describes: a wrong size misplaces it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.data.qc.experiment_file import Experiment
from calib.data.qc.registration import LARGEST_EDGE
from calib.data.qc.sample import FaceField, Sample


def size_doubts(experiment: Experiment, samples: Sequence[Sample]) -> list[str]:
    """A sentence for each side of the block that the points seen fall short of, or lie beyond.

    Of samples whose field was found, in the median; points end at most `LARGEST_EDGE` and a
    spacing, or `field.edge_mm`, before each edge.
    """
    faces = [sample.face for sample in samples if sample.face is not None]
    if not faces:
        return []
    seen = np.median([(face.placement.width, _height(face)) for face in faces], axis=0)
    spacing = float(np.median([face.lattice.spacing for face in faces]))
    edge = max(LARGEST_EDGE + spacing, experiment.field.edge_mm or 0.0)
    block = experiment.specimen
    doubts = []
    for key, span, size in zip(
        ("width_mm", "height_mm"), seen, (block.width_mm, block.height_mm), strict=True
    ):
        if not size - 2.0 * edge <= span <= size + spacing:
            doubts.append(
                f"points are {span:.3g} mm apart at most where specimen.{key} = {size:g}: is that "
                "right, in mm, and is nothing but the whole face seen?"
            )
    return doubts


def _height(face: FaceField) -> float:
    """Between the lowest and the highest points on the face, mm, but for a hundredth at each end.

    Points lie in rows, which are many more than a hundredth of the height would leave out.
    """
    up = (face.lattice.position @ face.placement.rotation.T)[..., 1]
    low, high = np.nanpercentile(up, [1.0, 99.0])
    return float(high - low)
