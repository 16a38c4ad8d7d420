"""Meshes of a block by how it is touched, for studies that name none.

Those that `calib init` writes; what meshes leave is in docs/verification.md, "Mesh".
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
RUBBING = UsualMeshes((12, 3, 3), (16, 8, 4))
SLIDING = UsualMeshes((12, 4, 2), (18, 6, 4))


def usual_meshes(hypothesis: Hypothesis, pin_shape: PinShape) -> UsualMeshes:
    """Those of the contact of pin and base."""
    touching = (hypothesis.pin, hypothesis.base)
    if "stick" in touching or pin_shape == "round":
        return STUCK
    return SLIDING if touching == ("slide", "slide") else RUBBING
