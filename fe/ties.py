"""Where points that stick first touched pin or floor, how firmly they hold, and on what it depends.

A point is anchored where it met the surface: between its places at the two ends of the load step in
which it did, at gap zero.  What holds it passes from the penalty to an isotropic spring as it gets
deeper, so a point that meets the surface just before the end of a step and one that does just after
it are the same to first order, and equilibria are continuous in the parameters.  Along the normal
the anchor lies so deep that the spring exerts what the penalty did: no pressure jumps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.contact import FREE, TIED_TO_FLOOR, TIED_TO_PIN, Faces
from fe.face_rows import motions, positions
from fe.pin_surface import RigidPin, pin_point
from fe.surface_slopes import (
    SurfaceSlopes,
    gap_slope,
    normal_slope,
    relative_motion,
)
from fe.touch import FLOOR, PIN

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


class Ties(NamedTuple):
    """Points that are tied to pin or floor; gradients are in the n_p parameters of the march."""

    kind: IntArray
    """(n_face, n_q) FREE, TIED_TO_PIN or TIED_TO_FLOOR"""
    hold: Array
    """(n_face, n_q) share of the spring in what holds a tied point; the rest is the penalty's"""
    touch: Array
    """(n_face, n_q, 3) mm, where tied points met the pin, seen from it at travel 0, or the floor"""
    anchor: Array
    """(n_face, n_q, 3) mm, of the springs, likewise"""
    hold_gradient: Array
    """(n_face, n_q, n_p)"""
    touch_gradient: Array
    """(n_face, n_q, 3, n_p) mm"""
    anchor_gradient: Array
    """(n_face, n_q, 3, n_p) mm"""


class Stick(NamedTuple):
    """Whether points that touch are tied from then on."""

    pin: bool
    floor: bool


class Step(NamedTuple):
    """State at the end of a load step, and its derivatives in the n_p parameters."""

    u: Array
    """(n_node, 3) mm"""
    u_gradient: Array
    """(n_node, 3, n_p) mm"""
    travel: float
    """mm"""
    travel_gradient: Array
    """(n_p,) mm"""


def at_rest(faces: Faces, glued: npt.NDArray[np.bool_], slopes: SurfaceSlopes) -> Ties:
    """Ties at travel 0: points where `glued` (n_face, n_q) hang on their springs in place."""
    anchor_gradient = slopes.points.copy()
    anchor_gradient[glued, 1] = slopes.height  # on the pin, wherever that starts
    return Ties(
        kind=np.where(glued, TIED_TO_PIN, FREE).astype(np.int64),
        hold=np.where(glued, 1.0, 0.0),
        touch=faces.points.copy(),
        anchor=faces.points.copy(),
        hold_gradient=np.zeros(slopes.weights.shape),
        touch_gradient=anchor_gradient.copy(),
        anchor_gradient=anchor_gradient,
    )


def step_at_rest(faces: Faces, slopes: SurfaceSlopes, start: SurfaceSlopes) -> Step:
    """State at travel 0.

    `start` are the slopes of the surfaces there, wherever the pin's travel begins.
    """
    n_node = int(faces.nodes.max()) + 1
    lower = slopes.height - start.height
    return Step(np.zeros((n_node, 3)), np.zeros((n_node, 3, lower.size)), 0.0, lower)


@kernel()
def share(depth: float, grip: float) -> tuple[float, float]:
    """Share of the spring at a penetration (mm), and its slope, 1/mm; all of it from `grip` on."""
    t = min(max(depth / grip, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / grip


class _FaceState(NamedTuple):
    """Points of one face at the end of a load step, as the floor sees them."""

    place: Array
    """(n_q, 3) mm"""
    motion: Array
    """(n_q, 3, n_p) mm"""
    step: Step


@kernel()
def tie(
    ties: Ties,
    faces: Faces,
    before: Step,
    step: Step,
    pin: RigidPin,
    stick: Stick,
    slopes: SurfaceSlopes,
) -> int:
    """Anchor what touched in the step, tighten what got deeper; counts what is newly tied.

    `before` is the state at the end of the last step; `ties` is changed.
    """
    n_p = slopes.height.size
    found = 0
    moved, d_gap, seen = np.empty((3, n_p)), np.empty((2, n_p)), np.empty((3, n_p))
    place, met = np.empty(3), np.empty(ties.kind.shape[1], dtype=np.bool_)
    for c in range(ties.kind.shape[0]):
        if faces.base[c]:
            continue
        here = positions(step.u, faces.nodes[c], faces.shape[c], faces.points[c])
        loose = _touching(ties, faces, here, step.travel, c, pin, stick, met)
        if loose == 0:
            continue
        now = _state(step, here, faces, slopes, c)
        if met.any():
            found += int(np.sum(met))
            at = positions(before.u, faces.nodes[c], faces.shape[c], faces.points[c])
            then = _state(before, at, faces, slopes, c)
            for q in range(met.size):
                if met[q]:
                    _meet(ties, c, q, then, now, pin, slopes, d_gap, seen)
        for q in range(met.size):
            if ties.kind[c, q] == FREE or ties.hold[c, q] >= 1.0:
                continue
            surface = PIN if ties.kind[c, q] == TIED_TO_PIN else FLOOR
            _fill_seen(now, q, surface, place, moved)
            gap = _gap(place, moved, surface, pin, slopes, d_gap[0], seen)
            held, tighter = share(-gap, pin.grip)
            if held > ties.hold[c, q]:
                d_held = -tighter * d_gap[0]
                _anchor(ties, c, q, place, gap, d_gap[0], held, d_held, pin, slopes, seen)
                ties.hold[c, q] = held
                ties.hold_gradient[c, q] = d_held
    return found


@kernel()
def _touching(
    ties: Ties,
    faces: Faces,
    here: Array,
    travel: float,
    c: int,
    pin: RigidPin,
    stick: Stick,
    met: BoolArray,
) -> int:
    """Number of points of face c that may get tighter; `met` (n_q,) are those not tied before.

    `here` (n_q, 3) mm are their places, `ties.kind` is changed.
    """
    loose = 0
    for q in range(met.size):
        met[q] = False
        if ties.hold[c, q] >= 1.0:
            continue
        if ties.kind[c, q] == FREE:
            ties.kind[c, q] = _touched(here[q], travel, faces.floor[c], pin, stick)
            met[q] = ties.kind[c, q] != FREE
        if ties.kind[c, q] != FREE:
            loose += 1
    return loose


@kernel()
def _state(step: Step, place: Array, faces: Faces, slopes: SurfaceSlopes, c: int) -> _FaceState:
    """Face c at the end of a step, its points at `place` (n_q, 3) mm."""
    moved = motions(step.u_gradient, faces.nodes[c], faces.shape[c], slopes.points[c])
    return _FaceState(place, moved, step)


@kernel()
def _fill_seen(face: _FaceState, q: int, surface: int, place: Array, moved: Array) -> None:
    """Fill place (3,) mm and motion (3, n_p) mm of point q as the surface sees it."""
    place[:] = face.place[q]
    moved[:, :] = face.motion[q]
    if surface == PIN:
        place[1] += face.step.travel
        moved[1] += face.step.travel_gradient


@kernel()
def _touched(place: Array, travel: float, on_side: bool, pin: RigidPin, stick: Stick) -> int:
    """Which surface that sticks a free point at `place` (3,) mm is in, FREE if none."""
    if stick.floor and on_side and place[1] < 0.0:
        return TIED_TO_FLOOR
    if stick.pin and pin_point(place, travel, pin).gap < 0.0:
        return TIED_TO_PIN
    return FREE


@kernel()
def _gap(
    place: Array,
    moved: Array,
    surface: int,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    d_gap: Array,
    seen: Array,
) -> float:
    """Distance to the surface (mm) of a place relative to it; fills its derivative (n_p,).

    `moved` (3, n_p) is the place's own, `seen` (3, n_p) work space.
    """
    if surface == FLOOR:
        d_gap[:] = moved[1]
        height: float = place[1]
        return height
    s = pin_point(place, 0.0, pin)
    relative_motion(place, moved, pin, slopes, seen)
    for j in range(d_gap.size):
        d_gap[j] = gap_slope(s, seen, slopes, j)
    return s.gap


@kernel()
def _anchor(
    ties: Ties,
    c: int,
    q: int,
    place: Array,
    gap: float,
    d_gap: Array,
    held: float,
    d_held: Array,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    seen: Array,
) -> None:
    """Anchor what is added to the hold of point q of face c, and average.

    It is added without pressure of its own: as deep below where the point met the surface as that
    is now deeper than a spring with the penalty's pressure.  `seen` is the point's motion as the
    pin sees it.
    """
    m = min(-gap, pin.ramp)
    deeper = m - m * m / (2.0 * pin.ramp)
    by_gap, by_ramp = m / pin.ramp - 1.0, m * m / (2.0 * pin.ramp * pin.ramp)
    on_pin = ties.kind[c, q] == TIED_TO_PIN
    s = pin_point(place, 0.0, pin)
    normal = (s.nx, s.ny, s.nz) if on_pin else (0.0, 1.0, 0.0)
    old = ties.hold[c, q] / held
    anchor, d_anchor = ties.anchor[c, q], ties.anchor_gradient[c, q]
    for j in range(d_gap.size):
        d_old = (ties.hold_gradient[c, q, j] - old * d_held[j]) / held
        d_deeper = by_gap * d_gap[j] + by_ramp * slopes.ramp[j]
        turned = normal_slope(s, seen, pin, slopes, j) if on_pin else (0.0, 0.0, 0.0)
        for i in range(3):
            new = ties.touch[c, q, i] - deeper * normal[i]
            d_new = ties.touch_gradient[c, q, i, j] - d_deeper * normal[i] - deeper * turned[i]
            mean = old * d_anchor[i, j] + (1.0 - old) * d_new
            d_anchor[i, j] = mean + d_old * (anchor[i] - new)
    for i in range(3):
        new = ties.touch[c, q, i] - deeper * normal[i]
        anchor[i] = old * anchor[i] + (1.0 - old) * new


@kernel()
def _meet(
    ties: Ties,
    c: int,
    q: int,
    then: _FaceState,
    now: _FaceState,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    d_gap: Array,
    seen: Array,
) -> None:
    """Where point q of face c met the surface on its straight way through the step.

    `then` and `now` are its two ends.
    """
    surface = PIN if ties.kind[c, q] == TIED_TO_PIN else FLOOR
    n_p = d_gap.shape[1]
    old, new = np.empty(3), np.empty(3)
    d_old, d_new = np.empty((3, n_p)), np.empty((3, n_p))
    _fill_seen(then, q, surface, old, d_old)
    _fill_seen(now, q, surface, new, d_new)
    start = _gap(old, d_old, surface, pin, slopes, d_gap[0], seen)
    end = _gap(new, d_new, surface, pin, slopes, d_gap[1], seen)
    if start < 0.0:  # in touch at rest already
        start = 0.0
        d_gap[0] = 0.0
    t = start / (start - end)
    for i in range(3):
        way = new[i] - old[i]
        ties.touch[c, q, i] = old[i] + t * way
        for j in range(n_p):
            dt = (start * d_gap[1, j] - end * d_gap[0, j]) / (start - end) ** 2
            along = (1.0 - t) * d_old[i, j] + t * d_new[i, j]
            ties.touch_gradient[c, q, i, j] = along + dt * way
