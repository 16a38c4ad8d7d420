"""Bounded maximisation of a smooth vectorised log density of a few coordinates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from fe.response import Array

LogProb = Callable[[Array], Array]

# Step of the differences in units of the posterior SD. Emulator means carry rounding of 1e-9
# (nearly singular covariances of smooth data), which shorter steps would magnify; the neglected
# term of fourth order is 1e-8 of the density's own variation over an SD.
DIFFERENCE_STEP = 1e-2


def gradient(log_prob: LogProb, x: Array, bounds: Array, sd: Array) -> Array:
    """(n,) gradient of log_prob at x with respect to x / sd, as `value_and_gradient`."""
    return value_and_gradient(log_prob, x, bounds, sd)[1]


def value_and_gradient(
    log_prob: LogProb, x: Array, bounds: Array, sd: Array
) -> tuple[float, Array]:
    """log_prob at x and its gradient (n,) with respect to x / sd, from one batch of evaluations.

    Five-point (fourth-order) central differences away from the bounds (n, 2); next to a bound
    the five points are shifted inwards, so that the density is never asked outside its box. Where
    it is zero at some of the points, the others give the slope, on one side if need be.
    """
    n, x = x.size, np.clip(x, bounds[:, 0], bounds[:, 1])
    step = np.minimum(DIFFERENCE_STEP * sd, (bounds[:, 1] - bounds[:, 0]) / 8.0)
    # Places of the five points in steps from x, moved inside the box.
    room_low = np.minimum(np.floor((x - bounds[:, 0]) / step), 2.0)
    room_high = np.minimum(np.floor((bounds[:, 1] - x) / step), 2.0)
    centre = np.where(room_low < 2, 2 - room_low, np.where(room_high < 2, room_high - 2, 0.0))
    places = centre[:, None] + np.arange(-2.0, 3.0)
    points = np.tile(x, (n, 5, 1))
    axis = np.arange(n)
    points[axis, :, axis] += places * step[:, None]
    points = np.clip(points, bounds[:, 0], bounds[:, 1])
    values = log_prob(points.reshape(-1, n)).reshape(n, 5)
    slopes = [_slope(place, value) for place, value in zip(places, values, strict=True)]
    # The room was counted in whole steps, so that x is one of each axis' five points.
    here = float(values[0, np.flatnonzero(places[0] == 0.0)[0]])
    return here, np.array(slopes) * (sd / step)


def _slope(places: Array, values: Array) -> float:
    """Derivative at 0 of the polynomial through the finite of five values; NaN of fewer than two.

    The density is zero, and no value finite, beyond a wall of a support that is no box.
    """
    finite = np.isfinite(values)
    if finite.sum() < 2:
        return float("nan")
    places, values = places[finite], values[finite]
    powers = np.vander(places, increasing=True)
    slope: float = np.linalg.solve(powers, values - values[0])[1]
    return float(slope)


def projected_gradient(log_prob: LogProb, x: Array, bounds: Array, sd: Array) -> Array:
    """(n,) gradient of -log_prob per posterior SD, without what an active bound holds."""
    slope = -gradient(log_prob, x, bounds, sd)
    near = 1e-6 * sd
    held = ((x <= bounds[:, 0] + near) & (slope > 0)) | ((x >= bounds[:, 1] - near) & (slope < 0))
    projected: Array = np.where(held, 0.0, slope)
    return projected


def minimise_in_box(
    log_prob: LogProb,
    start: Array,
    box: Array,
    sd: Array,
    domain: Array,
    level: float = 1e-7,
) -> tuple[Array, float]:
    """Maximum of log_prob in a box (n, 2) by L-BFGS-B in units of sd, and its value.

    `domain` (n, 2) contains the box and is where log_prob may be asked for the gradient. Ends where
    no slope exceeds `level` per SD. Never worse than the start. Where the density is zero a step
    is shortened by the line search.
    """
    floor = float(log_prob(start[None])[0])

    def place(z: Array) -> Array:
        inside: Array = np.clip(start + z * sd, box[:, 0], box[:, 1])
        return inside

    def objective(z: Array) -> tuple[float, Array]:
        value, slope = value_and_gradient(log_prob, place(z), domain, sd)
        depth = floor - value if np.isfinite(value) else 1e10
        return depth, np.where(np.isfinite(slope), -slope, 0.0)

    scaled = (box - start[:, None]) / sd[:, None]
    result = minimize(
        objective,
        np.zeros(start.size),
        jac=True,
        method="L-BFGS-B",
        bounds=[(float(low), float(high)) for low, high in scaled],
        options={"maxiter": 200, "ftol": 1e-14, "gtol": level},
    )
    x = place(result.x)
    value = float(log_prob(x[None])[0])
    return (x, value) if value > floor else (start.copy(), floor)
