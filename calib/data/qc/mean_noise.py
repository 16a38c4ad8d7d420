"""What is known of the noise of one sample's field, and of the mean's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.data.noise_shape import fall_off
from calib.data.qc.averaging import MeanField, with_enough
from calib.data.qc.noise_floor import NoiseFloor, pooled_noise
from calib.data.qc.static_noise import StaticNoise
from fe.response import Array

APART = 1.3
"""times the SD by static frames, above which what samples scatter is more than chance: six frames
tell an SD to 8 %"""
ROUGHLY_APART = 1.1
"""the same by a first estimate, above which a better one is made"""


@dataclass(frozen=True)
class FieldNoise:
    """Noise of one sample's field by all that tells of it, and of the mean's."""

    at_points: NoiseFloor | None
    """of the DIC points, by static frames"""
    static: NoiseFloor | None
    """of the data set's points, by static frames"""
    repeats: NoiseFloor
    """of the data set's points, by what differs between the samples beyond their patterns"""
    stated: Array | None
    """(3,) of one sample's field, mm, by the SDs that the DIC program states for its points"""
    stated_length: float | None
    """mm, correlation length that the DIC program states"""
    together: NoiseFloor
    """of the data set's points, by static frames and samples"""
    mean_std: Array
    """(3,) SD of the mean's noise, mm"""
    louder: float | None = None
    """how many times more samples scatter than static frames, where these say too little"""


def mean_noise(
    points: Array,
    mean: MeanField,
    static: StaticNoise | None,
    stated: Array | None,
    stated_length: float | None = None,
) -> FieldNoise:
    """Noise of the mean at all places (n, 2) [mm], by the samples' scatter and static frames.

    Both measure one thing and count by their numbers of frames: six static frames of one reference
    tell an SD to 8 %, sixteen samples of five steps to 2 %. Samples that scatter `APART` times as
    much have noise that static frames do not see, and count alone. Without static frames the larger
    of the samples' scatter and of what the DIC program states is taken, and the longer of the
    lengths.
    """
    places = points[mean.kept]
    samples = with_enough(mean.residual)
    if not samples:
        raise ValueError("expected one sample or more with enough points in common, found none")
    # residuals are smaller than the noise by what the mean and the patterns have taken
    taken = mean.residual_std / np.sqrt(np.nanmean(mean.residual**2, axis=(0, 1, 2)))
    series = [one * taken for one in samples]
    repeats = pooled_noise(series, places, roughly=static is not None)
    louder = None
    if static is not None and _times(repeats, static.mapped) > ROUGHLY_APART:
        of_samples = pooled_noise(series, places)  # as the static frames' noise is estimated
        if (times := _times(of_samples, static.mapped)) > APART:
            repeats, louder = of_samples, times
    together, std = repeats, repeats.std
    if static is not None and louder is None:
        together = pooled_noise([*series, static.fields[:, mean.kept]], places)
        std = together.std
    elif static is None:
        std = std if stated is None else np.maximum(std, stated)
        if stated_length is not None and stated_length > fall_off(
            repeats.correlation_length, repeats.smoothing
        ):
            together = repeats._replace(correlation_length=stated_length, smoothing=0.0)
    effective = len(mean.n_samples) / np.sum(1.0 / mean.n_samples)
    return FieldNoise(
        at_points=None if static is None else static.at_points,
        static=None if static is None else static.mapped,
        repeats=repeats,
        stated=stated,
        stated_length=stated_length,
        together=together._replace(std=std),
        mean_std=std / np.sqrt(effective),
        louder=louder,
    )


def _times(samples: NoiseFloor, static: NoiseFloor) -> float:
    """How many times more samples scatter than static frames, all components together."""
    return float(np.linalg.norm(samples.std) / np.linalg.norm(static.std))


def noise_doubts(noise: FieldNoise | None) -> list[str]:
    """A sentence where static frames and samples contradict one another."""
    if noise is None or noise.static is None or noise.louder is None:
        return []
    static, samples = (
        1e3 * float(np.sqrt(np.mean(one.std**2))) for one in (noise.static, noise.repeats)
    )
    return [
        f"the samples' fields scatter by {samples:.2g} um beyond their patterns, "
        f"{noise.louder:.2g} times as much as static frames ({static:.2g} um), which are left out "
        "of the SD and the correlation of the noise; "
        "expected static frames taken as the samples' are (light, exposure, averaging of images)"
    ]
