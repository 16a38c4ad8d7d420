"""Scrambled Sobol points."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc


def sobol_points(d: int, power: int, seed: int) -> npt.NDArray[np.float64]:
    """(2^power, d) points of the unit box.

    Raises KeyboardInterrupt where one came while SciPy read its direction numbers: it is swallowed
    there, and all points are the same.
    """
    sobol = qmc.Sobol(d, scramble=True, seed=np.random.default_rng(seed))
    points: npt.NDArray[np.float64] = sobol.random_base2(power)
    if len(points) > 1 and not np.ptp(points, axis=0).all():
        raise KeyboardInterrupt
    return points
