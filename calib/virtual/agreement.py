"""Whether a data set agrees with the truth its files were made from, within its stated errors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from calib.data.dataset import Dataset
from calib.inference.field_noise import field_covariance
from calib.inference.noise import slope_matrix
from calib.virtual.truth import TruthResponse


class Agreement(NamedTuple):
    """A sum of squares in units of the stated errors, and how probable a larger one is."""

    chi2: float
    n: int
    """numbers that were compared: degrees of freedom"""
    p: float
    """probability of a sum at least as large if the data set's errors are what it states"""


def field_agreement(dataset: Dataset, truth: TruthResponse) -> Agreement:
    """The mean field against that of the truth at the data set's points and travels.

    The covariance is that of the likelihood: noise of the mean, correlated over points and
    increments, the patterns in which samples differ, the scale, and the zero of the travel.
    Raises ValueError without a field.
    """
    field = dataset.field
    if field is None:
        raise ValueError("dataset: expected one with a field, found forces alone")
    off = field.displacement - truth.field_at(field.points, dataset.travel)
    scale = field.scale_sd * field.displacement
    zero = dataset.travel_zero_sd * np.tensordot(
        slope_matrix(dataset.travel), field.displacement, 1
    )
    total = (
        field_covariance(field, patterns=np.stack([scale, zero])).inner(off[None], off[None]).item()
    )
    return Agreement(total, off.size, float(chi2.sf(total, off.size)))


def force_agreement(dataset: Dataset, truth: TruthResponse) -> Agreement:
    """The mean forces against those of a sample as stiff as the median one, 0.3 % below their mean.

    The spread between samples is estimated from them, so that the sum is Hotelling's T^2, brought
    to the chi^2 of equal probability; the error that all have in the zero of the travel is added to
    the covariance. Raises ValueError without the covariance between samples.
    """
    covariance, n = dataset.force_covariance, dataset.n_samples
    if covariance is None:
        raise ValueError("dataset: expected one with the forces' covariance, found none")
    off = dataset.force_mean - truth.force_at(dataset.travel)
    size = off.size
    zero = dataset.travel_zero_sd * slope_matrix(dataset.travel) @ dataset.force_mean
    total = covariance / n + np.outer(zero, zero)
    squared = float(off @ np.linalg.solve(total, off))
    p = float(f_distribution.sf(squared * (n - size) / (size * (n - 1)), size, n - size))
    return Agreement(float(chi2.isf(p, size)), size, p)
