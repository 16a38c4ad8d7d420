"""The two dimensions between which something of a specimen is differenced."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

Specimen = TypeVar("Specimen")


def ends(changed: Callable[[float], Specimen], step: float) -> tuple[Specimen, Specimen, float]:
    """Specimens `changed` by `step` up and down, and the distance between them.

    At a limit of the dimension, which refuses one of them by a ValueError, the one that is not
    changed takes its place.  Raises ValueError where both are refused.
    """
    found, width = [], 0.0
    for by in (step, -step):
        try:
            found.append(changed(by))
            width += step
        except ValueError:
            found.append(changed(0.0))
    if width == 0.0:
        changed(step)
    return found[0], found[1], width
