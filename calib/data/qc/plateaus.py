"""The step protocol in a test-machine record: cycles first, then steps with a hold after each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import find_peaks

from calib.data.qc.experiment_file import Protocol
from fe.response import Array

NORMAL_MEDIAN = 0.6745
"""median of the size of a normal number of SD 1"""
SURE = 2.0
"""SDs of its noise that a change of the peak force may be off by"""
STILL = 0.1
"""share of an increment within which the position of a hold stays"""
SMALLEST_STEP = 1e-6
"""s, at which a record is looked at"""
SHORTEST = 0.5
"""share of the protocol's hold that a hold has at least"""


class Hold(NamedTuple):
    """A time at constant position."""

    number: int
    """of the increment; 0 before the first step"""
    start: float
    """s"""
    end: float
    """s"""
    position: float
    """mm, as the machine says it"""


class Cycle(NamedTuple):
    """One preconditioning cycle."""

    time: float
    """s, of its peak"""
    peak_force: float
    """N"""
    peak_travel: float
    """mm"""
    peak_sd: float = 0.0
    """N, SD of the peak force by the noise of readings"""


def find_holds(time: Array, position: Array, protocol: Protocol) -> list[Hold]:
    """All times at constant position of at least half the protocol's hold, unnumbered (-1).

    time (n,) s and position (n,) mm. A reading is still where all positions within a quarter of a
    hold around it differ by no more than a tenth of an increment and what the noise explains.
    """
    step = max(float(np.median(np.diff(time))), SMALLEST_STEP)
    even = np.arange(time[0], time[-1] + step / 2, step)
    place = np.interp(even, time, position)
    noise = 1.4826 * float(np.median(np.abs(np.diff(place, 2)))) / np.sqrt(6.0)
    half = max(round(protocol.hold_s / 8 / step), 1)
    size = 2 * half + 1
    spread = maximum_filter1d(place, size) - minimum_filter1d(place, size)
    allowed = STILL * protocol.increment_mm + 6 * noise
    is_still = np.concatenate([[False], spread <= allowed, [False]])
    edges = np.flatnonzero(np.diff(is_still.astype(np.int8)))
    holds = []
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        level = float(np.median(place[first:after]))
        near = np.abs(place - level) <= allowed
        earliest = even[first] - protocol.hold_s
        # the window looked past both ends; the hold reaches as far as its position does
        while first > 0 and near[first - 1] and even[first - 1] > earliest:
            first -= 1
        while after < even.size and near[after]:
            after += 1
        if even[after - 1] - even[first] >= SHORTEST * protocol.hold_s:
            holds.append(Hold(-1, float(even[first]), float(even[after - 1]), level))
    return holds


def step_row(holds: list[Hold], protocol: Protocol) -> list[Hold]:
    """The longest row of holds each of which lies one increment deeper than the one before."""
    best: list[Hold] = []
    row: list[Hold] = []
    for hold in holds:
        step = hold.position - row[-1].position if row else 0.0
        if row and 0.5 < step / protocol.increment_mm < 1.5:
            row.append(hold)
        else:
            row = [hold]
        if len(row) > len(best):
            best = list(row)
    return best


def step_holds(holds: list[Hold], protocol: Protocol, contact: float) -> list[Hold]:
    """The holds of the step protocol, numbered; 0 is a hold before the first step.

    They are those of `step_row`. The first has number 0 when it lies less than half an increment
    beyond `contact`, the position [mm] at which the pin touches, or where the protocol says that
    there is such a hold; holds on the way there are left out.
    """
    best = step_row(holds, protocol)
    if not best:
        return []
    ahead = (best[0].position - contact) / protocol.increment_mm
    # where the pin touches is known to less than half an increment; further steps are as planned
    first = min(round(ahead), 1)
    if first >= 0 and protocol.hold_at_contact is not None:
        first = 0 if protocol.hold_at_contact else 1
    return [hold._replace(number=first + i) for i, hold in enumerate(best) if first + i >= 0]


def find_cycles(
    time: Array, travel: Array, force: Array, before: float, protocol: Protocol
) -> list[Cycle]:
    """Preconditioning cycles before the time `before` [s]: peaks of the travel.

    The peak force is the largest mean of readings close to the deepest position, so that the
    noise of one reading does not count as force.
    """
    if protocol.preconditioning_cycles == 0:
        return []
    earlier = time < before
    travel, force, time = travel[earlier], force[earlier], time[earlier]
    if travel.size < 3:
        return []
    depth = protocol.preconditioning_travel_mm
    padded = np.concatenate([[travel.min()], travel])  # a record may begin at the first peak
    peaks, _ = find_peaks(padded, prominence=0.5 * depth)
    # white noise by second differences, to which the force itself adds next to nothing
    noise = float(np.median(np.abs(np.diff(force, 2)))) / (NORMAL_MEDIAN * np.sqrt(6.0))
    cycles = []
    for peak in peaks - 1:
        level = travel[peak]
        close = np.abs(travel - level) < 0.02 * depth
        first, after = peak, peak + 1
        while first > 0 and close[first - 1]:
            first -= 1
        while after < travel.size and close[after]:
            after += 1
        mean, sd = float(np.mean(force[first:after])), noise / np.sqrt(after - first)
        cycles.append(Cycle(float(time[peak]), mean, float(level), float(sd)))
    return cycles


def cycle_changes(cycles: list[Cycle]) -> Array:
    """(n_cycle - 1,) change of the peak force from each cycle to the next, percent."""
    peaks = np.array([cycle.peak_force for cycle in cycles])
    if peaks.size < 2:
        return np.zeros(0)
    change: Array = 100 * np.diff(peaks) / peaks[1:]
    return change


def cycle_change_sds(cycles: list[Cycle]) -> Array:
    """(n_cycle - 1,) SD of these changes by the noise of readings, percent."""
    peaks = np.array([cycle.peak_force for cycle in cycles])
    sd = np.array([cycle.peak_sd for cycle in cycles])
    if peaks.size < 2:
        return np.zeros(0)
    found: Array = 100 * np.hypot(sd[1:], sd[:-1]) / np.abs(peaks[1:])
    return found


def converged_after(cycles: list[Cycle], percent: float = 1.0) -> int | None:
    """Number of cycles after which the peak force changes by less than `percent` a cycle.

    None when it does not within the record (thesis, Figure 5.1: after 5 to 6), or when noise is
    too large to tell: a change counts with two of its SDs.
    """
    changes = np.abs(cycle_changes(cycles)) + SURE * cycle_change_sds(cycles)
    settled = [i for i in range(changes.size) if np.all(changes[i:] < percent)]
    return settled[0] + 1 if settled else None
