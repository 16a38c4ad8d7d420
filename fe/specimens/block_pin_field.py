"""How the field points of a block under a pin pass its material when the geometry changes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from skfem import MeshHex

from fe.field_motion import FieldMotion, FieldProbe, passing
from fe.specimens.block_pin_geometry import BlockPin
from fe.specimens.block_pin_parameters import by_geometry, mesh_motion

Array = npt.NDArray[np.float64]


def field_motion(
    names: tuple[str, ...],
    specimen: BlockPin,
    lines: Callable[[BlockPin], MeshHex],
    points: Callable[[BlockPin], Array],
    probe: FieldProbe,
) -> FieldMotion:
    """Motion in the named parameters; `points` are (n_point, 2), mm, `lines` makes the mesh.

    Points keep their fractions of width and height, elements go with the mesh's planes.
    """
    at = _on_front(specimen, points)
    passed = np.zeros((*at.shape, len(names)))
    for j, name in enumerate(names):
        moved = by_geometry(name, specimen, lambda changed: _on_front(changed, points))
        if moved is not None:
            passed[..., j] = moved - mesh_motion(name, specimen, at, lines)
    return passing(passed, probe)


def _on_front(specimen: BlockPin, points: Callable[[BlockPin], Array]) -> Array:
    """(n_point, 3) field points, mm."""
    flat = points(specimen)
    return np.column_stack([flat, np.full(len(flat), specimen.depth / 2.0)])
