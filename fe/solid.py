"""The strain energy of a meshed solid: nodal forces, condensed tangents, derivatives.

All over *all* nodal unknowns: which of them are free is the business of who moves the solid.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe import weak_form
from fe.directions import Directions
from fe.discretisation import sum_to_nodes
from fe.materials.material import Material
from fe.materials.volumetric import deviation_slopes
from fe.shape_slopes import residual_slopes
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]


class Solid:
    """Elements of one material, holding the element work arrays between calls.

    Raises ValueError when the material is incompressible (infinite bulk modulus).
    """

    def __init__(self, elements: Elements, material: Material) -> None:
        if not np.isfinite(material.bulk):
            raise ValueError(
                f"material: expected a finite bulk modulus, MPa, found {material.bulk}"
            )
        self.elements = elements
        self.material = material
        self._kernel = material.kernel()
        self._system = weak_form.empty_system(elements)

    def zero_state(self) -> tuple[Array, Array]:
        """Undeformed displacement (n_node, 3) mm and pressure (n_elem, n_p) MPa."""
        e = self.elements
        return np.zeros(e.positions.shape), np.zeros((len(e.nodes), e.psi.shape[1]))

    def energy(self, u: Array) -> float:
        """Energy (N mm) at displacement u (n_node, 3) mm; inf where some det F <= 0."""
        return float(weak_form.element_energy(u, self.elements, self._kernel))

    def assemble(self, u: Array, p: Array) -> tuple[float, float, Array]:
        """(energy N mm, smallest det F, nodal forces (n_node, 3) N) at u, p (n_elem, n_p) MPa.

        The element tangents are left in `tangent`.
        """
        energy, smallest = weak_form.element_system(
            u, p, self.elements, self._kernel, True, self._system
        )
        forces = sum_to_nodes(self.elements.nodes, self._system.residual, len(u))
        return float(energy), float(smallest), forces

    @property
    def tangent(self) -> Array:
        """(n_elem, n_a, 3, 3, n_a) condensed tangents of the last `assemble`, N/mm."""
        return self._system.tangent

    def tangent_times(self, motion: Array) -> Array:
        """(n_node, 3) change of the nodal forces along a motion (n_node, 3) mm, N per motion."""
        e = self.elements
        moved = np.flatnonzero(np.any(motion[e.nodes] != 0.0, axis=(1, 2)))
        parts = np.einsum(
            "eaikb,ebk->eai", self._system.tangent[moved], motion[e.nodes[moved]], optimize=True
        )
        total = np.zeros(e.positions.shape)
        np.add.at(total, e.nodes[moved], parts)
        return total

    def pressure_step(self, du: Array) -> Array:
        """Pressure increment (n_elem, n_p) MPa that belongs to du (n_node, 3) mm.

        Uses coupling and constraint of the last `assemble`.
        """
        e = self.elements
        volume = np.einsum("emai,eai->em", self._system.coupling, du[e.nodes])
        change = volume + self._system.constraint
        dp: Array = self._kernel.bulk * np.einsum("emn,en->em", e.mass_inverse, change)
        dp += np.einsum("emn,en->em", self._system.volume_stiffness, volume)
        return dp

    def consistent_pressure(self, u: Array) -> Array:
        """Pressure (n_elem, n_p) MPa with no residual in the volume equation at u (n_node, 3)."""
        e = self.elements
        F = np.einsum("eai,eqja->eqij", u[e.nodes], e.gradients) + np.eye(3)
        b = np.einsum("eq,qm,eq->em", e.weights, e.psi, np.linalg.det(F) - 1.0)
        coefficients = np.einsum("emn,en->em", e.mass_inverse, b)
        theta = np.einsum("qm,em->eq", e.psi, coefficients)
        slopes = deviation_slopes(self._kernel.volumetric, theta)
        b += np.einsum("eq,qm,eq->em", e.weights, e.psi, slopes)
        p: Array = self._kernel.bulk * np.einsum("emn,en->em", e.mass_inverse, b)
        return p

    def force_slopes(self, u: Array, along: Directions) -> Array:
        """(n_node, 3, n_c + 1 + n_v) derivative of the nodal forces at fixed u (n_node, 3) mm, N.

        Along changes of the law, in the bulk modulus and along motions of the mesh.
        """
        total = np.zeros((*u.shape, along.laws.size + 1 + along.stretch.shape[2]))
        residual_slopes(u, self.elements, self._kernel, along, total)
        return total
