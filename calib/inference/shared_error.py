"""One error that several kinds of data share, integrated out exactly.

The zero of the pin's travel moves the forces and the field together. Taken as two errors, the data
would seem to know more of their difference than they do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fe.response import Array


@dataclass(frozen=True)
class AlongError:
    """Log density of some data when the shared error is z SDs: value + slope z - curvature z^2 / 2.

    It is a parabola since all is normal and the error enters linearly.
    """

    value: Array
    """(m,)"""
    slope: Array
    """(m,)"""
    curvature: Array
    """(m,)"""


def marginal(parts: Sequence[AlongError]) -> Array:
    """(m,) joint log density of all parts, z ~ N(0, 1) integrated out; -inf if not finite."""
    value = sum(part.value for part in parts)
    slope = sum(part.slope for part in parts)
    curvature = 1.0 + sum(part.curvature for part in parts)
    total = value + 0.5 * (slope**2 / curvature - np.log(curvature))
    finite: Array = np.where(np.isfinite(total), total, -np.inf)
    return finite
