"""The strain energy of a meshed solid: nodal forces, condensed tangents, derivatives in constants.

All over *all* nodal unknowns: which of them are free is the business of who moves the solid.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe import weak_form
from fe.materials.material import KernelMaterial, Material
from fe.materials.volumetric import deviation_slopes
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
        return float(energy), float(smallest), self._sum(self._system.residual)

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
        theta = np.einsum("qm,emn,en->eq", e.psi, e.mass_inverse, b)
        slopes = deviation_slopes(self._kernel.volumetric, theta)
        b += np.einsum("eq,qm,eq->em", e.weights, e.psi, slopes)
        p: Array = self._kernel.bulk * np.einsum("emn,en->em", e.mass_inverse, b)
        return p

    def force_slopes(self, u: Array, directions: Array) -> Array:
        """(n_node, 3, n_direction) derivative of the nodal forces at u in the material.

        `directions` (n_direction, n_constant + 1) are changes of the constants and, last, of the
        bulk modulus, MPa; u (n_node, 3) mm is held.
        """
        elements = self.elements
        no_volume = elements._replace(mass_inverse=np.zeros_like(elements.mass_inverse))
        by_bulk = None
        columns = []
        for direction in directions:
            column = np.zeros(elements.positions.shape)
            if direction[:-1].any():
                column += self._forces(u, no_volume, self.material.slope(direction[:-1]))
            if direction[-1] != 0.0:
                if by_bulk is None:
                    by_bulk = self._forces(u, elements, self.material.bulk_slope())
                column += direction[-1] * by_bulk
            columns.append(column)
        return np.stack(columns, axis=2)

    def _forces(self, u: Array, elements: Elements, material: KernelMaterial) -> Array:
        """(n_node, 3) nodal forces of another material, N."""
        system = weak_form.empty_system(elements)
        no_pressure = np.zeros((elements.nodes.shape[0], elements.psi.shape[1]))
        weak_form.element_system(u, no_pressure, elements, material, False, system)
        return self._sum(system.residual)

    def _sum(self, values: Array) -> Array:
        """(n_node, 3) sum of element vectors (n_elem, n_a, 3) over the elements at a node."""
        index = 3 * self.elements.nodes[..., None] + np.arange(3)
        size = self.elements.positions.size
        total = np.bincount(index.ravel(), weights=values.ravel(), minlength=size)
        return total.astype(np.float64, copy=False).reshape(-1, 3)
