"""One sample on the test machine: from the record to force and travel at every hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.data.qc.contact import FIT_DEPTH, Contact, find_contact, force_zero, in_compression
from calib.data.qc.experiment_file import Machine, Protocol
from calib.data.qc.plateaus import (
    SMALLEST_STEP,
    Cycle,
    Hold,
    find_cycles,
    find_holds,
    step_holds,
    step_row,
)
from calib.data.qc.recovery import contact_after_recovery
from calib.data.qc.relaxation import Relaxation, relaxation
from calib.data.readers import MachineRecord
from calib.data.readers.frames import BoolArray
from fe.response import Array

ENOUGH = 30
"""readings of a way down that show where the pin touches"""
SURE = 2.0
"""SDs of the contact that noise is allowed"""
NEAR = 0.25
"""of an increment: readings that far beyond the first hold are beyond contact for certain"""
SATURATED = 0.5
"""share of a hold's readings that are the largest of all, from which the load cell is at its end"""
OFF_STEP = 0.08
"""share by which holds may be nearer or farther from one another than planned, in the mean"""
LARGEST_GAP = 2e7
"""usual times between readings that two are apart at most: a clock that jumped gives more"""


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

    Raises NotAsPlanned when there are fewer holds than the increments used need, one time alone or
    a clock that jumps far ahead, ValueError when the record has no travel.
    """
    record = in_compression(record.at_distinct_times(), machine.compression_force_sign)
    time, force, position = record.time, record.force, record.travel
    if not time[-1] > time[0]:
        raise NotAsPlanned("times of readings", 1, "2 or more")
    _check_clock(time)
    assert position is not None  # in_compression has refused it
    holds = find_holds(time, position, protocol)
    row = _planned_row(time, position, holds, protocol)
    by_force = _contact_by_force(time, position, force, row, protocol)
    zeroed = force - force_zero(time, position, force, by_force.travel)[0]
    cycles = find_cycles(time, position - by_force.travel, zeroed, row[0].start, protocol)
    pressed = position - machine.compliance_mm_per_N * zeroed
    by_force = contact_after_recovery(time, pressed, zeroed, row, cycles, by_force)
    steps = step_holds(holds, protocol, by_force.travel)
    numbered = [hold for hold in steps if hold.number > 0]
    if not numbered or numbered[-1].number < max(protocol.use):
        raise NotAsPlanned("plateaus", len(numbered), max(protocol.use))
    # the operator starts the steps where the pin touches
    by_hand = numbered[0].position - numbered[0].number * protocol.increment_mm
    _check_contact(by_force, by_hand, protocol)
    contact = by_force.combined(by_hand, machine.contact_sd_mm)
    zero, zero_sd = force_zero(time, position, force, contact.travel)
    force = force - zero
    travel = position - contact.travel - machine.compliance_mm_per_N * force
    plateaus, places = [], []
    for hold in steps:
        during = (time >= hold.start) & (time <= hold.end)
        if np.count_nonzero(during) < 5:
            raise NotAsPlanned("readings of a hold", int(during.sum()), 5)
        found = relaxation(time[during], force[during], machine.force_window)
        by_zero = float(zero_sd[during].mean())
        plateaus.append(found._replace(force_sd=float(np.hypot(found.force_sd, by_zero))))
        late = during & (time >= hold.end - machine.force_window * (hold.end - hold.start))
        places.append(float(travel[late].mean()))
    _check_compliance(places, protocol, machine, force)
    during_steps = [(time >= h.start) & (time <= h.end) for h in steps if h.number > 0]
    raw = [record.force[during] for during in during_steps]
    _check_saturation(position, record.force, raw, protocol.increment_mm)
    cycles = find_cycles(time, position - contact.travel, force, steps[0].start, protocol)
    return MachineTest(
        time, travel, force, contact, tuple(steps), tuple(plateaus), np.array(places), tuple(cycles)
    )


def _check_compliance(
    places: list[float], protocol: Protocol, machine: Machine, force: Array
) -> None:
    """Raise NotAsPlanned where the machine would give way by more than the pin travels.

    As by a compliance or a force in another unit: no hold would be near an increment then.
    """
    given = machine.compliance_mm_per_N * float(np.abs(force).max())
    if given > 0.0 and not max(places, default=0.0) > 0.5 * float(protocol.travel[-1]):
        raise NotAsPlanned(
            "mm that the machine gives way by", float(f"{given:.3g}"),
            "much less than the pin travels (are forces in N, machine.compliance_mm_per_N too?)",
        )  # fmt: skip


def _check_clock(time: Array) -> None:
    """Raise NotAsPlanned where the clock (n,) [s] jumps far ahead."""
    gaps = np.diff(time)
    largest = LARGEST_GAP * max(float(np.median(gaps)), SMALLEST_STEP)
    if (gap := float(gaps.max())) > largest:
        what = f"seconds without a reading after {time[gaps.argmax()]:.6g} s"
        raise NotAsPlanned(what, float(f"{gap:.3g}"), float(f"{largest:.3g}"))


def _planned_row(time: Array, position: Array, holds: list[Hold], protocol: Protocol) -> list[Hold]:
    """The row of holds of the steps; time [s] and position [mm] (n,) of all readings.

    Raises NotAsPlanned where there is none, or its holds are not an increment apart in the mean.
    """
    row = step_row(holds, protocol)
    if len(row) < 2:
        away = len(step_row(find_holds(time, -position, protocol), protocol))
        if away > 1:
            raise NotAsPlanned(
                "holds", f"{away} that go away from the sample by the signs of the file",
                "holds that go into it (is compression positive there?)",
            )  # fmt: skip
        raise NotAsPlanned("plateaus", 0, protocol.increments)
    step = (row[-1].position - row[0].position) / (len(row) - 1)
    if not abs(step / protocol.increment_mm - 1.0) < OFF_STEP:
        raise NotAsPlanned(
            "mm from hold to hold", float(f"{step:.4g}"),
            f"protocol.increment_mm, {protocol.increment_mm:g}",
        )  # fmt: skip
    return row


def _check_saturation(position: Array, force: Array, holds: list[Array], increment: float) -> None:
    """Raise NotAsPlanned where the load cell is at the end of its range.

    position [mm] and force [N] (n,) of all readings, forces of each hold, increment [mm].
    Most readings of a hold are then the largest of the record, which came before the pin was there.
    A cell so coarse that the readings of all holds are one number each says nothing of it.
    """
    largest = float(force.max())
    before = float(np.ptp(position[np.isclose(force, largest, rtol=1e-9, atol=0.0)]))
    at_end = [_share_at(readings, largest) > SATURATED for readings in holds]
    others = [r for r, ends in zip(holds, at_end, strict=True) if not ends]
    coarse = all(_share_at(r, float(np.median(r))) > SATURATED for r in others)
    if any(at_end) and before > NEAR * increment and not coarse:
        raise NotAsPlanned(
            "N that a hold's readings stay at", float(f"{largest:.4g}"),
            "forces that go on (did the load cell reach the end of its range?)",
        )  # fmt: skip


def _share_at(readings: Array, value: float) -> float:
    return float(np.mean(np.isclose(readings, value, rtol=1e-9, atol=0.0)))


def _contact_by_force(
    time: Array, position: Array, force: Array, row: list[Hold], protocol: Protocol
) -> Contact:
    """Where the pin touches by the force on all ways down before the steps.

    Where these do not go beyond the first hold, or hardly, by that of the steps, if it says it
    better.
    """
    about = row[0].position - 0.5 * protocol.increment_mm  # to an increment: first hold may be 0
    loading = _loading(time, position, row[0].start, about)
    beyond = position[loading] > row[0].position + NEAR * protocol.increment_mm
    found = []
    if np.count_nonzero(loading) >= ENOUGH:
        found.append(find_contact(position[loading], force[loading]))
    if np.count_nonzero(beyond) < ENOUGH:  # the way down may end where the steps begin
        loading = (time <= row[min(4, len(row) - 1)].end) & (time > row[0].start - 30.0)
        found.append(find_contact(position[loading], force[loading]))
    return min(found, key=lambda contact: contact.by_force_sd)


def _check_contact(by_force: Contact, by_hand: float, protocol: Protocol) -> None:
    """Raise NotAsPlanned where the first hold is not where the steps begin by the force.

    That is, by more than half an increment and what noise may be.
    """
    most = 0.5 * protocol.increment_mm + SURE * by_force.by_force_sd
    if not np.isfinite(most):
        raise NotAsPlanned("contact by the force", "none", "a force that begins to rise")
    apart = abs(by_force.by_force - by_hand)
    if not apart <= most:
        what = "mm between contact by the force and where the steps begin"
        raise NotAsPlanned(what, float(f"{apart:.3g}"), f"{most:.3g} or less")


def _loading(time: Array, position: Array, before: float, contact: float) -> BoolArray:
    """Readings of all ways down before the steps, from above contact to well beyond it.

    In a steady ramp nothing relaxes, and where the pin touches does not change from cycle to cycle.
    """
    step = float(np.median(np.diff(time)))
    near = max(int(0.25 / step), 2)
    ahead = np.interp(time + near * step, time, position)
    behind = np.interp(time - near * step, time, position)
    down: BoolArray = (ahead - behind > 0.04) & (ahead >= position) & (position >= behind)
    depth = position - contact
    deep: BoolArray = np.asarray(down & (depth > -0.4) & (depth < FIT_DEPTH) & (time < before))
    return deep


def at_travel(travel: Array, values: Array, nominal: Array, reach: float, most: int = 3) -> Array:
    """(n_nominal, ...) values at nominal travels [mm] from those at travels (n_hold,) [mm].

    Through the holds around the nearest one, three or `most` (odd), zero travel included, goes a
    polynomial; where one of them has no value (NaN), a line through the nearest and its neighbour.
    NaN where the nearest hold is farther than `reach` [mm].
    """
    knots = np.concatenate([[0.0], travel])
    known = np.concatenate([np.zeros_like(values[:1]), values])
    result = np.full((len(nominal), *values.shape[1:]), np.nan)
    for row, place in enumerate(nominal):
        nearest = 1 + int(np.argmin(np.abs(travel - place)))
        if abs(knots[nearest] - place) > reach:
            continue
        first = min(max(nearest - most // 2, 0), max(knots.size - most, 0))
        some = np.arange(first, min(first + most, knots.size))
        result[row] = np.tensordot(_lagrange(knots[some], place), known[some], axes=1)
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
