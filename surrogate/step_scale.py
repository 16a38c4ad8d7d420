"""How well each load step can be foretold: what a POD of all steps is to be measured by.

Early steps are smooth functions of the inputs; late ones, where the surface folds and meets the
pin, are rough by thousands of times as much. Modes of the plain sum of squares mix both, and the
roughness of the last step becomes the error of the first. In units of what leaving runs out shows
of each step by itself, a mode takes from a step no more than it can tell.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from surrogate.coordinates import Chosen, left_out, thinned
from surrogate.pod import fit_pod

Array = npt.NDArray[np.float64]

N_LEADING = 3
"""modes of a step by which it is judged"""
LEAST = 1e-4
"""least scale of a step, as a share of its variation: what is rounding is not to rule"""


def step_scale(x: Array, y: Array, slopes: Array | None, chosen: Chosen) -> Array:
    """(n_step,) typical error of a run left out of each step of y (n, n_step, n_value), largest 1.

    Each step by itself, from the leading modes of its values and `slopes` (n, n_step, n_value, d)
    in the coordinates and with the covariance `chosen`. The median over runs, as a few at corners
    err many times more. A step that is the same in all runs gets what the roughest gets.
    """
    part = thinned(x, None if slopes is None else slopes.reshape(len(x), -1, x.shape[1]))
    error = np.zeros(y.shape[1])
    for step in range(y.shape[1]):
        own = y[part, step]
        if not np.ptp(own, axis=0).any():
            continue
        pod = fit_pod(own, tolerance=0.0, max_modes=N_LEADING)
        weights = pod.weights(own)
        by_input = None if slopes is None else np.matmul(pod.dual.T, slopes[part, step])
        mean, _ = left_out(x[part], weights, by_input, chosen.strength, chosen.family)
        typical = np.sqrt(np.median(np.sum((mean - weights) ** 2, axis=1)))
        error[step] = max(typical, LEAST * np.linalg.norm(weights.std(axis=0)))
    if not error.any():
        return np.ones_like(error)
    scale: Array = np.where(error > 0.0, error / error.max(), 1.0)
    return scale
