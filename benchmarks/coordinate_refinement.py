"""Grid convergence index from refining one coordinate at a time (Roache).

P. J. Roache, J. Fluids Eng. 116 (1994) 405-413; Verification and Validation in Computational
Science and Engineering (1998), chapter 5: where the error is a sum of terms of one coordinate
each, C_x h_x^p + C_y h_y^q + ..., each term is found by refining that coordinate alone, and the
error is their sum.  A mesh of n, and with all else alike one of fewer and one of more elements in
that coordinate, give differences c and f and the order p that solves

    c / f = (r_c^p - 1) / (1 - r_f^-p),        r_c, r_f the ratios of the numbers of elements;

the mesh of n is off by f r_f^p / (r_f^p - 1).  This times 1.25 is the coordinate's share, and the
sum of the shares, whatever their signs, the index.  p is kept between 1 and 2, and is 1 where c
and f point away from each other.  Twice as many elements in one coordinate cost twice as much, in
all coordinates eight times: ratios of 2 can be had, which lift the error above the scatter.

Scatter of single meshes can make p too high or f too small, so a second measure takes p = 1
throughout (what both hold of made-up data, the tests tell).  The root of the sum of squares in
place of the sum would hold some 70 % of them: terms of one sign add up.

Of a field, c and f are RMS over its values, and the index bounds an RMS by the triangle inequality.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SAFETY = 1.25
"""of a study on three meshes"""
ORDERS = np.linspace(1.0, 2.0, 1001)
"""among which the order is found"""


class Share(NamedTuple):
    """What one coordinate may put a mesh off by, each (n_step,); NaN without both neighbours."""

    index: Array
    """bound with the observed order, in the unit of the values"""
    first_order: Array
    """bound with order 1"""
    order: Array
    """between 1 and 2; 1 also where the coarser or the finer mesh is missing"""


def share(values: Array, numbers: tuple[int, int, int]) -> Share:
    """Share of a coordinate in the error of the middle one of three meshes.

    `values` are (3, n_step, n_value) of the coarser mesh, the mesh itself and the finer one, and
    `numbers` their numbers of elements in the coordinate.  A mesh that was not solved to a step has
    NaN there: without the finer one the mesh is off by c / (r_c - 1), without the coarser one by
    f r_f / (r_f - 1), both with order 1.  Raises ValueError unless the numbers grow.
    """
    coarse, own, fine = numbers
    if not 0 < coarse < own < fine:
        raise ValueError(f"numbers: expected three that grow, found {numbers}")
    to_coarse, to_fine = own / coarse, fine / own
    c, f = values[0] - values[1], values[1] - values[2]
    size_c, size_f = _rms(c), _rms(f)
    one = np.where(np.isnan(size_f), size_c / (to_coarse - 1.0), size_f * to_fine / (to_fine - 1.0))
    order = _order(size_c, size_f, to_coarse, to_fine)
    order = np.where(np.mean(c * f, axis=-1) > 0.0, order, 1.0)
    known = size_f * to_fine**order / (to_fine**order - 1.0)
    return Share(SAFETY * np.where(np.isnan(known), one, known), SAFETY * one, order)


def _order(coarse: Array, fine: Array, to_coarse: float, to_fine: float) -> Array:
    """Order, kept between 1 and 2, of differences (n_step,) from the coarser and the finer mesh."""
    ratios = (to_coarse**ORDERS - 1.0) / (1.0 - to_fine**-ORDERS)
    found = np.divide(coarse, fine, out=np.full_like(fine, np.inf), where=fine != 0.0)
    return np.asarray(np.interp(found, ratios, ORDERS))


def _rms(values: Array) -> Array:
    """(n_step,) of (n_step, n_value)."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=-1)))
