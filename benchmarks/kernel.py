"""Element stiffness by the product's kernel and by scikit-fem's own assembly of the same form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from skfem import Basis, BilinearForm, ElementHex2, ElementVector, LinearForm, MeshHex

from benchmarks.timing import median_seconds
from fe.discretisation import VOLUME_ORDER, add_entries, elements, pattern
from fe.materials.invariant import cofactor, isochoric_stress
from fe.weak_form import Elements, element_system, empty_system

Array = npt.NDArray[np.float64]

CONSTANTS = np.array([0.2, 0.1, 0.3])
BULK = 100.0


@dataclass(frozen=True)
class KernelTimes:
    """Seconds of one assembly of residual and tangent of the same Q2 mesh."""

    n_elements: int
    seconds: float
    skfem_seconds: float
    largest_difference: float
    """of the assembled tangents, relative to the largest entry"""


def compare(n: int, n_repeat: int) -> KernelTimes:
    """Assemble on n x n x n elements at a random deformation, isochoric part of the tangent.

    scikit-fem is given stress and tangent of the law at all points for free (computed before the
    clock starts), and assembles the displacement part only; the product's time includes the law,
    the pressure, its condensation and the sparse matrix.
    """
    mesh = MeshHex.init_tensor(*(np.linspace(0.0, 1.0, n + 1) for _ in range(3)))
    table, _ = elements(mesh)
    u = 0.02 / n * np.random.default_rng(0).standard_normal(table.positions.shape)
    own, seconds = median_seconds(_own_assembly(table, u), n_repeat)
    P, A = _law(table, u)
    theirs, skfem_seconds = median_seconds(_skfem_assembly(mesh, P, A), 1, warm=False)
    check = _own_isochoric(table, u)
    difference = abs(check - sp.triu(theirs)).max() / abs(theirs).max()
    assert own.nnz > 0
    return KernelTimes(len(table.nodes), seconds, skfem_seconds, float(difference))


def _own_assembly(table: Elements, u: Array, bulk: float = BULK):
    """A call that assembles residual and condensed upper-triangular tangent."""
    structure = pattern(table.nodes, np.zeros((0, 9), dtype=np.int64), np.zeros(u.size, dtype=bool))
    system = empty_system(table)
    p = np.zeros((len(table.nodes), table.psi.shape[1]))
    index = (3 * table.nodes[..., None] + np.arange(3)).ravel()

    def assemble() -> sp.csr_matrix:
        element_system(u, p, table, CONSTANTS, bulk, True, system)
        np.bincount(index, system.residual.ravel(), minlength=u.size)
        data = np.zeros(structure.indices.size)
        add_entries(system.tangent, structure.element_slots, data)
        return sp.csr_matrix((data, structure.indices, structure.indptr), (u.size, u.size))

    return assemble


def _own_isochoric(table: Elements, u: Array) -> sp.csr_matrix:
    """Tangent without the volumetric part: what scikit-fem is asked for."""
    no_volume = table._replace(mass_inverse=np.zeros_like(table.mass_inverse))
    tangent: sp.csr_matrix = _own_assembly(no_volume, u)()
    return tangent


def _law(table: Elements, u: Array) -> tuple[Array, Array]:
    """P (3, 3, n_elem, n_q) and dP/dF (3, 3, 3, 3, n_elem, n_q) of the isochoric law."""
    F = np.eye(3) + np.einsum("eai,eqja->eqij", u[table.nodes], table.gradients)
    P = np.empty((3, 3, *table.weights.shape))
    A = np.empty((3, 3, 3, 3, *table.weights.shape))
    cof, stress, tangent = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3, 3, 3))
    for e, q in np.ndindex(*table.weights.shape):
        J = cofactor(F[e, q], cof)
        isochoric_stress(F[e, q], cof, J, CONSTANTS, stress, tangent, True)
        P[..., e, q], A[..., e, q] = stress, tangent
    return P, A


def _skfem_assembly(mesh: MeshHex, P: Array, A: Array):
    """A call that assembles the same two forms the way scikit-fem's examples do (its ex36)."""
    basis = Basis(mesh, ElementVector(ElementHex2()), intorder=VOLUME_ORDER)

    @BilinearForm
    def stiffness(u, v, w):
        # the fastest of the ways tried; one einsum of all three is 2.5 times slower
        return np.einsum("ijen,ijen->en", np.einsum("ijklen,klen->ijen", A, u.grad), v.grad)

    @LinearForm
    def residual(v, w):
        return np.einsum("ijen,ijen->en", P, v.grad)

    def assemble() -> sp.csr_matrix:
        residual.assemble(basis)
        matrix: sp.csr_matrix = stiffness.assemble(basis)
        return matrix

    return assemble
