"""The whole tangent of what rubs: the symmetric one with friction's unsymmetric part."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from fe.discretisation import Pattern, add_entries, entry_slots
from fe.linear_solver import GeneralMatrix

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class CoupledTangent:
    """Puts the two parts together over the pattern of both triangles.

    `parts` are the nodes (n, a) of the faces or elements on which friction acts, one array for each
    kind.
    """

    def __init__(self, pattern: Pattern, *parts: IntArray) -> None:
        n = pattern.indptr.size - 1
        places = sp.csr_matrix(
            (np.arange(1.0, pattern.indices.size + 1), pattern.indices, pattern.indptr), (n, n)
        )
        full = (places + sp.triu(places, 1).T).tocsr()
        full.sort_indices()
        self._from = full.data.astype(np.int64) - 1
        self._indptr = full.indptr.astype(np.int32)
        self._indices = full.indices.astype(np.int32)
        self._slots = [
            entry_slots(nodes, pattern.equation, self._indptr, self._indices, upper=False)
            for nodes in parts
        ]

    def matrix(self, upper: Array, *couplings: Array) -> GeneralMatrix:
        """Sum of the symmetric tangent's `upper` entries (nnz,) and the couplings, N/mm.

        Those are (n, a, 3, 3, a) for each kind of parts, indexed [a, i, k, b].
        """
        data = upper[self._from]
        for coupling, slots in zip(couplings, self._slots, strict=True):
            add_entries(coupling, slots, data)
        return GeneralMatrix(self._indptr, self._indices, data)
