"""Errors of the field of known shape: rigid motions, what a wrong model errs by."""

from __future__ import annotations

import numpy as np

from calib.data.dataset import FieldData
from calib.inference.discrepancy import discrepancy_patterns, size_of
from calib.inference.field_noise import FieldCovariance
from calib.inference.field_scales import FieldScales, rigid_patterns
from calib.inference.field_table import Range
from calib.inference.noise import NoiseSettings
from fe.response import Array


def with_patterns_of(
    covariance: FieldCovariance,
    travel: Array,
    field: FieldData,
    noise: NoiseSettings,
    unknown: tuple[Range | None, Range | None],
) -> tuple[FieldCovariance, FieldScales | None]:
    """With rigid motions and a discrepancy of known size; and what is of unknown size.

    `unknown` are the ranges of unknown sizes: of the noise's factor and of the share by which the
    model errs.
    """
    known = rigid_patterns(field.points, travel.size, noise.translation_sd, noise.rotation_sd)
    wrong = np.zeros((0, *field.displacement.shape))
    if noise.discrepancy > 0 or unknown[1] is not None:
        wrong = discrepancy_patterns(
            field.points,
            travel,
            size_of(field.displacement),
            noise.discrepancy_length,
            noise.discrepancy_travel_length,
        )
    if unknown[1] is None:
        known, wrong = np.concatenate([known, noise.discrepancy * wrong]), wrong[:0]
    covariance = covariance.with_patterns(known)
    return covariance, None if unknown == (None, None) else FieldScales(*unknown, wrong)
