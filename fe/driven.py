"""A solid with a prescribed motion of some nodes: potential in the free unknowns and the travel.

Displacements are u = (free unknowns) + travel * motion, so the force that belongs to the travel is
dE/dtravel, the reactions weighted by the motion (N when the motion is one mm per mm of travel).
Several nodal unknowns may share one equation, as the hoop unknowns of fe.plane_elements do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from fe import plate as contact
from fe.discretisation import Pattern, add_entries, entry_slots
from fe.friction import Frame
from fe.linear_solver import GeneralMatrix
from fe.materials.material import Material
from fe.plate import Plate, PlateMemory, Touch
from fe.potential import Assembly
from fe.solid import Solid
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Unknowns:
    """Which nodal unknowns are free, and the sparse pattern of the tangent over their equations."""

    equation: IntArray
    """(3 n_node,) equation of each unknown, -1 where prescribed"""
    pattern: Pattern
    """its `number` is -1 also for all but the first of the unknowns that share an equation"""


@dataclass(frozen=True)
class DrivenProblem:
    """Everything but the material of a solid moved by a travel."""

    elements: Elements
    unknowns: Unknowns
    motion: Array
    """(n_node, 3) mm of prescribed motion per mm of travel, 0 at free unknowns"""
    plate: Plate | None = None
    """rigid plate that moves by the travel and that free faces may touch"""

    @property
    def pattern(self) -> Pattern:
        """Pattern of the tangent."""
        return self.unknowns.pattern


def equations(fixed: BoolArray) -> IntArray:
    """(3 n_node,) equations in the order of the unknowns; -1 where `fixed` (n_node, 3)."""
    number = np.full(fixed.size, -1, dtype=np.int64)
    free = ~fixed.ravel()
    number[free] = np.arange(int(free.sum()))
    return number


def unknowns(
    element_nodes: IntArray, equation: IntArray, face_nodes: IntArray | None = None
) -> Unknowns:
    """Pattern of element tangents (n_elem, n_a) over `equation` (3 n_node,).

    `face_nodes` (n_face, a) are those of contact faces of the same elements.
    Raises ValueError when nothing is free.
    """
    n_free = int(equation.max()) + 1
    if n_free < 1:
        raise ValueError("equation: expected at least one free unknown, found none")
    columns = equation.reshape(-1, 3)[element_nodes].reshape(len(element_nodes), -1)
    rows = np.broadcast_to(np.arange(len(columns))[:, None], columns.shape)
    free = columns >= 0
    incidence = sp.csr_matrix(
        (np.ones(int(free.sum())), (rows[free], columns[free])), (len(columns), n_free)
    )
    upper = sp.triu(incidence.T @ incidence, format="csr")
    upper.sort_indices()
    indptr, indices = upper.indptr.astype(np.int32), upper.indices.astype(np.int32)
    first = np.full(equation.size, -1, dtype=np.int64)
    _, at = np.unique(equation, return_index=True)
    at = at[equation[at] >= 0]
    first[at] = equation[at]
    if face_nodes is None:
        face_nodes = np.zeros((0, 1), dtype=np.int64)
    return Unknowns(
        equation=equation,
        pattern=Pattern(
            number=first,
            indptr=indptr,
            indices=indices,
            element_slots=entry_slots(element_nodes, equation, indptr, indices),
            face_slots=entry_slots(face_nodes, equation, indptr, indices),
        ),
    )


class DrivenPotential:
    """Assembles one `DrivenProblem` with one material."""

    has_friction = False
    """none that fe.newton must know: friction of the plate is lagged, and has a potential"""

    def __init__(self, problem: DrivenProblem, material: Material) -> None:
        self.problem = problem
        self.solid = Solid(problem.elements, material)
        self._equation = problem.unknowns.equation
        self._free = self._equation >= 0
        self.n_unknowns = problem.pattern.indptr.size - 1

    def zero_state(self) -> tuple[Array, Array]:
        """Undeformed displacement (n_node, 3) mm and pressure (n_elem, n_p) MPa."""
        return self.solid.zero_state()

    def energy(
        self, u: Array, travel: float, memory: PlateMemory | None, frame: Frame | None = None
    ) -> float:
        """Potential (N mm) at displacement u (n_node, 3) mm; inf where some det F <= 0."""
        inner = self.solid.energy(u)
        touch = self._touch(u, travel, memory) if np.isfinite(inner) else None
        return inner if touch is None else inner + touch.energy

    def assemble(self, u: Array, p: Array, travel: float, memory: PlateMemory | None) -> Assembly:
        """Potential, gradient and condensed tangent at (u, p), u moved by `travel` (mm) already."""
        problem = self.problem
        energy, smallest, forces = self.solid.assemble(u, p)
        data = np.zeros(problem.pattern.indices.size)
        add_entries(self.solid.tangent, problem.pattern.element_slots, data)
        by_motion = self.solid.tangent_times(problem.motion)
        travel_force = force_slope = 0.0
        touch = self._touch(u, travel, memory)
        if touch is not None and problem.plate is not None:
            energy += touch.energy
            forces = forces + touch.forces
            by_motion = by_motion + contact.tangent_times(problem.plate, touch, problem.motion)
            travel_force = touch.travel_force
            force_slope = contact.travel_slope(problem.plate, touch, problem.motion)
            add_entries(touch.face_tangent, problem.pattern.face_slots, data)
            self._add_diagonal(touch.nodal_stiffness, data)
        held = np.where(self._free, 0.0, forces.ravel())
        by_travel = self.reduce(by_motion)
        return Assembly(
            energy=energy,
            smallest_J=smallest,
            gradient=self.reduce(forces),
            data=data,
            by_travel=by_travel,
            pin_force=float(np.sum(problem.motion * forces)) + travel_force,
            pin_force_by_u=by_travel,
            pin_force_by_travel=float(np.sum(problem.motion * by_motion)) + force_slope,
            force_scale=float(np.linalg.norm(held)),
            frame=None,
        )

    def force_slopes(self, u: Array, travel: float, directions: Array) -> tuple[Array, Array]:
        """Derivatives along `directions` (n_direction, n_constant + 1) of constants and K, u held.

        (gradient (n_free, n_direction), force (n_direction,)); N per unit of the direction.  The
        plate's penalty follows the shear modulus.  Friction must be absent.
        """
        slopes = self.solid.force_slopes(u, directions)
        plate = self.problem.plate
        direct = np.zeros(len(directions))
        if plate is not None:
            unit = contact.evaluate(plate, u, travel, contact.initial_memory(plate), 1.0)
            stiffer = np.array([_modulus_slope(self.solid.material, d[:-1]) for d in directions])
            slopes = slopes + unit.forces[..., None] * stiffer
            direct = unit.travel_force * stiffer
        direct = direct + np.einsum("ni,nij->j", self.problem.motion, slopes)
        return self.reduce(slopes), direct

    def end_forces(self, u: Array, p: Array, travel: float, memory: PlateMemory) -> Array:
        """(n_end,) force of the plate along z on the nodes that move with it, N."""
        plate = self.problem.plate
        touch = self._touch(u, travel, memory)
        if plate is None or touch is None:
            raise ValueError("plate: expected a problem with a plate, found none")
        forces = self.solid.assemble(u, p)[2] + touch.forces
        ends: Array = forces[plate.ends, 1]
        return ends

    def coupled_tangent(self) -> GeneralMatrix:
        """Raises ValueError: the tangent is symmetric."""
        raise ValueError("coupled_tangent: expected a potential with friction, found none")

    def _touch(self, u: Array, travel: float, memory: PlateMemory | None) -> Touch | None:
        plate = self.problem.plate
        if plate is None or memory is None:
            return None
        return contact.evaluate(plate, u, travel, memory, self.solid.material.shear_modulus)

    def _add_diagonal(self, stiffness: Array, data: Array) -> None:
        """Add (n_node, 3) stiffnesses of single unknowns, N/mm; a row begins on the diagonal."""
        values = self.reduce(stiffness)
        data[self.problem.pattern.indptr[:-1]] += values

    def reduce(self, forces: Array) -> Array:
        """(n_free,) or (n_free, k) forces of the equations from nodal ones (n_node, 3[, k])."""
        flat = forces.reshape(self._equation.size, -1)[self._free]
        total = np.zeros((self.n_unknowns, flat.shape[1]))
        np.add.at(total, self._equation[self._free], flat)
        return total[:, 0] if forces.ndim == 2 else total

    def expand(self, free: Array) -> Array:
        """(n_node, 3) displacement from its (n_free,) free values; prescribed ones are zero."""
        full = np.zeros(self._equation.size)
        full[self._free] = free[self._equation[self._free]]
        return full.reshape(-1, 3)

    def pressure_step(self, du: Array) -> Array:
        """Pressure increment (n_elem, n_p) MPa that belongs to du (n_node, 3) mm."""
        return self.solid.pressure_step(du)

    def consistent_pressure(self, u: Array) -> Array:
        """Pressure (n_elem, n_p) MPa with no residual in the volume equation at u (n_node, 3)."""
        return self.solid.consistent_pressure(u)


def _modulus_slope(material: Material, direction: Array) -> float:
    """Derivative of mu along a change of the constants (n_constant,): mu is bilinear in them."""
    at = np.array(material.constants)
    up, down = (material.law.shear_modulus(at + h * direction) for h in (0.5, -0.5))
    return up - down
