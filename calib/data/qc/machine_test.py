"""One sample on the test machine: from the record to force and travel at every hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.data.qc.contact import Contact, find_contact, force_zero, in_compression
from calib.data.qc.experiment_file import Machine, Protocol
from calib.data.qc.plateaus import Cycle, Hold, find_cycles, find_holds, step_holds
from calib.data.qc.relaxation import Relaxation, relaxation
from calib.data.readers import MachineRecord
from calib.data.readers.frames import BoolArray
from fe.response import Array


class NotAsPlanned(ValueError):  # noqa: N818 - says what it is
    """A sample whose files can be read but whose test did not go as the protocol says."""

    def __init__(self, what: str, found: float | str, expected: float | str) -> None:
        super().__init__(f"{what}: found {found}, expected {expected}")
        self.what, self.found, self.expected = what, found, expected


@dataclass(frozen=True)
class MachineTest:
    """What the test machine says of one sample, in compression, with zero and slack taken off."""

    time: Array
    """(n,) s"""
    travel: Array
    """(n,) mm from contact, the machine's compliance taken off"""
    force: Array
    """(n,) N, the load cell's zero taken off"""
    contact: Contact
    holds: tuple[Hold, ...]
    """of the steps, from number 0 or 1 on"""
    plateaus: tuple[Relaxation, ...]
    """one a hold"""
    plateau_travel: Array
    """(n_hold,) mm from contact"""
    cycles: tuple[Cycle, ...]

    def loaded(self) -> tuple[Array, Array, Array]:
        """Numbers, travels [mm] and forces [N] of the holds after a step."""
        numbers = np.array([hold.number for hold in self.holds])
        forces = np.array([plateau.force for plateau in self.plateaus])
        after = numbers > 0
        return numbers[after], self.plateau_travel[after], forces[after]


def machine_test(record: MachineRecord, protocol: Protocol, machine: Machine) -> MachineTest:
    """Zero, slack, compliance, cycles and holds of one record.

    Raises NotAsPlanned when there are fewer holds than the increments used need, ValueError when
    the record has no travel.
    """
    record = in_compression(record, machine.compression_force_sign)
    time, force, position = record.time, record.force, record.travel
    assert position is not None  # in_compression has refused it
    holds = find_holds(time, position, protocol)
    steps = step_holds(holds, protocol, -np.inf)
    if len(steps) < max(protocol.use):
        raise NotAsPlanned("plateaus", len(steps), protocol.increments)
    ramp = _loading_ramp(time, position, steps)
    contact = find_contact(position[ramp], force[ramp])
    steps = step_holds(holds, protocol, contact.travel)
    force = force - force_zero(time, position, force, contact.travel)
    travel = position - contact.travel - machine.compliance_mm_per_N * force
    plateaus, places = [], []
    for hold in steps:
        during = (time >= hold.start) & (time <= hold.end)
        if np.count_nonzero(during) < 5:
            raise NotAsPlanned("readings of a hold", np.count_nonzero(during), 5)
        plateaus.append(relaxation(time[during], force[during], machine.force_window))
        late = during & (time >= hold.end - machine.force_window * (hold.end - hold.start))
        places.append(float(travel[late].mean()))
    cycles = find_cycles(time, position - contact.travel, force, steps[0].start, protocol)
    return MachineTest(
        time, travel, force, contact, tuple(steps), tuple(plateaus), np.array(places), tuple(cycles)
    )


def _loading_ramp(time: Array, position: Array, steps: list[Hold]) -> BoolArray:
    """Readings of the last way down before the steps, else of the first steps.

    A steady ramp has no relaxation in it; of the preconditioning the last is the one whose material
    the steps meet.
    """
    first = steps[0].start
    before = time < first
    depth = steps[0].position
    deep = before & (position > depth + 0.3)
    if not deep.any():
        return (time <= steps[min(3, len(steps) - 1)].end) & (position >= position[0] - 1e-9)
    last = int(np.flatnonzero(deep)[-1])
    # back from the last peak to where the pin was highest since the peak before
    start = last
    while start > 0 and position[start] > depth - 0.05:
        start -= 1
    peak = start + int(np.argmax(position[start : last + 1]))
    shallow = start
    lowest = position[start]
    for index in range(start, -1, -1):
        if position[index] > depth + 0.3:
            break
        if position[index] <= lowest:
            shallow, lowest = index, float(position[index])
        elif position[index] <= lowest + 0.02:
            shallow = index
    ramp = np.zeros(time.size, dtype=np.bool_)
    ramp[shallow : peak + 1] = True
    return ramp


def at_travel(travel: Array, values: Array, nominal: Array, reach: float) -> Array:
    """(n_nominal, ...) values at nominal travels [mm] from those at travels (n_hold,) [mm].

    Through the three holds around the nearest one, zero travel included, goes a parabola; where
    one of them has no value (NaN), a line through two. NaN where the nearest hold is farther than
    `reach` [mm].
    """
    knots = np.concatenate([[0.0], travel])
    known = np.concatenate([np.zeros_like(values[:1]), values])
    result = np.full((len(nominal), *values.shape[1:]), np.nan)
    for row, place in enumerate(nominal):
        nearest = 1 + int(np.argmin(np.abs(travel - place)))
        if abs(knots[nearest] - place) > reach:
            continue
        middle = min(nearest, knots.size - 2) if knots.size > 2 else nearest
        three = np.arange(middle - 1, min(middle + 2, knots.size))
        result[row] = np.tensordot(_lagrange(knots[three], place), known[three], axes=1)
        # a line through the nearest hold and the one on the side of the place, then the other
        side = 1 if place > knots[nearest] else -1
        for other in (nearest + side, nearest - side):
            if 0 <= other < knots.size:
                two = np.array([nearest, other])
                line = np.tensordot(_lagrange(knots[two], place), known[two], axes=1)
                result[row] = np.where(np.isnan(result[row]), line, result[row])
    return result


def _lagrange(knots: Array, place: float) -> Array:
    """Weights of values at the knots in their polynomial at a place."""
    weights = np.ones(knots.size)
    for i in range(knots.size):
        for j in range(knots.size):
            if i != j:
                weights[i] *= (place - knots[j]) / (knots[i] - knots[j])
    return weights
