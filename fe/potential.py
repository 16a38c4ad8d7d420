"""The displacement-only potential of block and contact, assembled with gradient and tangent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fe import contact, friction
from fe.contact import Faces
from fe.contact_memory import ContactMemory
from fe.contact_slopes import contact_pull
from fe.coupled_tangent import CoupledTangent
from fe.directions import Directions
from fe.discretisation import Pattern, add_entries, sum_to_nodes
from fe.friction import Frame
from fe.linear_solver import GeneralMatrix
from fe.materials.material import Material
from fe.pin_surface import RigidPin
from fe.solid import Solid
from fe.surface_slopes import SurfaceSlopes
from fe.touch import FrictionLaw
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """One specimen with one material, discretised."""

    elements: Elements
    faces: Faces
    pattern: Pattern
    pin: RigidPin
    material: Material
    friction: FrictionLaw = FrictionLaw()  # noqa: RUF009 - immutable


@dataclass(frozen=True)
class Assembly:
    """The potential and its derivatives at one state."""

    energy: float
    """N mm, with the friction potential of `frame`; inf where some det F <= 0"""
    smallest_J: float
    gradient: Array
    """(n_free,) N"""
    data: Array
    """(nnz,) upper-triangular tangent, N/mm"""
    by_travel: Array
    """(n_free,) d gradient / d travel, N/mm"""
    pin_force: float
    """vertical force of the modelled part, N, positive in compression"""
    pin_force_by_u: Array
    """(n_free,) derivative of `pin_force` in the displacement, N/mm"""
    pin_force_by_travel: float
    """derivative of `pin_force` in the travel at fixed displacement, N/mm"""
    force_scale: float
    """norm of the contact forces, N: what the residual is small against"""
    frame: Any
    """friction frozen at this state as the potential takes it, None without friction"""


class Potential:
    """Assembles one `Problem`, holding the element work arrays between calls.

    Raises ValueError when the material is incompressible (infinite bulk modulus).
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.solid = Solid(problem.elements, problem.material)
        self._contact_system = contact.empty_system(problem.faces)
        self.has_friction = problem.friction.pin > 0.0 or problem.friction.base > 0.0
        self._coupling = np.zeros_like(self._contact_system.tangent)
        self._coupled: CoupledTangent | None = None
        if self.has_friction:
            self._coupled = CoupledTangent(problem.pattern, problem.faces.nodes)
        self._upper = np.zeros(0)
        self._whole: GeneralMatrix | None = None
        self.n_unknowns = problem.pattern.n_free

    def zero_state(self) -> tuple[Array, Array]:
        """Undeformed displacement (n_node, 3) mm and pressure (n_elem, n_p) MPa."""
        return self.solid.zero_state()

    def energy(
        self, u: Array, travel: float, memory: ContactMemory, frame: Frame | None = None
    ) -> float:
        """Potential (N mm) at displacement u (n_node, 3) mm; inf where some det F <= 0.

        Friction is that of `frame`, none without it.
        """
        problem = self.problem
        inner = self.solid.energy(u)
        if not np.isfinite(inner):
            return inner
        inner += self._contact(u, travel, memory, with_derivatives=False)[0]
        if frame is not None:
            slip = problem.friction.slip
            inner += friction.frozen_energy(u, problem.faces, frame, travel, slip)
        return inner

    def assemble(self, u: Array, p: Array, travel: float, memory: ContactMemory) -> Assembly:
        """Potential, gradient and condensed tangent at (u, p) and pin travel (mm)."""
        problem = self.problem
        energy, smallest, inner = self.solid.assemble(u, p)
        contact_energy, pin_force = self._contact(u, travel, memory, with_derivatives=True)
        frame = None
        if self.has_friction:
            frame, friction_energy, on_pin = self._add_friction(u, travel, memory)
            contact_energy, pin_force = contact_energy + friction_energy, pin_force + on_pin
        forces = self._contact_system.force
        pattern = problem.pattern
        data = np.zeros(problem.pattern.indices.size)
        add_entries(self.solid.tangent, problem.pattern.element_slots, data)
        add_entries(self._contact_system.tangent, problem.pattern.face_slots, data)
        self._upper, self._whole = data, None
        return Assembly(
            energy=energy + contact_energy,
            smallest_J=smallest,
            gradient=pattern.restrict(inner + self._sum_faces(forces)),
            data=data,
            by_travel=pattern.restrict(self._sum_faces(self._contact_system.by_travel)),
            pin_force=pin_force,
            pin_force_by_u=pattern.restrict(self._sum_faces(self._contact_system.pin_force_by_u)),
            # shape functions add up to 1: these are the forces of all points that move with the pin
            pin_force_by_travel=float(self._contact_system.by_travel[..., 1].sum()),
            force_scale=float(np.linalg.norm(self._sum_faces(np.abs(forces)))),
            frame=frame,
        )

    def expand(self, free: Array) -> Array:
        """(n_node, 3[, k]) displacement from its (n_free[, k]) free values, else zero."""
        return self.problem.pattern.expand(free)

    def pressure_step(self, du: Array) -> Array:
        """Pressure increment (n_elem, n_p) MPa that belongs to du (n_node, 3) mm.

        Uses coupling and constraint of the last `assemble`.
        """
        return self.solid.pressure_step(du)

    def consistent_pressure(self, u: Array) -> Array:
        """Pressure (n_elem, n_p) MPa with no residual in the volume equation at u (n_node, 3)."""
        return self.solid.consistent_pressure(u)

    def inner_partials(self, u: Array, along: Directions) -> Array:
        """(n_free, n_c + 1 + n_v) derivative of the inner forces at fixed u (n_node, 3) mm, N.

        Along changes of the law, in the bulk modulus and along motions of the mesh.
        """
        return self.restrict(self.solid.force_slopes(u, along))

    def contact_partials(
        self, u: Array, travel: float, memory: ContactMemory, slopes: SurfaceSlopes
    ) -> tuple[Array, Array]:
        """Derivative of the contact forces at fixed u (n_node, 3) and travel, mm.

        Returns (gradient (n_free, n_p) N, pin force (n_p,) N).
        """
        problem = self.problem
        total, on_pin = contact_pull(
            u,
            problem.faces,
            memory.ties,
            memory.slip,
            travel,
            problem.pin,
            problem.friction,
            slopes,
        )
        return self.restrict(total), on_pin

    def restrict(self, full: Array) -> Array:
        """(n_free,) or (n_free, k) from (n_node, 3[, k]): the transpose of `expand`."""
        return self.problem.pattern.restrict(full)

    def coupled_tangent(self) -> GeneralMatrix:
        """The whole tangent of the last `assemble`, friction's unsymmetric part included, N/mm."""
        if self._coupled is None:
            raise ValueError("coupled_tangent: expected friction and a state that was assembled")
        if self._whole is None:
            self._whole = self._coupled.matrix(self._upper, self._coupling)
        return self._whole

    def _add_friction(
        self, u: Array, travel: float, memory: ContactMemory
    ) -> tuple[Frame, float, float]:
        """Add friction to the contact system: (its frame at u, energy N mm, pin force N)."""
        faces, pin, law = self.problem.faces, self.problem.pin, self.problem.friction
        kind, place = memory.ties.kind, memory.slip.place
        system, coupling = self._contact_system, self._coupling
        frame, energy, pin_force = friction.friction_system(
            u, faces, kind, place, travel, pin, law, system, coupling
        )
        return frame, float(energy), float(pin_force)

    def _contact(
        self, u: Array, travel: float, memory: ContactMemory, *, with_derivatives: bool
    ) -> tuple[float, float]:
        energy, pin_force = contact.contact_system(
            u,
            self.problem.faces,
            memory.ties.kind,
            memory.ties.hold,
            memory.ties.anchor,
            travel,
            self.problem.pin,
            with_derivatives,
            self._contact_system,
        )
        return float(energy), float(pin_force)

    def _sum_faces(self, values: Array) -> Array:
        n_node = len(self.problem.elements.positions)
        return sum_to_nodes(self.problem.faces.nodes, values, n_node)
