"""What a laboratory should look at of samples that meet all rules."""

from __future__ import annotations

import numpy as np

from calib.data.odd_samples import odd_samples
from calib.data.qc.face_size import size_doubts
from calib.data.qc.hold_frames import clock_doubts
from calib.data.qc.likeness import unlike_doubts
from calib.data.qc.mean_noise import noise_doubts
from calib.data.qc.pipeline import QcResult
from calib.data.qc.senses import sense_doubts


def doubts(result: QcResult) -> list[str]:
    """A sentence each: of axes, sizes, clocks, noise, single samples' fields and stiffness."""
    experiment, kept = result.experiment, np.flatnonzero(result.kept)
    said = sense_doubts(experiment, result.fields)
    said += size_doubts(experiment, result.samples)
    use = experiment.protocol.use
    for one in (result.samples[i] for i in kept):
        if one.synchronised is not None:
            said += clock_doubts(one.name, one.synchronised, use)
    names = [result.samples[i].name for i in kept]
    said += unlike_doubts(names, result.fields[kept], use)
    said += noise_doubts(result.noise)
    return said + odd_samples(None if result.dataset is None else result.dataset.samples)
