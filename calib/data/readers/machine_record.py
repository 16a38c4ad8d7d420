"""Force and travel of one run of a testing machine, whatever program wrote them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from fe.response import Array

Direction = Literal["compression", "tension", "unknown"]


@dataclass(frozen=True)
class MachineRecord:
    """Samples of one run, in the signs of the file, in s, mm and N; whole sample.

    Raises ValueError when shapes disagree, values are not finite or time runs backwards.
    """

    format: str
    """name of the format read, as `Instron Bluehill csv`"""
    time: Array
    """(n_sample,) s, not decreasing"""
    force: Array
    """(n_sample,) N"""
    travel: Array | None
    """(n_sample,) mm, or None where the file has force only"""
    positive: Direction
    """what a positive force and travel mean, as the file says; "unknown" where it does not"""
    channels: Mapping[str, str] = field(default_factory=dict)
    """column of the file behind time, force and travel, with its unit"""
    metadata: Mapping[str, str] = field(default_factory=dict)
    """what the head of the file says of specimen and test"""
    frame: Array | None = None
    """(n_sample,) number of the DIC image taken at the sample, NaN where none; or None"""
    notes: tuple[str, ...] = ()
    """what the reader assumed or left out, one sentence each"""

    def __post_init__(self) -> None:
        n = self.time.size
        if self.time.shape != (n,) or n == 0:
            raise ValueError(f"time: expected shape (n_sample,), found {self.time.shape}")
        for name in ("time", "force", "travel"):
            values = getattr(self, name)
            if values is None:
                continue
            if values.shape != (n,):
                raise ValueError(f"{name}: expected shape ({n},), found {values.shape}")
            if not np.all(np.isfinite(values)):
                raise ValueError(f"{name}: expected finite values, found NaN or infinity")
        if self.frame is not None and self.frame.shape != (n,):
            raise ValueError(f"frame: expected shape ({n},), found {self.frame.shape}")
        if np.any(np.diff(self.time) < 0):
            raise ValueError("time: expected values that do not decrease, found a step back")
        if self.positive not in ("compression", "tension", "unknown"):
            raise ValueError(f"positive: expected a direction, found {self.positive!r}")

    def in_compression(self) -> MachineRecord:
        """The same with compression positive.

        Raises ValueError where the file does not say what its signs mean.
        """
        if self.positive == "unknown":
            raise ValueError("positive: expected a record that states its sign, found 'unknown'")
        if self.positive == "compression":
            return self
        travel = None if self.travel is None else -self.travel
        return replace(self, force=-self.force, travel=travel, positive="compression")

    def at_distinct_times(self) -> MachineRecord:
        """The same with readings of one time spread evenly from there towards the next time.

        A clock that is written to a tenth of a second gives several readings one time; what is
        fitted over time needs them apart. Their mean would smear how the force begins. Readings
        that all have one time stay as they are.
        """
        time, first, place, count = np.unique(
            self.time, return_index=True, return_inverse=True, return_counts=True
        )
        if time.size in (1, self.time.size):
            return self
        gaps = np.diff(time)
        gaps = np.minimum(np.append(gaps, np.inf), np.median(gaps))  # a pause is no clock's step
        order = np.arange(self.time.size) - first[place]
        return replace(self, time=self.time + order / count[place] * gaps[place])
