"""What contact remembers from step to step: ties, slip anchors and their sensitivities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fe import ties
from fe.contact import Faces
from fe.pin_surface import RigidPin
from fe.slip_anchors import SlipAnchors, advance_anchors, rest
from fe.surface_slopes import SurfaceSlopes, no_slopes
from fe.ties import Step, Stick, Ties
from fe.touch import FrictionLaw

Array = npt.NDArray[np.float64]


@dataclass
class ContactMemory:
    """Which points are tied and where, and from where the others slide (state)."""

    ties: Ties
    slip: SlipAnchors
    """of the points that are not tied"""
    before: Step
    """state at the end of the last step, from which points come that are tied next"""

    def copy(self) -> ContactMemory:
        """Independent copy."""
        parts = {name: part.copy() for name, part in self.ties._asdict().items()}
        slip = SlipAnchors(*(part.copy() for part in self.slip))
        return ContactMemory(self.ties._replace(**parts), slip, self.before)


def initial_memory(
    faces: Faces,
    glued: npt.NDArray[np.bool_],
    pin: RigidPin,
    slopes: SurfaceSlopes | None = None,
    at_rest: SurfaceSlopes | None = None,
) -> ContactMemory:
    """Memory at travel 0: points where `glued` (n_face, n_q) are tied to the pin in place.

    `slopes` are those of the parameters that sensitivities are taken in, none when not given;
    `at_rest` those of the surfaces at travel 0, if they differ.  Raises ValueError for glued points
    of the base, which nothing ties.
    """
    if glued[faces.base].any():
        raise ValueError("glued: expected points of other faces than those of the base")
    slopes = no_slopes(faces, 0) if slopes is None else slopes
    start = slopes if at_rest is None else at_rest
    return ContactMemory(
        ties.at_rest(faces, glued, slopes),
        rest(faces, pin, start),
        ties.step_at_rest(faces, slopes, start),
    )


def tie_touching(
    memory: ContactMemory,
    faces: Faces,
    u: Array,
    u_gradient: Array,
    travel: float,
    pin: RigidPin,
    stick: Stick = Stick(pin=True, floor=True),  # noqa: B008 - immutable
    slopes: SurfaceSlopes | None = None,
    travel_gradient: Array | None = None,
) -> int:
    """Tie every free point that penetrates what it sticks to; count them.  See `fe.ties`.

    u (n_node, 3) mm, u_gradient (n_node, 3, n_p) mm, `slopes` of the same n_p parameters, none
    when not given; so is `travel_gradient` (n_p,) mm.
    """
    n_p = u_gradient.shape[2]
    slopes = no_slopes(faces, n_p) if slopes is None else slopes
    travel_gradient = np.zeros(n_p) if travel_gradient is None else travel_gradient
    step = Step(u, u_gradient, travel, travel_gradient)
    found = int(ties.tie(memory.ties, faces, memory.before, step, pin, stick, slopes))
    memory.before = step
    return found


def slide_anchors(
    memory: ContactMemory,
    faces: Faces,
    u: Array,
    u_gradient: Array,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    slopes: SurfaceSlopes | None = None,
) -> float:
    """Move the slip anchors behind the points that slid; returns the work of friction, N mm.

    The work is that of the mean traction of the step's two ends along the anchors' way.
    """
    slopes = no_slopes(faces, u_gradient.shape[2]) if slopes is None else slopes
    work: float = advance_anchors(
        u, u_gradient, faces, memory.ties.kind, memory.slip, travel, pin, law, slopes
    )
    return work
