"""A solid with a prescribed motion of some nodes: potential in the free unknowns and the travel.

Displacements are u = (free unknowns) + travel * motion, so the force that belongs to the travel is
dE/dtravel, the reactions weighted by the motion (N when the motion is one mm per mm of travel).
Several nodal unknowns may share one equation, as the hoop unknowns of fe.plane_elements do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from fe import plate_contact, plate_slopes
from fe.coupled_tangent import CoupledTangent
from fe.directions import Directions
from fe.discretisation import Pattern, add_entries, entry_slots
from fe.linear_solver import GeneralMatrix
from fe.materials.material import Material
from fe.parameters import Parameters
from fe.plate import Plate, PlateMemory, PlateSlopes
from fe.plate_contact import Limits
from fe.potential import Assembly
from fe.sensitivity import Partials
from fe.solid import Solid
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class DrivenProblem:
    """Everything but the material of a solid moved by a travel."""

    elements: Elements
    pattern: Pattern
    motion: Array
    """(n_node, 3) mm of prescribed motion per mm of travel, 0 at free unknowns"""
    plate: Plate | None = None
    """rigid plate that moves by the travel and that free faces may touch"""
    on_branch: Callable[[Array], bool] | None = None
    """whether u (n_node, 3) mm is on the wanted branch of equilibria, where that is known"""


def equations(fixed: BoolArray) -> IntArray:
    """(3 n_node,) equations in the order of the unknowns; -1 where `fixed` (n_node, 3)."""
    number = np.full(fixed.size, -1, dtype=np.int64)
    free = ~fixed.ravel()
    number[free] = np.arange(int(free.sum()))
    return number


def unknowns(
    element_nodes: IntArray, equation: IntArray, face_nodes: IntArray | None = None
) -> Pattern:
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
    return Pattern(
        equation=equation,
        number=first,
        indptr=indptr,
        indices=indices,
        element_slots=entry_slots(element_nodes, equation, indptr, indices),
        face_slots=entry_slots(face_nodes, equation, indptr, indices),
    )


class _OnPlate(NamedTuple):
    """What a plate does at one state."""

    energy: float
    """N mm"""
    force: float
    """derivative of its energy in the travel at fixed nodes, N"""
    force_slope: float
    """change of `force` per travel, nodes moving with it, N/mm"""
    by_travel: Array
    """(n_node, 3) change of all nodal forces per travel, friction's limits included, N/mm"""
    limits: Limits | None


class DrivenPotential:
    """Assembles one `DrivenProblem` with one material."""

    def __init__(self, problem: DrivenProblem, material: Material) -> None:
        self.problem = problem
        self.solid = Solid(problem.elements, material)
        self.n_unknowns = problem.pattern.n_free
        plate = problem.plate
        self.has_friction = plate is not None and plate.friction > 0.0
        self._upper = np.zeros(0)
        self._couplings: tuple[Array, ...] = ()
        self._coupled: CoupledTangent | None = None
        self._whole: GeneralMatrix | None = None
        if plate is not None and plate.friction > 0.0:
            nodes = problem.elements.nodes
            self._at_ends = np.flatnonzero(np.isin(nodes, plate.ends).any(axis=1))
            parts = (nodes[self._at_ends], plate.edges.nodes)
            self._coupled = CoupledTangent(problem.pattern, *parts)

    def zero_state(self) -> tuple[Array, Array]:
        """Undeformed displacement (n_node, 3) mm and pressure (n_elem, n_p) MPa."""
        return self.solid.zero_state()

    def energy(
        self, u: Array, travel: float, memory: PlateMemory | None, frame: Limits | None = None
    ) -> float:
        """Potential (N mm) at displacement u (n_node, 3) mm; inf where some det F <= 0.

        Friction is that of the limits `frame`, none without them.
        """
        energy = self.solid.energy(u)
        plate = self.problem.plate
        if plate is None or not np.isfinite(energy):
            return energy
        normal = plate_contact.normal_contact(plate, u, travel, self._modulus)
        energy += plate_contact.normal_energy(plate, normal)
        if frame is not None and memory is not None:
            rubbing = plate_contact.frozen_friction(plate, u, memory, frame)
            energy += float(sum(part.energy.sum() for part in rubbing))
        return energy

    def assemble(self, u: Array, p: Array, travel: float, memory: PlateMemory | None) -> Assembly:
        """Potential, gradient and condensed tangent at (u, p), u moved by `travel` (mm) already."""
        problem = self.problem
        energy, smallest, forces = self.solid.assemble(u, p)
        data = np.zeros(problem.pattern.indices.size)
        add_entries(self.solid.tangent, problem.pattern.element_slots, data)
        by_motion = self.solid.tangent_times(problem.motion)
        on_plate = _OnPlate(0.0, 0.0, 0.0, by_motion, None)
        if problem.plate is not None and memory is not None:
            on_plate = self._add_plate(problem.plate, u, travel, memory, forces, by_motion, data)
        self._upper, self._whole = data, None
        held = np.where(problem.pattern.equation >= 0, 0.0, forces.ravel())
        return Assembly(
            energy=energy + on_plate.energy,
            smallest_J=smallest,
            gradient=self.restrict(forces),
            data=data,
            by_travel=self.restrict(on_plate.by_travel),
            pin_force=float(np.sum(problem.motion * forces)) + on_plate.force,
            pin_force_by_u=self.restrict(by_motion),
            pin_force_by_travel=float(np.sum(problem.motion * by_motion)) + on_plate.force_slope,
            force_scale=float(np.linalg.norm(held)),
            frame=on_plate.limits,
        )

    def _add_plate(
        self,
        plate: Plate,
        u: Array,
        travel: float,
        memory: PlateMemory,
        forces: Array,
        by_motion: Array,
        data: Array,
    ) -> _OnPlate:
        """Add the plate's forces, their change by the motion, and its symmetric tangent."""
        motion = self.problem.motion
        normal = plate_contact.normal_contact(plate, u, travel, self._modulus)
        energy = plate_contact.normal_energy(plate, normal)
        plate_contact.add_normal_forces(plate, normal, forces)
        by_motion += plate_contact.normal_by_travel(plate, normal, motion)
        tangent = plate_contact.normal_tangent(plate, normal)
        by_travel, limits = by_motion, None
        if self.has_friction:
            limits = plate_contact.friction_limits(plate, normal, forces)
            follows = plate_contact.coupling(plate, u, memory, normal, limits)
            by_travel = by_motion.copy()
            plate_contact.add_coupling_by_travel(plate, follows, motion, by_travel)
            nodes, at_ends = self.problem.elements.nodes, self._at_ends
            self._couplings = (
                plate_contact.follow_ends(
                    plate, follows, nodes[at_ends], self.solid.tangent[at_ends]
                ),
                plate_contact.edge_coupling(plate, follows, tangent),
            )
            ends, edges = plate_contact.frozen_friction(plate, u, memory, limits)
            energy += float(ends.energy.sum() + edges.energy.sum())
            plate_contact.add_friction_forces(plate, ends, edges, forces)
            plate_contact.add_friction_tangent(plate, edges, tangent)
            self._add_to_ends(plate, ends.stiffness, data)
        add_entries(tangent, self.problem.pattern.face_slots, data)
        return _OnPlate(
            energy,
            plate_contact.travel_force(plate, normal),
            plate_contact.travel_force_slope(plate, normal, motion),
            by_travel,
            limits,
        )

    def partials(
        self,
        u: Array,
        travel: float,
        memory: PlateMemory | None,
        assembly: Assembly,
        parameters: Parameters[PlateSlopes | None],
        inner: Directions,
    ) -> Partials:
        """Derivatives at fixed free unknowns and travel; `assembly` is that of this state.

        `inner` is what the solid's forces are differentiated along.  A zero of the travel that is
        off takes the prescribed motion back.
        """
        problem, plate, slopes = self.problem, self.problem.plate, parameters.surface
        n_p = len(parameters.names)
        total = np.zeros((u.size, n_p))
        parameters.add_inner(total, self.solid.force_slopes(u, inner).reshape(u.size, -1))
        total = total.reshape(*u.shape, n_p)
        direct = np.zeros(n_p)
        if plate is not None and slopes is not None and memory is not None:
            normal = plate_contact.normal_contact(plate, u, travel, self._modulus)
            pressed = plate_slopes.add_normal_slopes(plate, normal, self._modulus, slopes, total)
            direct -= plate.speed * pressed.sum(axis=(0, 1))
            if self.has_friction:
                limits: Limits = assembly.frame
                follows = plate_contact.coupling(plate, u, memory, normal, limits)
                plate_slopes.add_friction_slopes(
                    plate, u, memory, limits, follows, pressed, slopes, total
                )
        back = parameters.zeroes.astype(np.float64)
        return Partials(
            residual=self.restrict(total) - np.outer(assembly.by_travel, back),
            force=direct
            + np.einsum("ni,nij->j", problem.motion, total)
            - assembly.pin_force_by_travel * back,
        )

    def coupled_tangent(self) -> GeneralMatrix:
        """The whole tangent of the last `assemble`, friction's unsymmetric part included, N/mm."""
        if self._coupled is None:
            raise ValueError("coupled_tangent: expected friction and a state that was assembled")
        if self._whole is None:
            self._whole = self._coupled.matrix(self._upper, *self._couplings)
        return self._whole

    @property
    def _modulus(self) -> float:
        """What the plate's penalty goes with, MPa."""
        return self.solid.material.shear_modulus

    def _add_to_ends(self, plate: Plate, stiffness: Array, data: Array) -> None:
        """Add radial stiffnesses (n_end,) of the ends, N/mm; a row begins on the diagonal."""
        equation = self.problem.pattern.equation.reshape(-1, 3)[plate.ends, 0]
        free = equation >= 0
        data[self.problem.pattern.indptr[equation[free]]] += stiffness[free]

    def restrict(self, full: Array) -> Array:
        """(n_free,) or (n_free, k) sums over the equations of nodal (n_node, 3[, k]) values."""
        return self.problem.pattern.restrict(full)

    def expand(self, free: Array) -> Array:
        """(n_node, 3[, k]) displacement from its (n_free[, k]) free values, else zero."""
        return self.problem.pattern.expand(free)

    def pressure_step(self, du: Array) -> Array:
        """Pressure increment (n_elem, n_p) MPa that belongs to du (n_node, 3) mm."""
        return self.solid.pressure_step(du)

    def consistent_pressure(self, u: Array) -> Array:
        """Pressure (n_elem, n_p) MPa with no residual in the volume equation at u (n_node, 3)."""
        return self.solid.consistent_pressure(u)
