"""A posterior beyond the runs that got through, and what those that did not say of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fe.response import Array

SEEN = 0.02
"""share of a posterior beyond the complete runs from which a reader is told"""


def beyond_complete_runs(
    diagnostics: Mapping[str, Any], draws: Array, names: Sequence[str]
) -> list[str]:
    """A sentence where runs ended early beyond the complete ones and the posterior lies there, too.

    `diagnostics` are those of an emulator (`calib.study.judgement.judge`), `draws` (n, d) those of
    its inputs, `names` what these are called. Leaving complete runs out judges an emulator between
    them: beyond them it extrapolates, and its stated errors are those of a smooth continuation.
    """
    early = diagnostics["partial_runs"]
    at = np.asarray(early["ratios"], dtype=np.float64).reshape(-1, len(names))
    complete = np.asarray(diagnostics["runs"]["leave_one_out"]["ratios"], dtype=np.float64)
    low, high = complete.min(axis=0), complete.max(axis=0)
    below, above = (at < low).any(axis=0), (at > high).any(axis=0)
    beyond = np.concatenate([(draws < low) & below, (draws > high) & above], axis=1)
    share, by_side = float(np.mean(beyond.any(axis=1))), np.atleast_1d(beyond.mean(axis=0))
    if share < SEEN:
        return []
    # A run beyond several sides need not have failed for all of them.
    sides = by_side >= min(SEEN, by_side.max())
    outside = (np.concatenate([at < low, at > high], axis=1) & sides).any(axis=1)
    ends = [f"{name} below {end:.3g}" for name, end in zip(names, low, strict=True)]
    ends += [f"{name} above {end:.3g}" for name, end in zip(names, high, strict=True)]
    named = " or ".join(end for end, own in zip(ends, sides, strict=True) if own)
    n = int(outside.sum())
    runs = f"{n} run{'s' if n > 1 else ''}"
    said = f"{share:.0%} of its posterior lies beyond the runs that got through ({named}), "
    said += f"where {runs} ended early and the emulator extrapolates"
    off = [_largest(early["relative"][index]) for index in np.flatnonzero(outside)]
    z = [_largest(early["standardised"][index]) for index in np.flatnonzero(outside)]
    if any(off):
        said += f": up to where they are good it is off by up to {max(off):.1%} of the force, "
        said += f"{max(z):.2g} of its stated SDs"
    return [f"{said}; other mesh.sampling, a lower last increment or narrower priors help"]


def _largest(values: Sequence[float | None]) -> float:
    """Size of the largest that is known; 0 where none is."""
    return max((abs(value) for value in values if value is not None), default=0.0)
