"""What the nodal forces of a solid are differentiated along: changes of law, bulk and mesh.

Nodes that move by V carry the velocity gradient L = dV/dX to the quadrature points.  On a grid of
planes along the axes only its diagonal is not zero, and of that each dimension changes one entry,
so the entries that are never there are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.materials.material import Material
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

ROUNDING = 1e-12
"""of the largest entry of L: what is below is none"""


class Directions(NamedTuple):
    """n_c changes of the law, the bulk modulus, n_v motions of the mesh with n_m entries of L."""

    laws: IntArray
    """(n_c,) codes of the laws dW/dh"""
    constants: Array
    """(n_c, n_constant) of those laws, of which the first `sizes` count"""
    sizes: IntArray
    """(n_c,)"""
    rows: IntArray
    """(n_m,) k of the entries L_kj = dV_k/dX_j"""
    columns: IntArray
    """(n_m,) j of them"""
    motions: IntArray
    """(n_k,) the motions that have an entry, each as often as it has"""
    entries: IntArray
    """(n_k,) which of the n_m entries it is"""
    rates: Array
    """(n_elem, n_q, n_k) those entries, 1/mm per unit of the motion"""
    stretch: Array
    """(n_elem, n_q, n_v) tr L"""
    masses: Array
    """(n_elem, n_v, n_p, n_p) derivative of int psi psi' dV, mm3 per unit"""


def directions(material: Material, elements: Elements, changes: Array, motion: Array) -> Directions:
    """Along `changes` (n_c, n_constant) of the constants and `motion` (n_v, n_node, 3) mm."""
    slopes = [material.slope(change) for change in changes]
    sizes = np.array([s.constants.size for s in slopes], dtype=np.int64)
    constants = np.zeros((len(slopes), max([1, *sizes.tolist()])))
    for row, slope in zip(constants, slopes, strict=True):
        row[: slope.constants.size] = slope.constants
    codes = np.array([s.law for s in slopes], dtype=np.int64)
    L = _velocity_gradients(elements, motion)
    largest = np.abs(L).max(axis=(0, 1), initial=0.0)
    there = largest > ROUNDING * largest.max(initial=0.0)
    rows, columns = _where(there.any(axis=0))
    motions, entries = _where(there[:, rows, columns])
    stretch = np.ascontiguousarray(np.einsum("eqvkk->eqv", L))
    masses = np.einsum(
        "eq,eqv,qm,qn->evmn", elements.weights, stretch, elements.psi, elements.psi, optimize=True
    )
    rates = np.ascontiguousarray(L[:, :, motions, rows[entries], columns[entries]])
    return Directions(
        codes,
        constants,
        sizes,
        rows,
        columns,
        motions,
        entries,
        rates,
        stretch,
        np.ascontiguousarray(masses),
    )


def _where(mask: npt.NDArray[np.bool_]) -> tuple[IntArray, IntArray]:
    """(n,) row and (n,) column of each true entry.

    NumPy gives columns of one array, for whose layout kernels would be compiled once more.
    """
    rows, columns = np.nonzero(mask)
    return np.ascontiguousarray(rows), np.ascontiguousarray(columns)


def _velocity_gradients(elements: Elements, motion: Array) -> Array:
    """(n_elem, n_q, n_v, 3, 3) L_kj = dV_k/dX_j at the quadrature points, 1/mm per unit."""
    n_elem, n_quad, _, n_a = elements.gradients.shape
    n_v = len(motion)
    if n_v == 0:
        return np.zeros((n_elem, n_quad, 0, 3, 3))
    nodal = motion[:, elements.nodes].transpose(1, 2, 0, 3).reshape(n_elem, n_a, 3 * n_v)
    found = elements.gradients.reshape(n_elem, 3 * n_quad, n_a) @ nodal
    return found.reshape(n_elem, n_quad, 3, n_v, 3).transpose(0, 1, 3, 4, 2)
