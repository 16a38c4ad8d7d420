"""What the crosshead does over time, and when the pin stands still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.virtual.laboratory_settings import Protocol
from fe.response import Array


@dataclass(frozen=True)
class Programme:
    """Corners of the crosshead's path; between them it moves evenly."""

    time: Array
    """(n,) s"""
    position: Array
    """(n,) mm, positive in compression, 0 where the steps begin"""
    cycle: Array
    """(n,) which preconditioning cycle, and their number from the approach on"""
    hold_start: Array
    """(increments,) s at which each hold begins"""
    approach: float
    """s at which the approach begins: the pin is above the sample"""

    @property
    def end(self) -> float:
        """When the record ends, s."""
        return float(self.time[-1])


def programme(protocol: Protocol) -> Programme:
    """Rest, cycles, rest, approach, steps with holds, return, rest."""
    corners = [(0.0, -protocol.slack_mm, 0)]

    def move(position: float, cycle: int) -> None:
        time, now, _ = corners[-1]
        corners.append((time + abs(position - now) / protocol.speed_mm_per_s, position, cycle))

    def wait(seconds: float) -> None:
        time, position, cycle = corners[-1]
        corners.append((time + seconds, position, cycle))

    wait(protocol.rest_s)
    for cycle in range(protocol.preconditioning_cycles):
        move(protocol.preconditioning_travel_mm, cycle)
        move(-protocol.slack_mm, cycle)
    wait(protocol.rest_s)
    approach = corners[-1][0]
    last = protocol.preconditioning_cycles
    move(0.0, last)
    wait(protocol.contact_s)
    holds = []
    for step in range(1, protocol.increments + 1):
        move(step * protocol.increment_mm, last)
        holds.append(corners[-1][0])
        wait(protocol.hold_s)
    move(-protocol.slack_mm, last)
    wait(protocol.rest_s)
    time, position, cycles = (
        np.array(column, dtype=np.float64) for column in zip(*corners, strict=True)
    )
    return Programme(time, position, cycles, np.array(holds), approach)
