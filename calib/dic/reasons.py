"""Why a point has no displacement."""

from __future__ import annotations

from enum import IntEnum


class Reason(IntEnum):
    """Code of a point: 0 is valid, anything else says why it is not."""

    VALID = 0
    OUTSIDE_REGION = 1
    NO_SPECKLE = 2
    LEFT_IMAGE = 3
    NOT_CONVERGED = 4
    LOW_CORRELATION = 5
    FOLDED = 6
    NOT_REACHED = 7
    STRAY = 8
    UNCERTAIN = 9

    @property
    def text(self) -> str:
        """A few words for tables and pictures."""
        return _TEXT[self]


_TEXT = {
    Reason.VALID: "valid",
    Reason.OUTSIDE_REGION: "too little of the subset is in the region or the image",
    Reason.NO_SPECKLE: "no speckle in the subset",
    Reason.LEFT_IMAGE: "left the image",
    Reason.NOT_CONVERGED: "did not converge",
    Reason.LOW_CORRELATION: "low correlation: hidden, glare or changed surface",
    Reason.FOLDED: "folded: determinant of the deformation not positive",
    Reason.NOT_REACHED: "no neighbour or seed from which to start",
    Reason.UNCERTAIN: "its standard deviation is above the largest allowed",
    Reason.STRAY: "correlates at a place that its neighbours exclude",
}
