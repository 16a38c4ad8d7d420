"""Contact of the block's free faces with a rigid filleted pin and a rigid floor.

Evaluated at Gauss points of the deformed element faces, not at nodes (nodal contact chatters).
Free points meet a penalty whose stiffness ramps up over a small penetration, so the energy is
twice continuously differentiable (`fe.friction` adds what resists sliding); tied points (stick)
hang on an isotropic spring to an anchor that moves with the pin or rests on the floor.  Base faces
are held at the floor by a spring that acts both ways and is so stiff that it only serves to read
the pressure.  All pressures scale with the material, so the scale symmetry of the specimen stays
exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.face_rows import (
    BY_TRAVEL,
    FORCE,
    N_SYMMETRIC,
    PIN_FORCE_BY_U,
    FaceRows,
    add_symmetric,
    add_vectors,
    empty_rows,
    none_filled,
    positions,
    put_shape,
    sum_matrices,
)
from fe.pin_surface import GRIP, RigidPin, pin_point
from fe.positive_numbers import is_number, positive_numbers

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

FREE, TIED_TO_PIN, TIED_TO_FLOOR = 0, 1, 2


class Faces(NamedTuple):
    """Quadrature of the faces that may touch something."""

    nodes: IntArray
    """(n_face, n_a)"""
    shape: Array
    """(n_face, n_q, n_a) shape functions"""
    weights: Array
    """(n_face, n_q) reference area, mm2"""
    points: Array
    """(n_face, n_q, 3) reference position, mm"""
    floor: npt.NDArray[np.bool_]
    """(n_face,) whether the face may also touch the floor (side faces)"""
    base: npt.NDArray[np.bool_]
    """(n_face,) whether the face lies on the floor and is held there (bottom faces)"""


@dataclass(frozen=True)
class PenaltyLaw:
    """Contact stiffness relative to the shear modulus mu."""

    stiffness: float = 6667.0
    """pressure per penetration and shear modulus, 1/mm"""
    ramp: float = 0.1
    """penetration over which the stiffness grows from 0 to full, mm"""
    base: float = 2e5
    """pressure per lift or dip of a base face with friction and shear modulus, 1/mm: the base moves
    by 1e-5 mm where u_y = 0 is meant, and the pressure that friction needs comes out smooth"""
    slip: float = 0.01
    """slip over which friction grows from 0 to its limit, mm"""
    grip: float = GRIP
    """penetration at which a point that sticks is held by its spring alone, mm: the more, the
    smoother, and the later what touches sticks"""

    def __post_init__(self) -> None:
        positive_numbers(self)

    def stiffened(self, times: float) -> PenaltyLaw:
        """The law by which the pin and the floor give way `times` less, at every pressure.

        Penetration and what it takes off the force are `times` smaller, and so is the give of the
        springs of points that stick, which hold what they hold at the same pressure; 1 is this law.
        The slip over which friction grows is not a compliance of the surface, and stays.
        Raises ValueError for `times` that is not a finite number above 0.
        """
        if not (is_number(times) and 0.0 < times < np.inf):
            raise ValueError(f"times: expected a finite number above 0, found {times!r}")
        return replace(
            self,
            stiffness=times * self.stiffness,
            ramp=self.ramp / times,
            grip=self.grip / times,
        )


class ContactSystem(NamedTuple):
    """Work arrays that `contact_system` fills."""

    force: Array
    """(n_face, n_a, 3) N"""
    tangent: Array
    """(n_face, n_a, 3, 3, n_a) indexed [a, i, k, b], N/mm"""
    by_travel: Array
    """(n_face, n_a, 3) derivative of force in the pin travel, N/mm"""
    pin_force_by_u: Array
    """(n_face, n_a, 3) derivative of the vertical pin force in the nodal displacements, N/mm"""


def empty_system(faces: Faces) -> ContactSystem:
    """Zeroed work arrays of the right shapes."""
    n_face, n_a = faces.nodes.shape
    return ContactSystem(
        force=np.zeros((n_face, n_a, 3)),
        tangent=np.zeros((n_face, n_a, 3, 3, n_a)),
        by_travel=np.zeros((n_face, n_a, 3)),
        pin_force_by_u=np.zeros((n_face, n_a, 3)),
    )


@kernel()
def penalty(gap: float, stiffness: float, ramp: float) -> tuple[float, float, float]:
    """Energy density and its first two derivatives in the gap (negative gap is penetration)."""
    t = -gap
    if t <= 0.0:
        return 0.0, 0.0, 0.0
    m = min(t, ramp)
    x = t - m
    return (
        stiffness * (m * m * m / (6.0 * ramp) + x * ramp / 2.0 + x * x / 2.0),
        -stiffness * (m * m / (2.0 * ramp) + x),
        stiffness * m / ramp,
    )


@kernel()
def _tied_point(
    x: Array, anchor: Array, shift: float, stiffness: float, force: Array, hessian: Array
) -> float:
    """Spring energy density to an anchor that has moved up by `shift`; fills derivatives."""
    energy = 0.0
    for i in range(3):
        d = x[i] - anchor[i] - (shift if i == 1 else 0.0)
        energy += 0.5 * stiffness * d * d
        force[i] = stiffness * d
        for k in range(3):
            hessian[i, k] = stiffness if i == k else 0.0
    return energy


@kernel()
def _free_point(
    x: Array, on_side: bool, travel: float, pin: RigidPin, force: Array, hessian: Array
) -> tuple[float, float, float]:
    """Frictionless penalty of pin and floor; fills the derivatives of the energy density.

    Returns (energy density, the pin's share of force_y, the floor's share of hessian_yy).
    """
    force[:] = 0.0
    hessian[:, :] = 0.0
    s = pin_point(x, travel, pin)
    energy, slope, curvature = penalty(s.gap, pin.stiffness, pin.ramp)
    if slope != 0.0:
        force[0] = slope * s.nx
        force[1] = slope * s.ny
        force[2] = slope * s.nz
        hessian[0, 0] = curvature * s.nx * s.nx + slope * s.hxx
        hessian[0, 1] = curvature * s.nx * s.ny + slope * s.hxy
        hessian[0, 2] = curvature * s.nx * s.nz + slope * s.hxz
        hessian[1, 1] = curvature * s.ny * s.ny + slope * s.hyy
        hessian[1, 2] = curvature * s.ny * s.nz + slope * s.hyz
        hessian[2, 2] = curvature * s.nz * s.nz + slope * s.hzz
        hessian[1, 0], hessian[2, 0] = hessian[0, 1], hessian[0, 2]
        hessian[2, 1] = hessian[1, 2]
    pin_force = force[1]
    floor_stiffness = 0.0
    if on_side and x[1] < 0.0:
        floor_energy, floor_slope, floor_stiffness = penalty(x[1], pin.stiffness, pin.ramp)
        energy += floor_energy
        force[1] += floor_slope
        hessian[1, 1] += floor_stiffness
    return energy, pin_force, floor_stiffness


@kernel()
def _base_face(
    u: Array,
    faces: Faces,
    c: int,
    stiffness: float,
    with_derivatives: bool,
    weighted: Array,
    system: ContactSystem,
) -> float:
    """Energy (N mm) of the spring that holds face c at y = 0; fills its part of the system.

    Linear, so that all points of the face have one product of matrices.  `weighted` (n_q, n_a) is
    work space.
    """
    n_quad, n_a = weighted.shape
    energy = 0.0
    if with_derivatives:
        _clear(c, system)
    for q in range(n_quad):
        lift, held = faces.points[c, q, 1], stiffness * faces.weights[c, q]
        for a in range(n_a):
            lift += faces.shape[c, q, a] * u[faces.nodes[c, a], 1]
            weighted[q, a] = held * faces.shape[c, q, a]
        energy += 0.5 * held * lift * lift
        if with_derivatives:
            for a in range(n_a):
                system.force[c, a, 1] += weighted[q, a] * lift
    if with_derivatives:
        system.tangent[c, :, 1, 1, :] = np.dot(weighted.T, faces.shape[c])
    return energy


@kernel()
def position(u: Array, faces: Faces, c: int, q: int, x: Array) -> None:
    """Fill x (3,) with the deformed position of point q of face c, mm."""
    for i in range(3):
        x[i] = faces.points[c, q, i]
        for a in range(faces.nodes.shape[1]):
            x[i] += faces.shape[c, q, a] * u[faces.nodes[c, a], i]


@kernel()
def contact_system(
    u: Array,
    faces: Faces,
    tied: IntArray,
    hold: Array,
    anchor: Array,
    travel: float,
    pin: RigidPin,
    with_derivatives: bool,
    system: ContactSystem,
) -> tuple[float, float]:
    """Contact of all faces: returns (energy N mm, vertical pin force N of the modelled part).

    u (n_node, 3) mm; tied, hold (n_face, n_q) and anchor (n_face, n_q, 3) mm as kind, hold and
    anchor of `fe.ties.Ties`; travel in mm.  `system` is filled when `with_derivatives`.
    """
    n_face, n_quad, n_a = faces.shape.shape
    f = np.empty(3)
    h = np.empty((3, 3))
    rows = empty_rows(2 * n_quad, n_a, N_SYMMETRIC)  # what is held in part pushes back twice
    weighted = np.empty((n_quad, n_a))
    energy = 0.0
    pin_force = 0.0
    for c in range(n_face):
        if faces.base[c]:
            energy += _base_face(
                u, faces, c, pin.base_stiffness, with_derivatives, weighted, system
            )
            continue
        n = none_filled()
        here = positions(u, faces.nodes[c], faces.shape[c], faces.points[c])
        for q in range(n_quad):
            x, w = here[q], faces.weights[c, q]
            held = 0.0 if tied[c, q] == FREE else hold[c, q]
            if held < 1.0:
                free = w * (1.0 - held)
                e, fy, on_floor = _free_point(x, faces.floor[c], travel, pin, f, h)
                energy += free * e
                pin_force += free * fy
                if with_derivatives and e != 0.0:
                    n = _put(rows, n, faces.shape[c, q], free, f, h, 1.0, on_floor)
            if held > 0.0:
                moves = 1.0 if tied[c, q] == TIED_TO_PIN else 0.0
                e = _tied_point(x, anchor[c, q], -moves * travel, pin.stiffness, f, h)
                energy += w * held * e
                pin_force += w * held * moves * f[1]
                if with_derivatives and e != 0.0:
                    n = _put(rows, n, faces.shape[c, q], w * held, f, h, moves, 0.0)
        if with_derivatives:
            _sum_face(rows, n, c, system)
    return energy, pin_force


@kernel()
def _sum_face(rows: FaceRows, n: int, c: int, system: ContactSystem) -> None:
    """Fill face c from its first n rows."""
    _clear(c, system)
    if n > 0:
        add_vectors(rows, n, system.force[c], system.by_travel[c], system.pin_force_by_u[c])
        add_symmetric(sum_matrices(rows, n), system.tangent[c])


@kernel()
def _clear(c: int, system: ContactSystem) -> None:
    """Nothing at face c."""
    system.force[c] = 0.0
    system.tangent[c] = 0.0
    system.by_travel[c] = 0.0
    system.pin_force_by_u[c] = 0.0


@kernel(inline="always")
def _put(
    rows: FaceRows,
    n: int,
    shape: Array,
    w: float,
    f: Array,
    h: Array,
    moves: float,
    on_floor: float,
) -> int:
    """Put a point into row n; returns the next one.

    What moves with the pin depends on x_y + travel.
    """
    put_shape(rows, n, shape)
    column = 0
    for i in range(3):
        by_pin = w * moves * (h[i, 1] - (on_floor if i == 1 else 0.0))
        rows.vectors[n, FORCE + i] = w * f[i]
        rows.vectors[n, BY_TRAVEL + i] = by_pin
        rows.vectors[n, PIN_FORCE_BY_U + i] = by_pin  # the potential is symmetric
        for k in range(i, 3):
            rows.matrices[n, column] = w * h[i, k]
            column += 1
    return n + 1
