"""Which frame shows a hold, and whether it does at every offset that the clocks may have."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from calib.data.qc.experiment_file import Experiment
from calib.data.qc.machine_test import NotAsPlanned
from calib.data.qc.synchronise import Synchronised
from fe.response import Array


def frames_of_holds(
    together: Synchronised, numbers: Array, travel: Array, experiment: Experiment
) -> tuple[list[int], Array]:
    """Frame and travel (n,) mm of each hold that is needed: those used and one on each side.

    Of several frames in one hold the last counts that stays in it at all offsets of the clocks
    that are possible, as its force has relaxed the most; where none does, that nearest to the
    middle. `numbers` (n_hold,) and `travel` (n_hold,) mm are those of the loaded holds. Raises
    NotAsPlanned where a hold that is used has no frame.
    """
    later = together.hold[1:]
    missed = int(np.count_nonzero(later < 0))
    if missed and later.size == numbers.size and not np.isin(numbers, later).all():
        limit = experiment.camera.max_clock_offset_s
        raise NotAsPlanned(
            "frames in no hold, while a hold has none", missed,
            f"0 (is the camera's clock within camera.max_clock_offset_s, {limit:g} s?)",
        )  # fmt: skip
    use = experiment.protocol.use
    chosen, places = [], []
    for number, place_of in zip(numbers, travel, strict=True):
        frame = _frame_of(together, int(number))
        if number in _wanted(use) and frame is not None:
            chosen.append(frame)
            places.append(float(place_of))
        elif number in use:
            raise NotAsPlanned(f"frames in hold {number}", 0, 1)
    return chosen, np.array(places)


def clock_doubts(name: str, together: Synchronised, use: Collection[int]) -> list[str]:
    """A sentence where a frame that is needed of a sample may be of no hold, or of another."""
    unsure = []
    for number in _wanted(use):
        frame = _frame_of(together, number)
        if frame is not None and not together.stays[frame]:
            unsure.append(str(number))
    if not unsure:
        return []
    return [
        f"sample {name}: of the frames in hold {', '.join(unsure)} none stays in it at all offsets "
        f"of camera and machine that are possible ({together.offset:.2g} ± "
        f"{together.half_width:.2g} s), so that fields may be those of another travel; expected "
        f"clocks that are known better (camera.max_clock_offset_s) or longer holds"
    ]


def _wanted(use: Collection[int]) -> range:
    return range(max(min(use) - 1, 1), max(use) + 2)


def _frame_of(together: Synchronised, number: int) -> int | None:
    """The frame after the reference that shows the hold of this number, None where none does."""
    taken = np.flatnonzero(together.hold[1:] == number) + 1
    if not taken.size:
        return None
    sure = taken[together.stays[taken]]
    return int(sure[-1]) if sure.size else int(taken[np.argmax(together.depth[taken])])
