"""Uncertainty of a discretisation from four or more meshes, by least squares (Eca and Hoekstra).

L. Eca, M. Hoekstra, J. Comput. Phys. 262 (2014) 104-130: the error of a mesh of size h is taken as
alpha h^p, fitted to all meshes with weights 1 and 1/h; where the order p that fits best is above
2, as alpha h or alpha h^2, and where it is below 0.5, also as alpha_1 h + alpha_2 h^2; the fit of
the smallest standard deviation counts.  With this deviation sigma, the error eps that the fit gives
to a mesh, the mesh's distance d from the fit and the range of the data over the number of meshes
less one, Delta,

    U = F eps + sigma + d               where sigma < Delta, F = 1.25 for 0.5 <= p < 2.1, else 3;
    U = 3 sigma / Delta (eps + sigma + d)                                where the meshes scatter.

U is meant to hold the error in 95 of 100 cases (what it holds of made-up data, the tests tell).
The size of a mesh is h = (volume / elements)^(1/3), which assumes that all meshes divide the body
alike, or that what differs, such as the share of elements along a bar, adds no more than scatter.

The published procedure leaves the order free.  Meshes that differ by scatter more than by size,
within a small range of sizes, then get any order, and a limit far away: U up to a hundred times
what the meshes differ by.  `interval` takes the orders 1 and 2, as an index of three meshes does,
and scatter as independent of the mesh: the distance from the limit of the line over h^p through all
meshes, and Student's 95 % of the limit, the larger of both orders.

Of a field, either each value has its own fit, or all share order, family and weight: then every
value keeps its own alpha and limit, with their signs, and sigma, eps, d and Delta are RMS over the
values, so that U bounds an RMS.  Thousands of values tell an order far better than one, and where a
single value hardly changes its own bound is all scatter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student_t

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SAFETY, CAUTIOUS_SAFETY = 1.25, 3.0
LEAST_ORDER, FORMAL_ORDER, HIGHEST_ORDER = 0.5, 2.0, 2.1
"""below the first no order is believed, above the second one of 1 and 2 is fitted, from the third
on the factor of safety is the cautious one"""
ORDERS = np.linspace(0.02, 8.0, 134)
"""among which the order that fits best is sought; refined between them"""
FEWEST = 4
"""meshes: three unknowns and one for their scatter"""


class Uncertainty(NamedTuple):
    """Of one mesh; each (n,), where n is 1 if values were taken together."""

    u: Array
    """bound of the error, in the unit of the values"""
    error: Array
    """that the fit gives to this mesh"""
    sigma: Array
    """standard deviation of the fit"""
    order: Array
    """that fits best if left free; 8 means as high, 0.02 as low as it may be"""
    scatters: npt.NDArray[np.bool_]
    """whether sigma is no smaller than Delta"""


class _Fit(NamedTuple):
    """One family of curves, fitted with one kind of weights."""

    error: Array
    """(n_mesh, n_value) curve less its limit at h = 0"""
    off: Array
    """(n_mesh, n_value) values less the curve"""
    sigma: Array
    """(n,)"""
    order: Array
    """(n,)"""


def uncertainty(values: Array, h: Array, mesh: int, *, together: bool = False) -> Uncertainty:
    """Uncertainty of values (n_mesh, n_value) at sizes h (n_mesh,) for one of the meshes.

    `together` takes the values as one quantity, measured by its RMS.  Raises ValueError for fewer
    than four meshes, and for sizes that are not positive.
    """
    _check(values, h)
    size = h / h.min()
    weights = np.array([np.ones(len(h)), (1.0 / size) * len(h) / (1.0 / size).sum()])
    free = _best([_free_order(values, size, w, together) for w in weights])
    one, two, both = (
        _best([_fixed_orders(values, size, w, orders, together) for w in weights])
        for orders in ((1.0,), (2.0,), (1.0, 2.0))
    )
    high, low = free.order > FORMAL_ORDER, free.order < LEAST_ORDER
    fit = _where(high, _best([one, two]), free)
    fit = _where(low, _best([one, two, both]), fit)
    spread = _size(np.ptp(values, axis=0), together) / (len(h) - 1)
    error, off = (_size(np.abs(of[mesh]), together) for of in (fit.error, fit.off))
    scatters = fit.sigma >= spread
    believed = (free.order >= LEAST_ORDER) & (free.order < HIGHEST_ORDER)
    factor = np.where(believed, SAFETY, CAUTIOUS_SAFETY)
    noise = np.divide(fit.sigma, spread, out=np.zeros_like(spread), where=spread > 0.0)
    u = np.where(
        scatters,
        CAUTIOUS_SAFETY * noise * (error + fit.sigma + off),
        factor * error + fit.sigma + off,
    )
    return Uncertainty(u, error, fit.sigma, free.order, scatters & (spread > 0.0))


def interval(values: Array, h: Array, mesh: int, *, together: bool = False) -> Array:
    """(n,) bound of the error of one of the meshes for errors of order 1 to 2 and scatter.

    Of values (n_mesh, n_value) at sizes h (n_mesh,), in their unit; `together` as in `uncertainty`.
    Raises ValueError for fewer than four meshes, and for sizes that are not positive.
    """
    _check(values, h)
    found = []
    for order in (1.0, FORMAL_ORDER):
        size = (h / h.min()) ** order
        fit = _fixed_orders(values, size, np.ones(len(h)), (1.0,), together)
        of_limit = np.sqrt(1.0 / len(h) + size.mean() ** 2 / ((size - size.mean()) ** 2).sum())
        wide = float(student_t.ppf(0.975, len(h) - 2)) * fit.sigma * of_limit
        found.append(_size(np.abs(fit.error[mesh] + fit.off[mesh]), together) + wide)
    return np.maximum(*found)


def _check(values: Array, h: Array) -> None:
    if len(h) < FEWEST or values.shape[0] != len(h):
        raise ValueError(f"values: expected {FEWEST} meshes or more, found {values.shape[0]}")
    if not (h > 0.0).all():
        raise ValueError(f"h: expected positive sizes of meshes, found {h.min():g}")


def mesh_size(measure: float, elements: int, dimensions: int = 3) -> float:
    """Representative size, mm, of a mesh of so many mm3, or mm2 in two dimensions."""
    return float((measure / elements) ** (1.0 / dimensions))


def _size(x: Array, together: bool) -> Array:
    """(n,) of x (..., n_value): itself, or its RMS over the values."""
    return np.sqrt(np.mean(x**2, axis=-1, keepdims=True)) if together else x


def _squares(x: Array, together: bool) -> Array:
    """Of x (..., n_value) itself or the mean over the values (..., 1)."""
    return x.mean(axis=-1, keepdims=True) if together else x


def _best(fits: list[_Fit]) -> _Fit:
    """Of every quantity the fit of the smallest deviation, the first of equals."""
    found = fits[0]
    for fit in fits[1:]:
        found = _where(fit.sigma < found.sigma, fit, found)
    return found


def _where(chosen: npt.NDArray[np.bool_], one: _Fit, other: _Fit) -> _Fit:
    return _Fit(*(np.where(chosen, a, b) for a, b in zip(one, other, strict=True)))


def _fixed_orders(
    values: Array, h: Array, weight: Array, orders: tuple[float, ...], together: bool
) -> _Fit:
    """Weighted least squares of limit + sum of alpha_p h^p."""
    powers = np.stack([h**p for p in orders], axis=1)
    basis = np.column_stack([np.ones(len(h)), powers])
    root = np.sqrt(weight)[:, None]
    coefficients = np.linalg.lstsq(root * basis, root * values, rcond=None)[0]
    off = values - basis @ coefficients
    squares = _squares((weight[:, None] * off**2).sum(axis=0), together)
    sigma = np.sqrt(squares / (len(h) - basis.shape[1]))
    return _Fit(powers @ coefficients[1:], off, sigma, np.full(sigma.shape, max(orders)))


def _free_order(values: Array, h: Array, weight: Array, together: bool) -> _Fit:
    """Weighted least squares of limit + alpha h^p, p among ORDERS and then between them."""
    step = ORDERS[1] - ORDERS[0]
    left = _left(values, h, weight, ORDERS[:, None], together)
    order = ORDERS[left.argmin(axis=0)]
    for _ in range(4):
        near = np.clip(order + step * np.linspace(-1.0, 1.0, 21)[:, None], ORDERS[0], ORDERS[-1])
        left = _left(values, h, weight, near, together)
        order = np.take_along_axis(near, left.argmin(axis=0)[None], axis=0)[0]
        step /= 10.0
    mean, slope, centred = _line(values, h, weight, order[None])
    power = h[:, None] ** order
    error = slope[0] * power
    off = values - mean - slope[0] * centred[0]
    squares = _squares((weight[:, None] * off**2).sum(axis=0), together)
    return _Fit(error, off, np.sqrt(squares / (len(h) - 3)), order)


def _left(values: Array, h: Array, weight: Array, orders: Array, together: bool) -> Array:
    """(n_order, n) squares that the best lines over h^order leave; orders (n_order, 1 or n)."""
    mean, slope, centred = _line(values, h, weight, orders)
    off = values - mean - slope[:, None] * centred
    return _squares((weight[:, None] * off**2).sum(axis=1), together)


def _line(values: Array, h: Array, weight: Array, orders: Array) -> tuple[Array, Array, Array]:
    """Weighted mean, slopes (n_order, n_value) over h^order, which is returned centred.

    The last is (n_order, n_mesh, 1 or n_value).
    """
    w = (weight / weight.sum())[:, None]
    power = h[:, None] ** orders[:, None, :]
    centred = power - (w * power).sum(axis=1, keepdims=True)
    mean = (w * values).sum(axis=0)
    slope = (w * centred * (values - mean)).sum(axis=1) / (w * centred**2).sum(axis=1)
    return mean, slope, centred
