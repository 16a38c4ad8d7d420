"""Where the pin touches, of rubber that has not recovered from what was done to it before.

Rubber that was pressed stays dented for seconds: the next way down meets it later. By the force at
the touch alone that moves the contact by some 10 micrometres. Here the record up to the first steps
is one quasi-linear viscoelastic fit (Fung, Biomechanics, 1993, section 7.6): the force at rest is
the depth times the exponential of a polynomial of it, what a change of it leaves behind dies out as
it does in the holds, each cycle has a stiffness of its own, and a pin does not pull.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from calib.data.qc.contact import SMALLEST_SD, Contact
from calib.data.qc.plateaus import Cycle, Hold
from calib.data.qc.relaxation import fit_prony
from calib.data.readers.frames import BoolArray
from fe.response import Array

MOST_CYCLES = 5
"""the last ones before the steps, that the fit takes"""
DEGREE = 3
"""of the polynomial of the logarithm of the force at rest over the depth"""
STEP_S = 0.05
"""s, about, between readings of the fit: means of the record's"""
SETTLING_S = 2.0
"""s after a way up whose readings do not count: a sample may stick to the pin that leaves it"""
STILL = 0.02
"""mm/s below which the pin stands"""
LEAST_DEPTH = 0.5
"""mm to which the holds of the steps count at least"""
PER_SD = 2
"""places in an SD at which the likelihood of the contact is computed, to three SDs on each side"""
SPACINGS = (0.004, 0.04)
"""mm, least and largest SD for it"""
FAR = 0.2
"""mm from where the ways down begin: what a fit that has gone astray finds"""


class Memory(NamedTuple):
    """What of a change of the force at rest comes on top of it, and over which time it dies out."""

    shares: Array
    """(n,) of the change"""
    times: Array
    """(n,) s"""

    def force(self, at_rest: Array, step_s: float) -> Array:
        """(n,) N on top of the force at rest (n,) N over times `step_s` apart."""
        change = np.diff(at_rest, prepend=at_rest[0])
        total = np.zeros_like(at_rest)
        for share, tau in zip(self.shares, self.times, strict=True):
            decay = np.exp(-step_s / tau)
            total += share * lfilter([tau / step_s * (1.0 - decay)], [1.0, -decay], change)
        return total


class Readings(NamedTuple):
    """Readings at even times."""

    step_s: float
    time: Array
    """(n,) s"""
    position: Array
    """(n,) mm of the machine, its compliance taken off"""
    force: Array
    """(n,) N"""
    cycle: Array
    """(n,) integers: which of the last cycles, and their number after them"""
    counts: BoolArray
    """(n,) whether the fit is held against it"""


def memory_of_holds(time: Array, force: Array, row: list[Hold]) -> Memory:
    """How the force dies out in the holds of the steps, by the mean of them all.

    time (n,) s and force (n,) N of the record. A step takes time itself, during which its force
    begins to die out; the shares are those of a sudden one. None is negative.
    """
    if len(row) < 2:
        return Memory(np.zeros(0), np.zeros(0))
    length = min(hold.end - hold.start for hold in row)
    even = np.arange(0.0, length, max(float(np.median(np.diff(time))), STEP_S))
    together = np.sum([np.interp(hold.start + even, time, force) for hold in row[1:]], axis=0)
    prony = fit_prony(even, together)
    ends = [force[(time > hold.end - 0.25 * length) & (time <= hold.end)].mean() for hold in row]
    risen = float(ends[-1] - ends[0])
    duration = float(np.median([b.start - a.end for a, b in pairwise(row)]))
    if risen <= 0.0:
        return Memory(np.zeros(0), np.zeros(0))
    left = prony.times / duration * -np.expm1(-duration / prony.times)
    shares = prony.amplitude / (risen * left)
    known = shares > 1e-4
    return Memory(shares[known], prony.times[known])


def recovered_contact(readings: Readings, memory: Memory, start: Contact) -> Contact:
    """Contact by the fit to all readings that count, from `start`, what the ways down alone say.

    Each reading that comes to lie on the other side of the contact is a kink of the sum of squares,
    which has several minima close to each other: the place is the mean, and its SD that, of
    the likelihood over places about the best one.
    `start` is returned where the readings do not tell the fit's unknowns.
    """
    n_cycles, counts = int(readings.cycle.max()), readings.counts

    def misfit(values: Array) -> Array:
        off: Array = (_force(values, n_cycles, readings, memory) - readings.force)[counts]
        return off

    deepest, pressed = readings.position.max() - start.by_force, readings.force.max()
    size = 3 + n_cycles + DEGREE
    if not (deepest > 0.0 and pressed > 0.0 and counts.sum() > 2 * size):
        return start
    shape = [np.log(pressed / deepest), *np.zeros(DEGREE)]
    first = np.array([start.by_force, 0.0, *np.ones(n_cycles), *shape])
    try:
        found = least_squares(misfit, first, method="lm", x_scale=np.maximum(np.abs(first), 0.05))
        variance = 2.0 * found.cost / (counts.sum() - size)
        covariance = variance * np.linalg.inv(found.jac.T @ found.jac)
        spacing = float(np.clip(np.sqrt(covariance[0, 0]), *SPACINGS)) / PER_SD
        places, squares = _profile(misfit, found.x, spacing)
    except (np.linalg.LinAlgError, ValueError):
        return start
    weights = np.exp(-0.5 * (squares - squares.min()) / max(variance, np.finfo(float).tiny))
    weights /= weights.sum()
    place = float(weights @ places)
    sd = max(float(np.sqrt(weights @ (places - place) ** 2)), SMALLEST_SD)
    noise = float(np.sqrt(variance))
    return Contact(place, sd, noise, place, sd) if abs(place - start.by_force) < FAR else start


def _profile(misfit: Callable[[Array], Array], best: Array, spacing: float) -> tuple[Array, Array]:
    """Places (n,) mm about that of the `best` values, and the least sums of squares there.

    The other values go from place to place by two steps of Gauss and Newton.
    """
    steps = range(1, 3 * PER_SD + 1)
    found = {0: float(np.sum(misfit(best) ** 2))}
    for sign in (-1, 1):
        values = best.copy()
        for step in steps:
            values[0] = best[0] + sign * step * spacing
            moves = 1e-6 * np.maximum(np.abs(values[1:]), 0.05)
            off = misfit(values)
            slopes = [
                (misfit(values + move * unit) - off) / move
                for move, unit in zip(moves, np.eye(values.size)[1:], strict=True)
            ]
            inverse = np.linalg.pinv(np.array(slopes).T)
            for _ in range(2):
                values[1:] -= inverse @ misfit(values)
            found[sign * step] = float(np.sum(misfit(values) ** 2))
    order = sorted(found)
    return best[0] + spacing * np.array(order), np.array([found[step] for step in order])


def _force(values: Array, n_cycles: int, readings: Readings, memory: Memory) -> Array:
    """(n,) N at all readings for contact, zero, stiffness of each cycle and coefficients."""
    place, zero = values[:2]
    stiffness = np.append(values[2 : 2 + n_cycles], 1.0)[readings.cycle]
    depth = np.maximum(readings.position - place, 0.0)
    at_rest = (
        depth * np.exp(np.polynomial.polynomial.polyval(depth, values[2 + n_cycles :])) * stiffness
    )
    force = np.maximum(at_rest + memory.force(at_rest, readings.step_s), 0.0)
    return np.where(depth > 0.0, force, 0.0) + zero


def contact_after_recovery(
    time: Array,
    position: Array,
    force: Array,
    row: list[Hold],
    cycles: list[Cycle],
    start: Contact,
) -> Contact:
    """Contact by the record up to the last hold that is no deeper than what came before the steps.

    time (n,) s, position (n,) mm of the machine without its compliance, force (n,) N without the
    load cell's zero; `row` are the holds of the steps. `start` is what the ways down alone say; it
    is returned where the record does not tell more.
    """
    reached = max([cycle.peak_travel for cycle in cycles], default=0.0) + 0.25 * LEAST_DEPTH
    allowed = start.by_force + max(reached, LEAST_DEPTH)
    until = max([hold.end for hold in row if hold.position < allowed], default=row[0].end)
    readings = readings_before(time, position, force, row[0].start, until, cycles)
    return recovered_contact(readings, memory_of_holds(time, force, row), start)


def readings_before(
    time: Array,
    position: Array,
    force: Array,
    before: float,
    until: float,
    cycles: list[Cycle],
) -> Readings:
    """Readings up to `until` [s], from the first of the last cycles; steps begin after `before`."""
    peaks = np.array([cycle.time for cycle in cycles])
    between = np.zeros(0)
    begin = float(time[0])
    if peaks.size > MOST_CYCLES:
        first, then = peaks[-MOST_CYCLES - 1 : -MOST_CYCLES + 1]
        begin, peaks = _highest(time, position, first, then), peaks[-MOST_CYCLES:]
    if peaks.size:
        pairs = zip(peaks, np.append(peaks[1:], before), strict=True)
        between = np.array([_highest(time, position, a, b) for a, b in pairs])
    step = max(float(np.median(np.diff(time))), 1e-6)
    step *= max(round(STEP_S / step), 1)
    even = np.arange(begin, until, step)
    place, load = _means(time, position, even, step), _means(time, force, even, step)
    speed = np.gradient(place, step)
    last_up = np.maximum.accumulate(np.where(speed < -STILL, even, -np.inf))
    goes_down, settled = speed > STILL, even - last_up > SETTLING_S
    counts: BoolArray = np.asarray(goes_down | settled & (speed > -STILL))
    return Readings(step, even, place, load, np.searchsorted(between, even), counts)


def _highest(time: Array, position: Array, after: float, before: float) -> float:
    """When the pin is highest between two times, s: the last of such."""
    inside = np.flatnonzero((time > after) & (time < before))
    height = position[inside]
    return float(time[inside[np.flatnonzero(height <= height.min() + 1e-3)[-1]]])


def _means(time: Array, values: Array, even: Array, step: float) -> Array:
    """(n,) means of the values about even times; where no reading lies, between the nearest."""
    edges = np.append(even - 0.5 * step, even[-1] + 0.5 * step)
    index = np.searchsorted(edges, time, side="right") - 1
    inside = (index >= 0) & (index < even.size)
    count = np.bincount(index[inside], minlength=even.size)
    total = np.bincount(index[inside], weights=values[inside], minlength=even.size)
    between = np.interp(even, time, values)
    return np.where(count > 0, total / np.maximum(count, 1), between)
