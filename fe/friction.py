"""Coulomb friction at the contact points of block, pin and base.

A point that touches has slipped by s, its way along the surface since the anchor (two numbers,
see `fe.touch`).  The traction on the surface is

    t = mu p h(|s| / a) s / |s|,     h(x) = (3 x - x^3) / 2 for x < 1, else 1,

so that |t| never exceeds mu p, reached after the slip a.  p and s are those of the end of the step;
then the anchor is drawn behind the point to the distance a (return mapping: Giannakopoulos,
Computers & Structures 32, 1989).  A point that does not touch drags its anchor along.

The tractions have no potential.  For the line search there is one with the pressure limit, the
tangent plane and the slip's offset frozen (`Frame`) at an iterate, where both have the same
gradient; its Hessian is the symmetric matrix that is factorised.  What the tangent has beyond it
goes into `coupling`, and into the unsymmetric matrix of `fe.coupled_tangent`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.contact import FREE, ContactSystem, Faces
from fe.face_rows import (
    BY_TRAVEL,
    FORCE,
    N_SYMMETRIC,
    PIN_FORCE_BY_U,
    FaceRows,
    add_other,
    add_symmetric,
    add_vectors,
    empty_rows,
    none_filled,
    positions,
    put_shape,
    sum_matrices,
)
from fe.pin_surface import RigidPin
from fe.touch import PIN, Chart, FrictionLaw, empty_chart, touch

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class Frame(NamedTuple):
    """Friction frozen at one displacement: limit and slip = offset + tangent plane . x."""

    limit: Array
    """(n_face, n_q) mu p, MPa; 0 where nothing touches"""
    tangent: Array
    """(n_face, n_q, 2, 3) unit tangents"""
    offset: Array
    """(n_face, n_q, 2) mm"""
    moves: Array
    """(n_face, n_q) 1 where the surface moves with the pin, else 0"""


@kernel()
def slip_potential(s0: float, s1: float, slip: float) -> tuple[float, float, float]:
    """Potential per limit at the slip (s0, s1), mm, and two factors of its derivatives.

    Gradient = secant s, Hessian = secant I - fall s s'; returns (potential, secant, fall).
    """
    size = np.sqrt(s0 * s0 + s1 * s1)
    if size < slip:
        x2 = (size / slip) ** 2
        return slip * x2 * (0.75 - 0.125 * x2), (1.5 - 0.5 * x2) / slip, 1.0 / slip**3
    return size - 0.375 * slip, 1.0 / size, 1.0 / size**3


@kernel()
def _frozen_slip(frame: Frame, c: int, q: int, x: Array, travel: float) -> tuple[float, float]:
    """Slip of the point x (3,) mm in the frame, mm."""
    s0, s1 = frame.offset[c, q, 0], frame.offset[c, q, 1]
    for i in range(3):
        xi = x[i] + (frame.moves[c, q] * travel if i == 1 else 0.0)
        s0 += frame.tangent[c, q, 0, i] * xi
        s1 += frame.tangent[c, q, 1, i] * xi
    return s0, s1


@kernel()
def frozen_energy(u: Array, faces: Faces, frame: Frame, travel: float, slip: float) -> float:
    """Frozen friction potential at u (n_node, 3) mm, N mm."""
    energy = 0.0
    for c in range(frame.limit.shape[0]):
        here = positions(u, faces.nodes[c], faces.shape[c], faces.points[c])
        for q in range(frame.limit.shape[1]):
            if frame.limit[c, q] > 0.0:
                s0, s1 = _frozen_slip(frame, c, q, here[q], travel)
                potential, _, _ = slip_potential(s0, s1, slip)
                energy += faces.weights[c, q] * frame.limit[c, q] * potential
    return energy


@kernel()
def friction_system(
    u: Array,
    faces: Faces,
    tied: IntArray,
    place: Array,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    system: ContactSystem,
    coupling: Array,
) -> tuple[Frame, float, float]:
    """Add friction to the frictionless `system`.

    Returns (the frame frozen at u, its energy N mm, pin force N).  tied (n_face, n_q) is the kind
    of `fe.ties.Ties`, place (n_face, n_q, 2, 2) mm that of `fe.slip_anchors`.  `coupling`
    (n_face, n_a, 3, 3, n_a) [a, i, k, b] N/mm is filled with what the true tangent has beyond the
    Hessian of the frozen potential, which goes to `system`.
    """
    energy = 0.0
    pin_force = 0.0
    n_face, n_quad, n_a = faces.shape.shape
    frame = _empty_frame(n_face, n_quad)
    f = np.empty(3)
    frozen = np.empty((3, 3))
    true = np.empty((3, 3))
    chart = empty_chart()
    rows = empty_rows(n_quad, n_a, N_SYMMETRIC + 9)
    for c in range(n_face):
        coupling[c] = 0.0
        n = none_filled()
        here = positions(u, faces.nodes[c], faces.shape[c], faces.points[c])
        for q in range(n_quad):
            if tied[c, q] != FREE:
                continue
            x, w = here[q], faces.weights[c, q]
            surface, limit, slope = touch(x, faces.base[c], faces.floor[c], travel, pin, law, chart)
            if limit <= 0.0:
                continue
            moves = 1.0 if surface == PIN else 0.0
            _freeze(frame, c, q, limit, moves, chart, place[c, q, surface], x, travel)
            s0, s1 = _frozen_slip(frame, c, q, x, travel)
            energy += w * _point(chart, limit, slope, s0, s1, law.slip, f, frozen, true)
            pin_force += w * moves * f[1]
            _put(rows, n, faces.shape[c, q], w, moves, f, frozen, true)
            n += 1
        if n > 0:
            add_vectors(rows, n, system.force[c], system.by_travel[c], system.pin_force_by_u[c])
            total = sum_matrices(rows, n)
            add_symmetric(total, system.tangent[c])
            add_other(total, coupling[c])
    return frame, energy, pin_force


@kernel()
def _empty_frame(n_face: int, n_quad: int) -> Frame:
    """Of points that do not touch."""
    return Frame(
        np.zeros((n_face, n_quad)),
        np.zeros((n_face, n_quad, 2, 3)),
        np.zeros((n_face, n_quad, 2)),
        np.zeros((n_face, n_quad)),
    )


@kernel(inline="always")
def _freeze(
    frame: Frame,
    c: int,
    q: int,
    limit: float,
    moves: float,
    chart: Chart,
    anchor: Array,
    x: Array,
    travel: float,
) -> None:
    """Freeze friction of point q of face c at x (3,) mm, whose anchor (2,) mm it has."""
    frame.limit[c, q] = limit
    frame.moves[c, q] = moves
    for a in range(2):
        offset = chart.place[a] - anchor[a] - chart.tangent[a, 1] * moves * travel
        for i in range(3):
            frame.tangent[c, q, a, i] = chart.tangent[a, i]
            offset -= chart.tangent[a, i] * x[i]
        frame.offset[c, q, a] = offset


@kernel(inline="always")
def _put(
    rows: FaceRows,
    n: int,
    shape: Array,
    w: float,
    moves: float,
    f: Array,
    frozen: Array,
    true: Array,
) -> None:
    """Put a point into row n: its frozen tangent, and what the true one has beyond it."""
    put_shape(rows, n, shape)
    column = 0
    for i in range(3):
        rows.vectors[n, FORCE + i] = w * f[i]
        rows.vectors[n, BY_TRAVEL + i] = w * moves * true[i, 1]
        rows.vectors[n, PIN_FORCE_BY_U + i] = w * moves * true[1, i]
        for k in range(i, 3):
            rows.matrices[n, column] = w * frozen[i, k]
            column += 1
        for k in range(3):
            rows.matrices[n, N_SYMMETRIC + 3 * i + k] = w * (true[i, k] - frozen[i, k])


@kernel()
def _point(
    chart: Chart,
    limit: float,
    slope: float,
    s0: float,
    s1: float,
    slip: float,
    f: Array,
    frozen: Array,
    true: Array,
) -> float:
    """Frozen energy density of one point; fills force, frozen Hessian and true tangent (3, 3)."""
    potential, secant, fall = slip_potential(s0, s1, slip)
    h00 = limit * (secant - fall * s0 * s0)
    h01 = -limit * fall * s0 * s1
    h11 = limit * (secant - fall * s1 * s1)
    t0, t1 = chart.tangent[0], chart.tangent[1]
    for i in range(3):
        direction = secant * (s0 * t0[i] + s1 * t1[i])
        f[i] = limit * direction
        g0 = t0[i] * h00 + t1[i] * h01
        g1 = t0[i] * h01 + t1[i] * h11
        for k in range(3):
            frozen[i, k] = g0 * t0[k] + g1 * t1[k]
            bend = s0 * chart.bend[0, i, k] + s1 * chart.bend[1, i, k]
            true[i, k] = (
                g0 * chart.slope[0, k]
                + g1 * chart.slope[1, k]
                + direction * slope * chart.normal[k]
                + limit * secant * bend
            )
    return limit * potential
