"""What contact remembers from step to step: tied points, slip anchors and their sensitivities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fe.contact import FREE, TIED_TO_FLOOR, TIED_TO_PIN, Faces
from fe.pin_surface import RigidPin, pin_point
from fe.slip_anchors import SlipAnchors, advance_anchors, rest
from fe.touch import FrictionLaw

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass
class ContactMemory:
    """Which points are tied and where, from where the others slide, and what it depends on (state).

    Gradients are with respect to the n_p parameters of the march: those of the material, and with
    friction also, last, the coefficients of pin and base.
    """

    tied: IntArray
    """(n_face, n_q) FREE, TIED_TO_PIN or TIED_TO_FLOOR"""
    anchor: Array
    """(n_face, n_q, 3) mm, of tied points, relative to the pin at travel 0 or to the floor"""
    anchor_gradient: Array
    """(n_face, n_q, 3, n_p) d anchor / d parameter, mm"""
    slip: SlipAnchors
    """of the points that are not tied"""

    def copy(self) -> ContactMemory:
        """Independent copy, so that a rejected step leaves no trace."""
        slip = SlipAnchors(*(part.copy() for part in self.slip))
        return ContactMemory(
            self.tied.copy(), self.anchor.copy(), self.anchor_gradient.copy(), slip
        )


def initial_memory(
    faces: Faces,
    glued: npt.NDArray[np.bool_],
    pin: RigidPin,
    law: FrictionLaw = FrictionLaw(),  # noqa: B008 - immutable
    n_material: int = 2,
) -> ContactMemory:
    """Memory at travel 0: points where `glued` (n_face, n_q) are tied to the pin in place.

    `n_material` is the number of material parameters that sensitivities are taken in.
    """
    n_p = n_material + (2 if law.pin > 0.0 or law.base > 0.0 else 0)
    return ContactMemory(
        tied=np.where(glued, TIED_TO_PIN, FREE).astype(np.int64),
        anchor=faces.points.copy(),
        anchor_gradient=np.zeros((*faces.points.shape, n_p)),
        slip=rest(faces, pin, n_p),
    )


def tie_touching(
    memory: ContactMemory,
    faces: Faces,
    u: Array,
    u_gradient: Array,
    travel: float,
    pin: RigidPin,
    *,
    to_pin: bool = True,
    to_floor: bool = True,
    travel_gradient: Array | None = None,
) -> int:
    """Tie every free point that penetrates pin or floor to its nearest surface point; count them.

    u (n_node, 3) mm, u_gradient (n_node, 3, n_p) mm: the anchor's own sensitivity follows from the
    derivative of the projection (stick is path dependent).  `travel_gradient` (n_p,) mm is that of
    a travel which depends on the parameters.
    """
    x = faces.points + np.einsum("cqa,cai->cqi", faces.shape, u[faces.nodes])
    dx = np.einsum("cqa,caij->cqij", faces.shape, u_gradient[faces.nodes])
    count = 0
    if to_floor:
        floor = (memory.tied == FREE) & faces.floor[:, None] & (x[..., 1] < 0.0)
        onto_floor = np.array([1.0, 0.0, 1.0])
        memory.tied[floor] = TIED_TO_FLOOR
        memory.anchor[floor] = x[floor] * onto_floor
        memory.anchor_gradient[floor] = dx[floor] * onto_floor[:, None]
        count += int(floor.sum())
    if not to_pin:
        return count
    if travel_gradient is not None:  # seen from the pin, the points rise with the travel
        dx = dx + np.array([0.0, 1.0, 0.0])[:, None] * travel_gradient
    for c, q in zip(*np.nonzero((memory.tied == FREE) & ~faces.base[:, None]), strict=True):
        s = pin_point(x[c, q], travel, pin)
        if s.gap >= 0.0:
            continue
        normal = np.array([s.nx, s.ny, s.nz])
        hessian = np.array([[s.hxx, s.hxy, s.hxz], [s.hxy, s.hyy, s.hyz], [s.hxz, s.hyz, s.hzz]])
        projection = np.eye(3) - np.outer(normal, normal) - s.gap * hessian
        memory.tied[c, q] = TIED_TO_PIN
        memory.anchor[c, q] = x[c, q] - s.gap * normal + np.array([0.0, travel, 0.0])
        memory.anchor_gradient[c, q] = projection @ dx[c, q]
        count += 1
    return count


def slide_anchors(
    memory: ContactMemory,
    faces: Faces,
    u: Array,
    u_gradient: Array,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    *,
    travel_gradient: Array | None = None,
) -> float:
    """Move the slip anchors behind the points that slid; returns the work of friction, N mm.

    The work is that of the mean traction of the step's two ends along the anchors' way.
    `travel_gradient` (n_p,) mm is that of a travel which depends on the parameters.
    """
    moved = np.zeros(u_gradient.shape[2]) if travel_gradient is None else travel_gradient
    work: float = advance_anchors(
        u, u_gradient, faces, memory.tied, memory.slip, travel, pin, law, moved
    )
    return work
