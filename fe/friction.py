"""Coulomb friction at the contact points of block, pin and base.

A point that touches has slipped by s, its way along the surface since the anchor (two numbers:
arc length across the profile of a bar along z, or x on the floor; and z).  The traction is

    t = mu p h(|s| / a) s / |s|,     h(x) = (3 x - x^3) / 2 for x < 1, else 1,

so that |t| never exceeds mu p, reached after the slip a.  p and s are those of the end of the step;
then the anchor is drawn behind the point to the distance a (return mapping: Giannakopoulos,
Computers & Structures 32, 1989).  A point that does not touch drags its anchor along.

The tractions have no potential.  For the line search there is one with the pressure limit, the
tangent plane and the slip's offset frozen (`Frame`) at an iterate, where both have the same
gradient; its Hessian is the symmetric matrix that is factorised.  What the tangent has beyond it
goes into `coupling`, and is dealt with iteratively (`fe.newton.solve_coupled`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fe.contact import FREE, ContactSystem, Faces, penalty, position
from fe.pin_surface import RigidPin, bar_distance

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

PIN, FLOOR = 0, 1


class FrictionLaw(NamedTuple):
    """Coefficients of friction, 0 for none."""

    pin: float = 0.0
    base: float = 0.0
    slip: float = 0.01
    """a: slip over which friction grows to its limit, mm"""


class Frame(NamedTuple):
    """Friction frozen at one displacement: limit and slip = offset + tangent plane . x."""

    limit: Array
    """(n_face, n_q) mu p, MPa; 0 where nothing touches"""
    tangent: Array
    """(n_face, n_q, 2) x and y of the tangent across the bar; the other one is z"""
    offset: Array
    """(n_face, n_q, 2) mm"""
    moves: Array
    """(n_face, n_q) 1 where the surface moves with the pin, else 0"""


class Touch(NamedTuple):
    """A point's contact: what friction needs of it."""

    surface: int
    """PIN or FLOOR"""
    limit: float
    """mu p, MPa"""
    slope: float
    """derivative of the limit in the distance to the surface, MPa/mm"""
    nx: float
    ny: float
    """outward normal of the surface"""
    arc: float
    """place along the surface, mm"""
    stretch: float
    """derivative of the arc length along the tangent: > 1 outside a fillet's surface, < 1 inside"""
    curvature: float
    """1/mm, of the surface through the point"""


@njit(cache=True)
def bar_arc(
    x: float, y: float, half_width: float, fillet: float, bottom: float
) -> tuple[float, float]:
    """Arc length on the bar's profile of the point nearest to (x, y), mm, and its stretch.

    Counted from the middle of the flat bottom, with the sign of x; the stretch is its derivative
    along the tangent at (x, y), that is fillet radius over distance from the fillet's centre.
    """
    side = 1.0 if x >= 0.0 else -1.0
    flat = half_width - fillet
    q0 = abs(x) - flat
    q1 = bottom + fillet - y
    if q0 <= 0.0 or q1 <= 0.0:
        if q0 > q1:
            return side * (flat + 0.5 * np.pi * fillet - q1), 1.0
        return x, 1.0
    radius = max(np.sqrt(q0 * q0 + q1 * q1), 1e-6)
    return side * (flat + fillet * np.arctan2(q0, q1)), fillet / radius


@njit(cache=True)
def touch(
    x: Array, on_base: bool, on_side: bool, travel: float, pin: RigidPin, law: FrictionLaw
) -> Touch:
    """Contact of the point x (3,) mm at the pin travel."""
    if on_base:
        pressed = x[1] < 0.0 and law.base > 0.0
        rate = law.base * pin.base_stiffness if pressed else 0.0
        return Touch(FLOOR, -rate * x[1] if pressed else 0.0, -rate, 0.0, 1.0, x[0], 1.0, 0.0)
    if on_side and law.base > 0.0 and x[1] < 0.0:
        _, slope, curvature = penalty(x[1], pin.stiffness, pin.ramp)
        return Touch(FLOOR, -law.base * slope, -law.base * curvature, 0.0, 1.0, x[0], 1.0, 0.0)
    bottom, across = pin.height - travel, x[0] - pin.x
    gap, nx, ny, hxx, _, hyy = bar_distance(across, x[1], pin.half_width, pin.fillet, bottom)
    if gap >= 0.0 or law.pin == 0.0:
        return Touch(PIN, 0.0, 0.0, nx, ny, 0.0, 1.0, 0.0)
    _, slope, curvature = penalty(gap, pin.stiffness, pin.ramp)
    arc, stretch = bar_arc(across, x[1], pin.half_width, pin.fillet, bottom)
    return Touch(PIN, -law.pin * slope, -law.pin * curvature, nx, ny, arc, stretch, hxx + hyy)


@njit(cache=True)
def slip_potential(s0: float, s1: float, slip: float) -> tuple[float, float, float]:
    """Potential per limit at the slip (s0, s1), mm, and two factors of its derivatives.

    Gradient = secant s, Hessian = secant I - fall s s'; returns (potential, secant, fall).
    """
    size = np.sqrt(s0 * s0 + s1 * s1)
    if size < slip:
        x2 = (size / slip) ** 2
        return slip * x2 * (0.75 - 0.125 * x2), (1.5 - 0.5 * x2) / slip, 1.0 / slip**3
    return size - 0.375 * slip, 1.0 / size, 1.0 / size**3


@njit(cache=True)
def freeze(
    u: Array,
    faces: Faces,
    tied: IntArray,
    place: Array,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
) -> Frame:
    """Friction frozen at the displacement u (n_node, 3) mm."""
    n_face, n_quad = faces.weights.shape
    frame = Frame(
        np.zeros((n_face, n_quad)),
        np.zeros((n_face, n_quad, 2)),
        np.zeros((n_face, n_quad, 2)),
        np.zeros((n_face, n_quad)),
    )
    x = np.empty(3)
    for c in range(n_face):
        for q in range(n_quad):
            if tied[c, q] != FREE:
                continue
            position(u, faces, c, q, x)
            t = touch(x, faces.base[c], faces.floor[c], travel, pin, law)
            if t.limit <= 0.0:
                continue
            moves = 1.0 if t.surface == PIN else 0.0
            tx, ty = surface_tangent(t)
            frame.limit[c, q] = t.limit
            frame.tangent[c, q, 0] = tx
            frame.tangent[c, q, 1] = ty
            along = tx * x[0] + ty * (x[1] + moves * travel)
            frame.offset[c, q, 0] = t.arc - place[c, q, t.surface, 0] - along
            frame.offset[c, q, 1] = -place[c, q, t.surface, 1]
            frame.moves[c, q] = moves
    return frame


@njit(cache=True)
def surface_tangent(t: Touch) -> tuple[float, float]:
    """Unit tangent of the surface in the direction of growing arc length."""
    return (-t.ny, t.nx) if t.surface == PIN else (1.0, 0.0)


@njit(cache=True)
def _frozen_slip(frame: Frame, c: int, q: int, x: Array, travel: float) -> tuple[float, float]:
    """Slip of the point x (3,) mm in the frame, mm."""
    along = frame.tangent[c, q, 0] * x[0]
    along += frame.tangent[c, q, 1] * (x[1] + frame.moves[c, q] * travel)
    return frame.offset[c, q, 0] + along, frame.offset[c, q, 1] + x[2]


@njit(cache=True)
def frozen_energy(u: Array, faces: Faces, frame: Frame, travel: float, slip: float) -> float:
    """Frozen friction potential at u (n_node, 3) mm, N mm."""
    energy = 0.0
    x = np.empty(3)
    for c in range(frame.limit.shape[0]):
        for q in range(frame.limit.shape[1]):
            if frame.limit[c, q] > 0.0:
                position(u, faces, c, q, x)
                s0, s1 = _frozen_slip(frame, c, q, x, travel)
                potential, _, _ = slip_potential(s0, s1, slip)
                energy += faces.weights[c, q] * frame.limit[c, q] * potential
    return energy


@njit(cache=True)
def friction_system(
    u: Array,
    faces: Faces,
    frame: Frame,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    system: ContactSystem,
    coupling: Array,
) -> tuple[float, float]:
    """Add friction to the frictionless `system`; returns (frozen energy N mm, pin force N).

    `frame` is that frozen at u.  `coupling` (n_face, n_a, 3, 3, n_a) [a, i, k, b] N/mm is filled
    with what the true tangent has beyond the Hessian of the frozen potential, which goes to
    `system`.
    """
    energy = 0.0
    pin_force = 0.0
    x = np.empty(3)
    f = np.empty(3)
    frozen = np.empty((3, 3))
    true = np.empty((3, 3))
    for c in range(faces.weights.shape[0]):
        coupling[c] = 0.0
        for q in range(faces.weights.shape[1]):
            if frame.limit[c, q] <= 0.0:
                continue
            position(u, faces, c, q, x)
            s0, s1 = _frozen_slip(frame, c, q, x, travel)
            w, moves = faces.weights[c, q], frame.moves[c, q]
            t = touch(x, faces.base[c], faces.floor[c], travel, pin, law)
            energy += w * _point(t, s0, s1, law.slip, f, frozen, true)
            pin_force += w * moves * f[1]
            _add_point(c, faces.shape[c, q], w, moves, f, frozen, true, system)
            _add_matrix(coupling[c], faces.shape[c, q], w, true, frozen)
    return energy, pin_force


@njit(cache=True)
def _point(
    t: Touch, s0: float, s1: float, slip: float, f: Array, frozen: Array, true: Array
) -> float:
    """Frozen energy density of one point; fills force, frozen Hessian and true tangent (3, 3)."""
    potential, secant, fall = slip_potential(s0, s1, slip)
    tx, ty = surface_tangent(t)
    basis = ((tx, 0.0), (ty, 0.0), (0.0, 1.0))
    normal = (t.nx, t.ny, 0.0)
    h00 = t.limit * (secant - fall * s0 * s0)
    h01 = -t.limit * fall * s0 * s1
    h11 = t.limit * (secant - fall * s1 * s1)
    for i in range(3):
        b0, b1 = basis[i]
        direction = secant * (s0 * b0 + s1 * b1)
        f[i] = t.limit * direction
        g0 = b0 * h00 + b1 * h01
        g1 = b0 * h01 + b1 * h11
        for k in range(3):
            frozen[i, k] = g0 * basis[k][0] + g1 * basis[k][1]
            true[i, k] = (
                g0 * t.stretch * basis[k][0]
                + g1 * basis[k][1]
                + direction * t.slope * normal[k]
                - t.limit * secant * s0 * t.curvature * normal[i] * basis[k][0]
            )
    return t.limit * potential


@njit(cache=True)
def _add_point(
    c: int,
    shape: Array,
    w: float,
    moves: float,
    f: Array,
    frozen: Array,
    true: Array,
    system: ContactSystem,
) -> None:
    for a in range(shape.size):
        wa = w * shape[a]
        for i in range(3):
            system.force[c, a, i] += wa * f[i]
            system.by_travel[c, a, i] += wa * moves * true[i, 1]
            system.pin_force_by_u[c, a, i] += wa * moves * true[1, i]
            for k in range(3):
                wh = wa * frozen[i, k]
                if wh != 0.0:
                    for b in range(shape.size):
                        system.tangent[c, a, i, k, b] += wh * shape[b]


@njit(cache=True)
def _add_matrix(block: Array, shape: Array, w: float, true: Array, frozen: Array) -> None:
    for a in range(shape.size):
        for i in range(3):
            for k in range(3):
                value = w * shape[a] * (true[i, k] - frozen[i, k])
                if value != 0.0:
                    for b in range(shape.size):
                        block[a, i, k, b] += value * shape[b]
