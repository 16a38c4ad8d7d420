"""Tables of one mesh: shape functions from scikit-fem, sparse pattern, and where entries go."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from skfem import Basis, ElementHex2, FacetBasis, MeshHex

from fe.compiled import kernel
from fe.contact import Faces
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Int32Array = npt.NDArray[np.int32]
BoolArray = npt.NDArray[np.bool_]

VOLUME_ORDER = 5
"""exact for the Q2 mass matrix on a box: 3 Gauss points a direction"""
FACE_ORDER = 19
"""10 Gauss points a direction: each that lands leaves a kink in the response along its parameters,
which more points make smaller; with 3 contact is nearly nodal and chatters"""


@dataclass(frozen=True)
class Pattern:
    """Upper-triangular CSR pattern of the free unknowns and the slots of element entries."""

    equation: IntArray
    """(3 n_node,) equation of each unknown, -1 where prescribed"""
    number: IntArray
    """the same, but -1 for all but the first of unknowns that share an equation"""
    indptr: Int32Array
    indices: Int32Array
    element_slots: Int32Array
    """(n_elem, 27, 3, 3, 27) slot of entry [a, i, k, b], -1 where dropped"""
    face_slots: Int32Array
    """(n_face, 9, 3, 3, 9)"""

    @property
    def n_free(self) -> int:
        """Number of equations."""
        return self.indptr.size - 1

    def restrict(self, full: Array) -> Array:
        """(n_free,) or (n_free, k) sums over the equations of nodal (n_node, 3[, k]) values."""
        free = self.equation >= 0
        flat = full.reshape(free.size, *full.shape[2:])[free]
        if self.equation is self.number:  # none is shared
            return flat
        total = np.zeros((self.n_free, *full.shape[2:]))
        np.add.at(total, self.equation[free], flat)
        return total

    def expand(self, values: Array) -> Array:
        """(n_node, 3[, k]) from free values (n_free[, k]), zero where prescribed.

        `restrict` transposed.
        """
        free = self.equation >= 0
        full = np.zeros((free.size, *values.shape[1:]))
        full[free] = values if self.equation is self.number else values[self.equation[free]]
        return full.reshape(-1, 3, *values.shape[1:])


def elements(mesh: MeshHex) -> tuple[Elements, Basis]:
    """Q2/P1 tables of a hexahedral mesh, and the scikit-fem basis they come from."""
    basis = Basis(mesh, ElementHex2(), intorder=VOLUME_ORDER)
    gradients = np.stack([np.asarray(phi[0].grad) for phi in basis.basis])
    reference = basis.quadrature[0] - 0.5
    psi = np.vstack([np.ones(reference.shape[1]), reference]).T.copy()
    weights = np.ascontiguousarray(basis.dx)
    mass = np.einsum("eq,qm,qn->emn", weights, psi, psi)
    return (
        Elements(
            nodes=np.ascontiguousarray(basis.element_dofs.T, dtype=np.int64),
            positions=np.ascontiguousarray(basis.doflocs.T),
            gradients=np.ascontiguousarray(gradients.transpose(2, 3, 1, 0)),
            weights=weights,
            psi=psi,
            mass_inverse=np.linalg.inv(mass),
        ),
        basis,
    )


def first_order_elements(basis: Basis) -> Elements:
    """Q1/P0 tables of a scikit-fem basis: trilinear displacement with a constant pressure."""
    weights = np.ascontiguousarray(basis.dx)
    gradients = np.stack([np.broadcast_to(phi[0].grad, (3, *weights.shape)) for phi in basis.basis])
    return Elements(
        nodes=np.ascontiguousarray(basis.element_dofs.T, dtype=np.int64),
        positions=np.ascontiguousarray(basis.doflocs.T),
        gradients=np.ascontiguousarray(gradients.transpose(2, 3, 1, 0)),
        weights=weights,
        psi=np.ones((weights.shape[1], 1)),
        mass_inverse=1.0 / weights.sum(axis=1)[:, None, None],
    )


def faces(mesh: MeshHex, facets: IntArray, floor: BoolArray, base: BoolArray) -> Faces:
    """Quadrature of the given facets (n_face,).

    `floor` marks those that may touch the floor, `base` those that stand on it.
    """
    basis = FacetBasis(mesh, ElementHex2(), facets=facets, intorder=FACE_ORDER)
    values = np.stack([np.asarray(phi[0]) for phi in basis.basis])
    on_face = np.abs(values).max(axis=2) > 1e-12
    local = np.stack([np.flatnonzero(column) for column in on_face.T])
    dofs = basis.element_dofs
    rows = np.arange(len(facets))[:, None]
    return Faces(
        nodes=np.ascontiguousarray(dofs[local, rows], dtype=np.int64),
        shape=np.ascontiguousarray(values[local, rows].transpose(0, 2, 1)),
        weights=np.ascontiguousarray(basis.dx),
        points=np.ascontiguousarray(np.asarray(basis.global_coordinates()).transpose(1, 2, 0)),
        floor=floor,
        base=base,
    )


def pattern(element_nodes: IntArray, face_nodes: IntArray, fixed: BoolArray) -> Pattern:
    """Sparsity of the tangent over the unknowns that are not `fixed` (3 n_node,)."""
    n_node = fixed.size // 3
    number = np.full(fixed.size, -1, dtype=np.int64)
    number[~fixed] = np.arange(int((~fixed).sum()))
    n_elem, n_a = element_nodes.shape
    incidence = sp.csr_matrix(
        (np.ones(element_nodes.size), (np.repeat(np.arange(n_elem), n_a), element_nodes.ravel())),
        (n_elem, n_node),
    )
    neighbours = (incidence.T @ incidence).tocsr()
    neighbours.data[:] = 1.0
    free = np.flatnonzero(~fixed)
    full = sp.kron(neighbours, np.ones((3, 3)), format="csr")[free][:, free]
    upper = sp.triu(full, format="csr")
    upper.sort_indices()
    indptr = upper.indptr.astype(np.int32)
    indices = upper.indices.astype(np.int32)
    return Pattern(
        equation=number,
        number=number,
        indptr=indptr,
        indices=indices,
        element_slots=entry_slots(element_nodes, number, indptr, indices),
        face_slots=entry_slots(face_nodes, number, indptr, indices),
    )


@kernel()
def entry_slots(
    nodes: IntArray,
    number: IntArray,
    indptr: Int32Array,
    indices: Int32Array,
    upper: bool = True,
) -> Int32Array:
    """(n, a, 3, 3, a) slots in the CSR data of the entries of parts (n, a).

    `number` (3 n_node,) is the equation of each unknown, -1 where prescribed; entries below the
    diagonal of an `upper` triangle have none.
    """
    n_elem, n_a = nodes.shape
    slots = np.full((n_elem, n_a, 3, 3, n_a), -1, dtype=np.int32)
    for e in range(n_elem):
        for a in range(n_a):
            for i in range(3):
                row = number[3 * nodes[e, a] + i]
                if row < 0:
                    continue
                for b in range(n_a):
                    for k in range(3):
                        column = number[3 * nodes[e, b] + k]
                        if column < 0 or (upper and column < row):
                            continue
                        low = indptr[row]
                        high = indptr[row + 1]
                        while low < high:
                            middle = (low + high) // 2
                            if indices[middle] < column:
                                low = middle + 1
                            else:
                                high = middle
                        slots[e, a, i, k, b] = low
    return slots


@kernel()
def add_entries(tangent: Array, slots: Int32Array, data: Array) -> None:
    """Add element entries (n, a, 3, 3, a) into the CSR data at their slots."""
    n_elem, n_a = tangent.shape[0], tangent.shape[1]
    for e in range(n_elem):
        for a in range(n_a):
            for i in range(3):
                for k in range(3):
                    for b in range(n_a):
                        slot = slots[e, a, i, k, b]
                        if slot >= 0:
                            data[slot] += tangent[e, a, i, k, b]


def sum_to_nodes(nodes: IntArray, values: Array, n_node: int) -> Array:
    """(n_node, 3) sum of nodal vectors (n, a, 3) over the parts that share a node."""
    index = 3 * nodes[..., None] + np.arange(3)
    total = np.bincount(index.ravel(), weights=values.ravel(), minlength=3 * n_node)
    return total.astype(np.float64, copy=False).reshape(-1, 3)
