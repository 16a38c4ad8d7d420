"""A deformed face in space as a smooth function of material points, exact for render and truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from fe.compiled import kernel
from fe.response import Array

DEGREE = 3


@dataclass(frozen=True)
class Surface:
    """Cubic splines through places of a regular grid of material points.

    Raises ValueError for a grid of fewer than four points along an axis or a wrong shape.
    """

    low: tuple[float, float]
    """mm, first material x and y"""
    high: tuple[float, float]
    """mm, last ones"""
    places: Array
    """(n_x, n_y, 3) in space, mm"""
    coefficients: Array
    """(n_x, n_y, 3) of the splines, whose knots are uniform but for the ends"""
    knots_x: Array
    knots_y: Array

    @property
    def step(self) -> tuple[float, float]:
        """Distance of grid points along x and y, mm."""
        n_x, n_y, _ = self.places.shape
        return (self.high[0] - self.low[0]) / (n_x - 1), (self.high[1] - self.low[1]) / (n_y - 1)

    def at(self, material: Array) -> Array:
        """(n, 3) places of material points (n, 2), mm; NaN off the face."""
        found = np.empty((len(material), 3))
        _many(self.knots_x, self.knots_y, self.coefficients, material, found)
        return found


def make_surface(low: tuple[float, float], high: tuple[float, float], places: Array) -> Surface:
    """The surface through `places` (n_x, n_y, 3) of a regular grid of material points, mm."""
    if places.ndim != 3 or places.shape[2] != 3 or min(places.shape[:2]) < 4:
        raise ValueError(f"places: expected (n_x, n_y, 3), 4 or more each, found {places.shape}")
    x = np.linspace(low[0], high[0], places.shape[0])
    y = np.linspace(low[1], high[1], places.shape[1])
    along_x = make_interp_spline(x, places, k=DEGREE, axis=0)
    along_y = make_interp_spline(y, along_x.c, k=DEGREE, axis=1)
    # the second call moved its axis to the front
    coefficients = np.ascontiguousarray(np.moveaxis(along_y.c, 0, 1), dtype=np.float64)
    if coefficients.shape != places.shape:
        coefficients = np.ascontiguousarray(np.moveaxis(coefficients, 0, 1))
    return Surface(
        low, high, places, coefficients,
        np.asarray(along_x.t, dtype=np.float64), np.asarray(along_y.t, dtype=np.float64),
    )  # fmt: skip


@kernel()
def basis(knots: Array, at: float, n: int, values: Array, slopes: Array) -> int:
    """The four cubic B-splines at a point and their slopes; returns the number of the first.

    de Boor's recurrence; the slope is the difference of splines of degree 2.
    """
    first = 3
    last = n - 1
    while last - first > 0:
        middle = (first + last + 1) // 2
        if knots[middle] <= at:
            first = middle
        else:
            last = middle - 1
    m = first
    lower = np.zeros(4)
    values[:] = 0.0
    values[0] = 1.0
    for degree in range(1, 4):
        if degree == 3:
            lower[:] = values
        saved = 0.0
        for r in range(degree):
            right = knots[m + r + 1] - at
            left = at - knots[m + 1 - degree + r]
            share = values[r] / (right + left)
            values[r] = saved + right * share
            saved = left * share
        values[degree] = saved
    for r in range(4):
        slope = 0.0
        if r > 0:
            slope += lower[r - 1] / (knots[m + r] - knots[m + r - 3])
        if r < 3:
            slope -= lower[r] / (knots[m + r + 1] - knots[m + r - 2])
        slopes[r] = 3.0 * slope
    return m - 3


@kernel()
def place_at(
    knots_x: Array, knots_y: Array, coefficients: Array, x: float, y: float, out: Array
) -> None:
    """Place and slopes of the surface at one material point: out (3, 3) = place, by x, by y."""
    bx, dx, by, dy = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    i = basis(knots_x, x, coefficients.shape[0], bx, dx)
    j = basis(knots_y, y, coefficients.shape[1], by, dy)
    out[:] = 0.0
    for a in range(4):
        for b in range(4):
            for c in range(3):
                value = coefficients[i + a, j + b, c]
                out[0, c] += bx[a] * by[b] * value
                out[1, c] += dx[a] * by[b] * value
                out[2, c] += bx[a] * dy[b] * value


@kernel()
def _many(
    knots_x: Array, knots_y: Array, coefficients: Array, material: Array, found: Array
) -> None:
    work = np.empty((3, 3))
    for k in range(len(material)):
        x, y = material[k, 0], material[k, 1]
        if knots_x[0] <= x <= knots_x[-1] and knots_y[0] <= y <= knots_y[-1]:
            place_at(knots_x, knots_y, coefficients, x, y, work)
            found[k] = work[0]
        else:
            found[k] = np.nan
