"""What contact remembers from step to step: tied points, slip anchors and their sensitivities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from fe.contact import FREE, TIED_TO_FLOOR, TIED_TO_PIN, Faces, penalty, position
from fe.pin_surface import RigidPin, pin_point
from fe.slip_anchors import SlipAnchors, advance_anchors, rest
from fe.surface_slopes import (
    SurfaceSlopes,
    gap_slope,
    no_slopes,
    normal_slope,
    penalty_slope,
    relative_motion,
)
from fe.touch import FrictionLaw

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass
class ContactMemory:
    """Which points are tied and where, from where the others slide, and what it depends on (state).

    Gradients are with respect to the n_p parameters of the march.
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
    slopes: SurfaceSlopes | None = None,
    at_rest: SurfaceSlopes | None = None,
) -> ContactMemory:
    """Memory at travel 0: points where `glued` (n_face, n_q) are tied to the pin in place.

    `slopes` are those of the parameters that sensitivities are taken in, none when not given;
    `at_rest` those of the places from which slip is counted, if they differ.
    """
    slopes = no_slopes(faces, 0) if slopes is None else slopes
    anchor_gradient = slopes.points.copy()
    anchor_gradient[glued, 1] = slopes.height  # on the pin, wherever that starts
    return ContactMemory(
        tied=np.where(glued, TIED_TO_PIN, FREE).astype(np.int64),
        anchor=faces.points.copy(),
        anchor_gradient=anchor_gradient,
        slip=rest(faces, pin, slopes if at_rest is None else at_rest),
    )


@njit(cache=True)
def touches(
    u: Array,
    faces: Faces,
    tied: IntArray,
    travel: float,
    pin: RigidPin,
    to_pin: bool,
    to_floor: bool,
) -> IntArray:
    """(n_face, n_q) what free points that penetrate pin or floor are to be tied to, FREE if none.

    u (n_node, 3) and travel in mm.
    """
    found = np.full(tied.shape, FREE, dtype=np.int64)
    x = np.empty(3)
    for c in range(tied.shape[0]):
        for q in range(tied.shape[1]):
            if tied[c, q] != FREE:
                continue
            position(u, faces, c, q, x)
            if to_floor and faces.floor[c] and x[1] < 0.0:
                found[c, q] = TIED_TO_FLOOR
            elif to_pin and not faces.base[c] and pin_point(x, travel, pin).gap < 0.0:
                found[c, q] = TIED_TO_PIN
    return found


@njit(cache=True)
def tie(
    memory_tied: IntArray,
    anchor: Array,
    anchor_gradient: Array,
    touching: IntArray,
    faces: Faces,
    u: Array,
    u_gradient: Array,
    travel: float,
    pin: RigidPin,
    slopes: SurfaceSlopes,
) -> None:
    """Tie the points that `touches` found where the spring exerts what the penalty did.

    So neither force nor, nearly, energy jumps: the anchor lies on the normal through the point,
    between it and the surface.  u (n_node, 3) mm, u_gradient (n_node, 3, n_p) mm: the anchor's own
    sensitivity follows (stick is path dependent).  The first three are the memory's.
    """
    x = np.empty(3)
    seen = np.empty(slopes.points.shape[2:])
    for c in range(touching.shape[0]):
        for q in range(touching.shape[1]):
            if touching[c, q] == FREE:
                continue
            memory_tied[c, q] = touching[c, q]
            position(u, faces, c, q, x)
            dx = slopes.points[c, q].copy()
            for a in range(faces.nodes.shape[1]):
                dx += faces.shape[c, q, a] * u_gradient[faces.nodes[c, a]]
            at, gradient = anchor[c, q], anchor_gradient[c, q]
            at[:] = x
            gradient[:, :] = dx
            if touching[c, q] == TIED_TO_FLOOR:
                at[1] -= spring_depth(x[1], pin)
                for j in range(dx.shape[1]):
                    gradient[1, j] -= spring_depth_slope(x[1], dx[1, j], pin, slopes, j)
                continue
            s = pin_point(x, travel, pin)
            depth = spring_depth(s.gap, pin)
            at[0] -= depth * s.nx
            at[1] += travel - depth * s.ny
            at[2] -= depth * s.nz
            relative_motion(x, dx, pin, slopes, seen)
            for j in range(dx.shape[1]):
                d0, d1, d2 = normal_slope(s, seen, pin, slopes, j)
                d_gap = gap_slope(s, seen, slopes, j)
                d_depth = spring_depth_slope(s.gap, d_gap, pin, slopes, j)
                gradient[0, j] -= d_depth * s.nx + depth * d0
                gradient[1, j] -= d_depth * s.ny + depth * d1
                gradient[2, j] -= d_depth * s.nz + depth * d2


@njit(cache=True)
def spring_depth(gap: float, pin: RigidPin) -> float:
    """Signed distance (mm, negative) that a spring has where the penalty has this gap, mm."""
    depth: float = penalty(gap, pin.stiffness, pin.ramp)[1] / pin.stiffness
    return depth


@njit(cache=True)
def spring_depth_slope(
    gap: float, d_gap: float, pin: RigidPin, slopes: SurfaceSlopes, j: int
) -> float:
    """Its derivative in parameter j, in which the gap has the derivative `d_gap`."""
    _, slope, curvature = penalty(gap, pin.stiffness, pin.ramp)
    d_stiffness, d_ramp = slopes.stiffness[j], slopes.ramp[j]
    own = penalty_slope(gap, pin.stiffness, pin.ramp, d_stiffness, d_ramp)
    d_depth: float = (curvature * d_gap + own - slope / pin.stiffness * d_stiffness) / pin.stiffness
    return d_depth


def tie_touching(
    memory: ContactMemory,
    faces: Faces,
    u: Array,
    u_gradient: Array,
    travel: float,
    pin: RigidPin,
    touching: IntArray | None = None,
    slopes: SurfaceSlopes | None = None,
) -> int:
    """Tie every free point that penetrates pin or floor; count them.

    u (n_node, 3) mm, u_gradient (n_node, 3, n_p) mm, `slopes` of the same n_p parameters, none
    when not given.  `touching` is what `touches` found, both surfaces if not given.
    """
    if slopes is None:
        slopes = no_slopes(faces, u_gradient.shape[2])
    if touching is None:
        touching = touches(u, faces, memory.tied, travel, pin, True, True)
    into = (memory.tied, memory.anchor, memory.anchor_gradient)
    tie(*into, touching, faces, u, u_gradient, travel, pin, slopes)
    return int(np.count_nonzero(touching != FREE))


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
    nodal = u_gradient[faces.nodes].reshape(*faces.nodes.shape, slopes.points[0, 0].size)
    motion = slopes.points + np.matmul(faces.shape, nodal).reshape(slopes.points.shape)
    work: float = advance_anchors(
        u, motion, faces, memory.tied, memory.slip, travel, pin, law, slopes
    )
    return work
