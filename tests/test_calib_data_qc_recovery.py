"""Contact of rubber that is still dented when the pin meets it again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from calib.data.qc.contact import SMALLEST_SD, Contact
from calib.data.qc.plateaus import Cycle, Hold
from calib.data.qc.recovery import contact_after_recovery, memory_of_holds

PLACE, STEP, SPEED, HOLD = 0.437, 0.05, 0.5, 12.0
SHARES, TIMES = (0.06, 0.05), (0.7, 3.0)
CYCLES, DEPTH = 3, 0.9


def at_rest(depth: np.ndarray) -> np.ndarray:
    """N: no exponential of a polynomial."""
    return 1.2 * depth + 0.5 * depth**2 + 0.3 * depth**3


def record(noise: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, list, list]:
    """Time, position and force, holds of the steps and cycles of a rubber that relaxes."""
    corners, cycles, holds = [(0.0, 0.0), (4.0, 0.0)], [], []

    def move(to: float, wait: float = 0.0) -> None:
        time, now = corners[-1]
        corners.append((time + abs(to - now) / SPEED, to))
        if wait:
            corners.append((corners[-1][0] + wait, to))

    for _ in range(CYCLES):
        move(PLACE + DEPTH)
        cycles.append(corners[-1][0])
        move(0.0)
    move(0.0, 8.0)
    for number in range(1, 5):
        move(PLACE + 0.2 * number)
        holds.append(Hold(number, corners[-1][0], corners[-1][0] + HOLD, PLACE + 0.2 * number))
        corners.append((holds[-1].end, holds[-1].position))
    corner_time, corner_place = np.array(corners).T
    time = np.arange(0.0, corner_time[-1], STEP)
    position = np.interp(time, corner_time, corner_place)
    depth = np.maximum(position - PLACE, 0.0)
    softer = np.where(time < 6.0, 1.1, 1.0)  # the first way down
    slow = at_rest(depth) * softer
    force, change = slow.copy(), np.diff(slow, prepend=0.0)
    for share, tau in zip(SHARES, TIMES, strict=True):
        decay = np.exp(-STEP / tau)
        force += share * lfilter([tau / STEP * (1 - decay)], [1, -decay], change)
    force = np.where(depth > 0, np.maximum(force, 0.0), 0.0)
    force += noise * np.random.default_rng(3).standard_normal(time.size)
    peaks = [Cycle(t, float(np.interp(t, time, force)), DEPTH) for t in cycles]
    return time, position, force, holds, peaks


def found(off: float, noise: float = 0.0, **changes: list) -> Contact:
    time, position, force, holds, cycles = record(noise)
    start = Contact(PLACE + off, 0.02, 0.07, PLACE + off, 0.02)
    holds, cycles = changes.get("holds", holds), changes.get("cycles", cycles)
    return contact_after_recovery(time, position, force, holds, cycles, start)


def test_how_the_force_dies_out_is_read_from_the_holds():
    """To a twentieth: within a step the force grows faster than evenly, which is not known."""
    time, _, force, holds, _ = record()
    memory = memory_of_holds(time, force, holds)
    for t in (0.2, 0.5, 1.0, 3.0, 6.0):
        left = float(memory.shares @ np.exp(-t / memory.times))
        true = float(np.array(SHARES) @ np.exp(-t / np.array(TIMES)))
        assert left == pytest.approx(true, abs=0.05 * sum(SHARES))


@pytest.mark.parametrize("off", [-0.02, 0.03])
def test_contact_is_where_the_pin_first_touched_though_later_ways_down_meet_dented_rubber(off):
    contact = found(off, noise=0.002)
    assert contact.by_force == pytest.approx(PLACE, abs=2e-3)
    assert contact.by_force_sd == SMALLEST_SD


def test_noise_of_a_load_cell_moves_it_by_no_more_than_is_stated():
    contact = found(0.01, noise=0.05)
    assert abs(contact.by_force - PLACE) < 2.5 * contact.by_force_sd
    assert SMALLEST_SD <= contact.by_force_sd < 0.03
    assert contact.noise_sd == pytest.approx(0.05, rel=0.1)


def test_a_record_without_cycles_or_with_one_hold_is_fitted_too():
    assert found(0.02, noise=0.002, cycles=[]).by_force == pytest.approx(PLACE, abs=0.02)
    time, position, force, holds, cycles = record()
    start = Contact(PLACE, 0.02, 0.07, PLACE, 0.02)
    one = contact_after_recovery(time, position, force, holds[:1], cycles, start)
    assert one.by_force == pytest.approx(PLACE, abs=0.03)


def test_a_record_without_force_leaves_the_contact_as_it_was():
    time, position, force, holds, cycles = record()
    start = Contact(PLACE, 0.02, 0.07, PLACE, 0.02)
    assert contact_after_recovery(time, position, 0 * force, holds, cycles, start) == start
