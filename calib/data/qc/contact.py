"""Where the pin touches, and the load cell's zero: slack and drift of a test machine."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar, nnls

from calib.data.qc.relaxation import inflation
from calib.data.readers import MachineRecord
from calib.data.readers.frames import BoolArray
from fe.response import Array

FIT_DEPTH = 0.6
"""mm beyond contact over which the force is a polynomial of the travel"""
CLEAR = 0.03
"""mm before contact at which the pin is surely free"""
MOST_ROUNDS = 100
"""of choosing which of three coefficients are positive; a few are enough"""
FEW = 8
"""readings by which their noise is not told"""
MOST_POINTS = 1000
"""of a fit; ramps may hold many more readings"""
SMALLEST_SD = 0.01
"""mm: no formula is quite how the force begins; all samples have this error in common"""


@dataclass(frozen=True)
class Contact:
    """Where the force begins to rise."""

    travel: float
    """mm, position of the machine at contact: the slack"""
    travel_sd: float
    """mm, by the noise of the force"""
    noise_sd: float
    """N, of one reading about the fit"""
    by_force: float
    """mm, what the force alone says"""
    by_force_sd: float
    """mm, its SD by the noise of the force"""
    force_share: float = 1.0
    """weight of what the force says in `travel`"""

    def combined(self, by_hand: float, by_hand_sd: float) -> Contact:
        """Mean of what the force says and of the operator's zero, by their precision."""
        if by_hand_sd == 0:
            return replace(self, travel=by_hand, travel_sd=0.0, force_share=0.0)
        weight = self.by_force_sd**-2 / (self.by_force_sd**-2 + by_hand_sd**-2)
        travel = weight * self.by_force + (1 - weight) * by_hand
        sd = (self.by_force_sd**-2 + by_hand_sd**-2) ** -0.5
        return replace(self, travel=travel, travel_sd=sd, force_share=weight)


def in_compression(record: MachineRecord, force_sign: int) -> MachineRecord:
    """The record with compression positive; `force_sign` is that of files that do not say.

    Where the file is silent, the travel is turned so that it grows with the force.
    Raises ValueError without a travel.
    """
    if record.travel is None:
        raise ValueError("expected the travel with the force, found a force alone")
    if record.positive != "unknown":
        return record.in_compression()
    force = force_sign * record.force
    together = np.sum((record.travel - record.travel.mean()) * (force - force.mean()))
    travel = record.travel if together >= 0 else -record.travel
    return replace(record, force=force, travel=travel, positive="compression")


def find_contact(travel: Array, force: Array) -> Contact:
    """Contact of the readings (n,) [mm, N] of ways down from free or just touching to deep.

    The force is f0 before contact and f0 + a h + b h^2 + c h^3 at the depth h beyond it, with a, b
    and c not negative: a pin that is pressed in meets ever more. The place of contact minimises
    the sum of squares, whose curvature gives its SD.
    Raises ValueError when there are too few readings.
    """
    if travel.size < 8:
        raise ValueError(f"travel: expected 8 or more readings of a ramp, found {travel.size}")
    if travel.size > MOST_POINTS:
        chosen = np.linspace(0, travel.size - 1, MOST_POINTS).astype(int)
        travel, force = travel[chosen], force[chosen]
    place = _best(travel, force, travel.min() - 0.3, travel.max() - 0.1)
    near = travel < place + FIT_DEPTH
    if np.count_nonzero(near) < 8:
        near = np.ones(travel.size, dtype=np.bool_)
    travel, force = travel[near], force[near]
    place = _best(travel, force, place - 0.2, place + 0.2)
    return _with_sd(travel, force, place)


def _misfit(place: float, travel: Array, force: Array) -> float:
    depth = np.maximum(travel - place, 0.0)
    columns = np.column_stack([depth, depth**2, depth**3])
    # f0 may have either sign: what it does not explain is what differs from the means
    columns -= columns.mean(axis=0)
    columns /= np.maximum(np.linalg.norm(columns, axis=0), np.finfo(np.float64).tiny)
    return float(nnls(columns, force - force.mean(), maxiter=MOST_ROUNDS)[1] ** 2)


def _best(travel: Array, force: Array, low: float, high: float) -> float:
    places = np.linspace(low, high, 41)
    misfits = [_misfit(place, travel, force) for place in places]
    best, step = places[int(np.argmin(misfits))], places[1] - places[0]
    found = minimize_scalar(
        _misfit, bounds=(best - step, best + step), args=(travel, force), method="bounded"
    )
    return float(found.x)


def _with_sd(travel: Array, force: Array, place: float) -> Contact:
    """The curvature is taken over a span that the noise of a few readings does not fill."""
    span = 0.02
    at = [_misfit(place + shift, travel, force) for shift in (-span, 0.0, span)]
    variance = at[1] / max(travel.size - 5, 1)
    curvature = (at[0] - 2 * at[1] + at[2]) / span**2
    sd = np.sqrt(2 * variance / curvature) if curvature > 0 else np.inf
    sd = max(float(sd), SMALLEST_SD)
    return Contact(place, sd, float(np.sqrt(variance)), place, sd)


def force_zero(time: Array, travel: Array, force: Array, contact: float) -> tuple[Array, Array]:
    """(n,) reading of the load cell without load, N, and its SD by the noise of the readings.

    Means where the pin is free, linear between.
    A load cell drifts; each time the pin rests free of the sample its zero is measured again. Only
    the later half of such a time counts, as a sample may stick to a pin that leaves it, and short
    times between cycles do not. Without any such time the zero is that of the first reading.
    """
    is_free: BoolArray = travel < contact - CLEAR
    if not is_free.any():
        return np.full(force.shape, force[0]), np.full(force.shape, _reading_sd(force))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_free, [False]]).astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    longest = (ends - starts).max()
    times, zeros, variances = [], [], []
    for start, end in zip(starts, ends, strict=True):
        if end - start >= longest / 2:
            late = slice((start + end) // 2, end)
            times.append(time[late].mean())
            zeros.append(force[late].mean())
            variances.append(_variance_of_mean(time[late], force[late], _reading_sd(force)))
    zero: Array = np.interp(time, np.array(times), np.array(zeros))
    shares = np.stack([np.interp(time, times, row) for row in np.eye(len(times))])
    sd: Array = np.sqrt(np.array(variances) @ shares**2)
    return zero, sd


def _variance_of_mean(time: Array, force: Array, reading_sd: float) -> float:
    """Variance of the mean of readings by their noise about a line, N2; of few by `reading_sd`."""
    if time.size < FEW:
        return reading_sd**2 / time.size
    residual = force - np.polynomial.Polynomial.fit(time, force, 1)(time)
    return float(residual @ residual) / (time.size - 2) / time.size * inflation(residual)


def _reading_sd(force: Array) -> float:
    """SD of the noise of one reading, N, by second differences, in which a force hardly shows."""
    if force.size < 3:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(force, 2))) / np.sqrt(6.0))
