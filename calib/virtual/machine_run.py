"""One run of the virtual test machine: what it records, and what the pin does meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.virtual.crosshead import Programme, programme
from calib.virtual.laboratory_settings import LaboratorySettings, Rubber, TestMachine
from calib.virtual.relaxation import relaxing_force
from calib.virtual.truth import TruthResponse
from fe.response import Array

N_CURVE = 2001
"""places at which crosshead positions are tabulated over the pin's travel"""
LEAST_ROOM = 2.5
"""SDs of contact that the truth must leave: errors cut off there have a mean of 0.02 SDs"""


@dataclass(frozen=True)
class MachineRun:
    """What a machine records of one sample, compression positive, and the truth behind it."""

    time: Array
    """(n,) s"""
    position: Array
    """(n,) of the crosshead, 0 where the record begins, with the machine's errors, mm"""
    force: Array
    """(n,) N, with the machine's errors"""
    programme: Programme
    travel: Array
    """(increments,) true travel of the pin in each hold, mm"""
    force_at_rest: Array
    """(increments,) true force in each hold when all has relaxed, N"""
    contact: float
    """mm by which the pin touches before the steps begin; negative: after"""


def run_machine(
    truth: TruthResponse,
    stiffness: float,
    settings: LaboratorySettings,
    rng: np.random.Generator,
) -> MachineRun:
    """Test one sample that is `stiffness` times as stiff as the median one.

    The frame yields by the force at rest; what relaxes moves it by less than its rounding.
    Raises ValueError when the protocol goes further than the truth was computed, or so far that
    errors of contact would be cut off on one side.
    """
    machine, protocol = settings.machine, settings.protocol
    path = programme(protocol)
    step = 1.0 / machine.rate_hz
    time = np.arange(0.0, path.end + step / 2.0, step)
    position: Array = np.interp(time, path.time, path.position)
    reach = float(_crosshead(truth, stiffness, machine.compliance_mm_per_N)[1][-1])
    contact = _contact(machine.contact_sd_mm, reach - float(position.max()), rng)
    travel = _travel(truth, stiffness, position + contact, machine.compliance_mm_per_N)
    softening = _softening(path, time, protocol.preconditioning_cycles, settings.rubber)
    force = relaxing_force(truth.force_at(travel, stiffness) * softening, step, settings.rubber)
    force = _pressed(force, travel)
    steps = np.arange(1, protocol.increments + 1, dtype=np.float64)
    reached: Array = steps * protocol.increment_mm + contact
    in_holds = _travel(truth, stiffness, reached, machine.compliance_mm_per_N)
    return MachineRun(
        time,
        _read(position + protocol.slack_mm, machine.travel_noise_mm, machine.travel_step_mm, rng),
        _read(
            force + _offset(time, machine, rng), machine.force_noise_N, machine.force_step_N, rng
        ),
        path,
        in_holds,
        truth.force_at(in_holds, stiffness),
        contact,
    )


def _contact(sd: float, room: float, rng: np.random.Generator) -> float:
    """Normal error of contact, mm; drawn again while it takes the pin beyond what is known.

    `room` is how much further, mm, than the programme the truth was computed.
    """
    if 0.0 <= room < LEAST_ROOM * sd:
        most = room / LEAST_ROOM
        raise ValueError(
            f"contact_sd_mm: expected at most {most:.4f} mm, as the truth was computed for "
            f"{room:.4f} mm of the crosshead beyond the last increment, found {sd:g} mm; fewer "
            "increments, or a truth to a longer travel, leave more"
        )
    contact = float(sd * rng.standard_normal())
    while contact > room >= 0.0:
        contact = float(sd * rng.standard_normal())
    return contact


def _crosshead(truth: TruthResponse, stiffness: float, compliance: float) -> tuple[Array, Array]:
    """Travels of the pin into the sample, and what the crosshead goes for them, mm."""
    table = np.linspace(0.0, truth.fine.travel[-1], N_CURVE)
    return table, table + compliance * truth.force_at(table, stiffness)


def _travel(truth: TruthResponse, stiffness: float, wanted: Array, compliance: float) -> Array:
    """Travel of the pin into the sample, mm, where the crosshead would go `wanted` mm into it."""
    table, crosshead = _crosshead(truth, stiffness, compliance)
    if wanted.max() > crosshead[-1]:
        raise ValueError(
            f"increments: expected travels up to {crosshead[-1]:.3f} mm, as the truth was "
            f"computed, found {wanted.max():.3f} mm"
        )
    found: Array = np.where(wanted <= 0.0, wanted, np.interp(wanted, crosshead, table))
    return found


def _pressed(force: Array, travel: Array) -> Array:
    """Force (n,) N of a pin that cannot pull: rubber that still recovers leaves it, and one that is
    off the sample (travel (n,) mm not above 0) feels nothing."""
    return np.where(travel > 0.0, np.maximum(force, 0.0), 0.0)


def _softening(path: Programme, time: Array, cycles: int, rubber: Rubber) -> Array:
    """Factor of the force over time: each cycle is softer than the one before, down to 1."""
    cycle = path.cycle[np.searchsorted(path.time, time, side="left").clip(0, path.time.size - 1)]
    excess = rubber.first_cycle_excess * np.exp(-cycle / rubber.settling_cycles)
    return np.where(cycle < cycles, 1.0 + excess, 1.0)


def _offset(time: Array, machine: TestMachine, rng: np.random.Generator) -> Array:
    zero, drift = rng.standard_normal(2) * (machine.force_zero_N, machine.force_drift_N)
    offset: Array = zero + drift * time / time[-1]
    return offset


def _read(values: Array, noise: float, step: float, rng: np.random.Generator) -> Array:
    """Values with noise, rounded to whole steps."""
    read: Array = np.round((values + noise * rng.standard_normal(values.shape)) / step) * step
    return read
