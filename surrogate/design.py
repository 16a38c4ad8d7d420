"""Designs of experiments: the corners of the box, then a scrambled Sobol sequence."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

Array = npt.NDArray[np.float64]


def sobol_design(n: int, bounds: Array, seed: int) -> Array:
    """(n, d) points of the box `bounds` (d, 2): its 2^d corners first, then Sobol points.

    The corners come first because a Gaussian process errs most where it extrapolates. The rest
    is a Sobol sequence with Owen's scrambling (Owen 1998, J. Complexity 14, 466). Designs are
    nested: the first n points of a larger design with the same bounds and seed are this design.
    Raises ValueError for n < 1 or bounds that are not finite pairs low < high.
    """
    bounds = np.asarray(bounds, dtype=np.float64)
    if n < 1:
        raise ValueError(f"n: must be at least 1, got {n}")
    if bounds.ndim != 2 or bounds.shape[1] != 2 or not len(bounds):
        raise ValueError(f"bounds: must be (d, 2) pairs low, high, got shape {bounds.shape}")
    if not np.isfinite(bounds).all() or not (bounds[:, 0] < bounds[:, 1]).all():
        raise ValueError(f"bounds: must be finite with low < high, got {bounds.tolist()}")
    corners = np.array(list(itertools.product(*bounds)))[:n]
    n_inside = n - len(corners)
    if n_inside == 0:
        return corners
    sequence = qmc.Sobol(len(bounds), scramble=True, seed=np.random.default_rng(seed))
    # A whole power of two, cut: the same sequence without a warning about its balance.
    unit = sequence.random_base2((n_inside - 1).bit_length())[:n_inside]
    inside = bounds[:, 0] + (bounds[:, 1] - bounds[:, 0]) * unit
    return np.vstack([corners, inside])
