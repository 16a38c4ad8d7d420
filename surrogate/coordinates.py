"""Choice of the coordinates in which a process is stationary, by evidence."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from surrogate.covariance import FAMILIES
from surrogate.evidence import maximise_evidence
from surrogate.gp_fit import scale_runs
from surrogate.warp import STRENGTHS, warp_slope

Array = npt.NDArray[np.float64]

_FAMILY = FAMILIES.index("matern52")
_ROWS = 150
"""rows on which the choice is made"""
_MIN_GAIN = 2.0
"""gain of the log evidence below which an input is left as it is"""


class Stretched(NamedTuple):
    """The strengths chosen and the evidence they give."""

    strength: Array
    """(d,) see `surrogate.warp`"""
    log_evidence: float
    """of the outputs in their own units, of thinned runs where there are many"""
    part: npt.NDArray[np.int64]
    """runs whose evidence it is"""


def choose_strength(x: Array, y: Array, slopes: Array | None = None) -> Stretched:
    """Stretch one input after the other where outputs y (n, k) become more probable.

    The outputs share a Matern-5/2 covariance here, whose evidence stands in for that of the
    covariances fitted later. `slopes` (n, k, d) as in `surrogate.gp_fit.fit_processes`; raises
    ValueError as that does.
    """
    best = _evidence(x, y, slopes, np.zeros(x.shape[1]))
    for axis in range(x.shape[1]):
        kept = best
        for value in STRENGTHS[1:]:
            strength = kept.strength.copy()
            strength[axis] = value
            found = _evidence(x, y, slopes, strength)
            if found.log_evidence > max(best.log_evidence, kept.log_evidence + _MIN_GAIN):
                best = found
    return best


def _evidence(x: Array, y: Array, slopes: Array | None, strength: Array) -> Stretched:
    """Log evidence of y and its slopes in their own units, up to what is the same for all."""
    scaled = scale_runs(x, y, slopes, strength)
    targets = np.ascontiguousarray(scaled.targets.T)
    rng = np.random.default_rng(0)  # not used without restarts
    found = maximise_evidence(
        (_FAMILY,), scaled.inputs, scaled.usable, targets, rng, 0, coarse_rows=_ROWS
    )
    part, n_rows = found.part, found.n_rows
    unit = (x - scaled.low) / scaled.span
    stretching = np.log(warp_slope(unit, strength))[part][scaled.usable[part]].sum()
    value = found.log_evidence - n_rows * np.log(scaled.scale).sum() - y.shape[1] * stretching
    return Stretched(strength, float(value), part)
