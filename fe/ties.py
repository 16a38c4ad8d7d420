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
from numba import njit

from fe.contact import FREE, TIED_TO_FLOOR, TIED_TO_PIN, Faces, position
from fe.pin_surface import RigidPin, pin_point
from fe.surface_slopes import (
    SurfaceSlopes,
    gap_slope,
    normal_slope,
    point_motion,
    relative_motion,
)
from fe.touch import FLOOR, PIN

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

GRIP = 0.005
"""penetration, mm, at which a point that touches is held by its spring alone: the more, the
smoother, and the later what touches sticks"""


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


@njit(cache=True)
def share(depth: float) -> tuple[float, float]:
    """Share of the spring at a penetration (mm), and its slope, 1/mm."""
    t = min(max(depth / GRIP, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / GRIP


@njit(cache=True)
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
    place, moved = np.empty((2, 3)), np.empty((2, 3, n_p))
    d_gap, seen = np.empty((2, n_p)), np.empty((3, n_p))
    for c in range(ties.kind.shape[0]):
        for q in range(ties.kind.shape[1]):
            if faces.base[c] or ties.hold[c, q] >= 1.0:
                continue
            _fill_place(step, faces, c, q, place)
            if ties.kind[c, q] == FREE:
                kind = _touched(place, faces.floor[c], pin, stick)
                if kind == FREE:
                    continue
                found += 1
                ties.kind[c, q] = kind
                _meet(ties, c, q, faces, before, step, pin, slopes, d_gap, seen)
            surface = PIN if ties.kind[c, q] == TIED_TO_PIN else FLOOR
            _fill_motion(step, faces, slopes, c, q, moved)
            gap = _gap(place[surface], moved[surface], surface, pin, slopes, d_gap[0], seen)
            held, tighter = share(-gap)
            if held > ties.hold[c, q]:
                d_held = -tighter * d_gap[0]
                at = place[surface]
                _anchor(ties, c, q, at, gap, d_gap[0], held, d_held, pin, slopes, seen)
                ties.hold[c, q] = held
                ties.hold_gradient[c, q] = d_held
    return found


@njit(cache=True)
def _fill_place(step: Step, faces: Faces, c: int, q: int, place: Array) -> None:
    """Fill place (2, 3) mm of point q of face c, relative to pin (0) and floor (1)."""
    position(step.u, faces, c, q, place[FLOOR])
    place[PIN] = place[FLOOR]
    place[PIN, 1] += step.travel


@njit(cache=True)
def _fill_motion(
    step: Step, faces: Faces, slopes: SurfaceSlopes, c: int, q: int, moved: Array
) -> None:
    """Fill moved (2, 3, n_p) mm, the derivative of what `_fill_place` fills."""
    point_motion(step.u_gradient, faces, slopes, c, q, moved[FLOOR])
    moved[PIN] = moved[FLOOR]
    moved[PIN, 1] += step.travel_gradient


@njit(cache=True)
def _touched(place: Array, on_side: bool, pin: RigidPin, stick: Stick) -> int:
    """Which surface that sticks a free point is in, FREE if none; place (2, 3) mm."""
    if stick.floor and on_side and place[FLOOR, 1] < 0.0:
        return TIED_TO_FLOOR
    if stick.pin and pin_point(place[PIN], 0.0, pin).gap < 0.0:
        return TIED_TO_PIN
    return FREE


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def _meet(
    ties: Ties,
    c: int,
    q: int,
    faces: Faces,
    before: Step,
    step: Step,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    d_gap: Array,
    seen: Array,
) -> None:
    """Where point q of face c met the surface on its straight way through the step."""
    surface = PIN if ties.kind[c, q] == TIED_TO_PIN else FLOOR
    n_p = d_gap.shape[1]
    places, motions = np.empty((2, 2, 3)), np.empty((2, 2, 3, n_p))
    _fill_place(before, faces, c, q, places[0])
    _fill_place(step, faces, c, q, places[1])
    _fill_motion(before, faces, slopes, c, q, motions[0])
    _fill_motion(step, faces, slopes, c, q, motions[1])
    old, d_old = places[0, surface], motions[0, surface]
    new, d_new = places[1, surface], motions[1, surface]
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
