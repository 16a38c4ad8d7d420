"""The front face of an FE run without the sawtooth of its elements.

Under large strains the slopes of quadratic elements alternate from one half of an element to the
next, by a tenth at 1.4 mm of travel and over lengths of 0.1 mm, and jump at its edges: marks of a
mesh, which no block has. Cubic splines with a knot at each corner of an element, fitted to all
nodes by least squares, leave what an element can tell.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline

from calib.virtual.front_response import FrontResponse
from fe.response import Array

DEGREE = 3
FINEST = 0.1
"""mm, largest element that is to carry a spline: its own kinks are then nothing"""
MIRROR = np.array([-1.0, 1.0, 1.0])
"""signs of a displacement (x, y, z) on the other side of the plane x = 0"""


def smoothed(response: FrontResponse) -> FrontResponse:
    """The response with the splines' displacements, on elements of at most `FINEST`.

    Over x of a quarter model the mirror image is fitted too, so that the plane of symmetry stays
    one. Force and travels are as they were.
    """
    x, values = response.x, response.displacement
    if response.is_quarter:
        x = np.concatenate([-x[:0:-1], x])
        values = np.concatenate([values[:, :0:-1] * MIRROR, values], axis=1)
    finer_x, finer_y = _finer(response.x), _finer(response.y)
    along_x, along_y = _spline(x, finer_x), _spline(response.y, finer_y)
    fitted = np.einsum("ai,tijc,bj->tabc", along_x, values, along_y, optimize=True)
    if response.is_quarter:
        fitted[:, 0, :, 0] = 0.0  # not rounding: shape functions mirror it
    return replace(response, x=finer_x, y=finer_y, displacement=fitted)


def _finer(lines: Array) -> Array:
    """Lines of nodes (2 n + 1,) of equal elements of at most `FINEST` between corners, mm."""
    corners = lines[::2]
    parts = [
        np.linspace(a, b, 2 * max(int(np.ceil((b - a) / FINEST - 1e-9)), 1) + 1)[:-1]
        for a, b in pairwise(corners)
    ]
    return np.append(np.concatenate(parts), lines[-1])


def _spline(lines: Array, at: Array) -> Array:
    """(n, n_line) takes values at the lines of nodes to the least squares spline's at (n,), mm."""
    corners = lines[::2]
    first, last = np.repeat(corners[0], DEGREE + 1), np.repeat(corners[-1], DEGREE + 1)
    knots = np.concatenate([first, corners[1:-1], last])
    fitted = make_lsq_spline(lines, np.eye(lines.size), knots, DEGREE).c
    operator: Array = BSpline.design_matrix(at, knots, DEGREE).toarray() @ fitted
    return operator
