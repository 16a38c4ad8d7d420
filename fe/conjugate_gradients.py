"""Conjugate gradients about the factor of a matrix nearby, ended by negative curvature.

What SciPy's lacks: it is told at the first direction along which the matrix curves down, so that
an indefinite tangent is factorised, and its modes counted, in place of being solved for.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel

Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]


def conjugate_gradients(
    multiply: Callable[[Array], Array],
    precondition: Callable[[Array], Array],
    b: Array,
    tolerance: float,
    most: int,
) -> Array | None:
    """Solution (n,) for b (n,) to a residual of `tolerance`, relative, in at most `most` products.

    None where the matrix is met to curve down, where that many products do not do, or b is not
    finite (Hestenes and Stiefel 1952; truncation as by Steihaug 1983, eq. 2.3).
    """
    x, residual = np.zeros(b.size), b.copy()
    enough = tolerance * float(np.linalg.norm(b))
    z = precondition(residual)
    along, rho = z, float(residual @ z)
    for _ in range(most):
        image = multiply(along)
        curvature = float(along @ image)
        if not (curvature > 0.0 and 0.0 < rho < np.inf):  # so is NaN
            return None
        x = x + (rho / curvature) * along
        residual = residual - (rho / curvature) * image
        if np.linalg.norm(residual) <= enough:
            return x
        z = precondition(residual)
        before, rho = rho, float(residual @ z)
        along = z + (rho / before) * along
    return None


@kernel()
def symmetric_product(indptr: Int32Array, indices: Int32Array, upper: Array, x: Array) -> Array:
    """(n,) product with x (n,) of the symmetric matrix whose upper triangle is given in CSR.

    Rows begin on the diagonal.
    """
    y = np.zeros_like(x)
    for i in range(x.size):
        first = indptr[i]
        here = x[i]
        total = upper[first] * here
        for k in range(first + 1, indptr[i + 1]):
            j = indices[k]
            total += upper[k] * x[j]
            y[j] += upper[k] * here
        y[i] += total
    return y
