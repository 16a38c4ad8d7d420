"""What the contact of a block asks of its meshes: which ones, and how fast their errors fall.

The meshes are for studies that name none, those that `calib init` writes; what they leave is in
docs/verification.md, "Mesh".
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from calib.study.block_cells import Cells
    from calib.study.sections import Hypothesis, PinShape


class UsualMeshes(NamedTuple):
    """Elements (x, y, z) of a quarter of the block."""

    sampling: Cells
    """of the runs that train the emulator"""
    check: Cells
    """of those that measure the discretisation error"""


STUCK = UsualMeshes((12, 5, 3), (20, 14, 5))
"""where anything is glued: its edges are singular; and under a round pin, whose rim these lines do
not follow (rings do, where a study names them)"""
ROUGH_ORDER, SMOOTH_ORDER = 1.0, 2.0
"""of the field's error in the size of the elements. Beside the edge of a glued face displacements
go with a power of the distance between a half and one (Williams 1952), which no grid of one size
resolves, and where a face rubs much of it sticks: on three meshes errors of both fall with order 1
or less, those of sliding ones with some 2 (docs/verification.md, "Finer truths")"""
RUBBING = UsualMeshes((12, 3, 3), (16, 8, 4))
SLIDING = UsualMeshes((12, 4, 2), (18, 6, 4))


def usual_meshes(hypothesis: Hypothesis, pin_shape: PinShape) -> UsualMeshes:
    """Those of the contact of pin and base."""
    if "stick" in (hypothesis.pin, hypothesis.base) or pin_shape == "round":
        return STUCK
    return SLIDING if slides(hypothesis) else RUBBING


def slides(hypothesis: Hypothesis) -> bool:
    """Whether neither pin nor base hold what they touch."""
    return (hypothesis.pin, hypothesis.base) == ("slide", "slide")


def field_order(hypothesis: Hypothesis) -> float:
    """Order at which errors of the field fall with the size of the elements."""
    return SMOOTH_ORDER if slides(hypothesis) else ROUGH_ORDER
