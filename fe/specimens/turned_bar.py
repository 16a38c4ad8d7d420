"""Mesh of a whole block under a bar that may be turned: lines that follow the bar where they can.

Glue that ends inside an element holds all of it, so under a bar that is not along the mesh's lines
a block is too stiff, by a tenth or more on usual meshes.  Where both edges of the flat leave the
block through the faces that the bar's axis is nearer to, the lines across it are drawn anew at each
line along it.  Between, a bar lies over the block's corners, where no grid follows it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from skfem import MeshHex

from fe.specimens.block_lines import (
    Manner,
    across_no_bar,
    along_bar,
    both_sides,
    from_axis,
    manner,
    over_height,
    seen_from_axis,
)
from fe.specimens.block_pin_geometry import BlockPin, Contact

Array = npt.NDArray[np.float64]

ROOM = 0.1
"""of half the block: nearer to a side face the lines of a mesh do not follow the flat's edge"""


class Lie(NamedTuple):
    """How a bar lies on a block."""

    along: int
    """0 or 2: the axis, x or z, that it is nearer to"""
    followed: bool
    """whether the lines of the mesh follow it"""


def lie(block: BlockPin) -> Lie:
    """Which way a bar lies, and whether its flat leaves the block by the faces that it goes to."""
    angle = _angle(block)
    along = 2 if abs(angle) <= 45.0 else 0
    length = block.depth if along == 2 else block.width
    ends = [_straightened(block, along, at) for at in (-length / 2.0, length / 2.0)]
    room = min(seen_from_axis(end, side).length - end.half_flat for end in ends for side in (-1, 1))
    straight = angle in (0.0, -90.0)  # along the lines of any mesh, however wide or near a face
    return Lie(along, straight or bool(room > ROOM * ends[0].width / 2.0))


def edge_crosses_elements(block: BlockPin) -> bool:
    """Whether the edge of a bar's flat lies over the block beside the lines of its mesh."""
    if block.pin == "round" or lie(block).followed:
        return False
    angle = np.radians(block.pin_rotation)
    x, z = (np.array([-length, length]) / 2.0 for length in (block.width, block.depth))
    dx, dz = np.meshgrid(x - block.pin_shift[0], z - block.pin_shift[1])
    beside = np.abs(np.cos(angle) * dx - np.sin(angle) * dz)
    return bool((beside > block.half_flat).any())


def bar_mesh(
    block: BlockPin, like: BlockPin, cells: tuple[int, int, int], contact: Contact
) -> MeshHex:
    """Hexahedra of a whole block under a bar; its lines are chosen for the block `like`."""
    nx, ny, nz = cells
    chosen = lie(like)
    n_across, n_along = (nx, nz) if chosen.along == 2 else (nz, nx)
    how = manner(contact, False, n_along)
    y = over_height(block.height, how, ny)
    if not chosen.followed:
        x = across_no_bar(block.width / 2.0, how, nx)
        z = across_no_bar(block.depth / 2.0, how, nz)
        return MeshHex.init_tensor(both_sides(x, x), y, both_sides(z, z))
    length = block.depth if chosen.along == 2 else block.width
    half = along_bar(length / 2.0, how, n_along)
    along = both_sides(half, half)
    across = np.stack([_across(block, like, chosen, how, n_across, at) for at in along])
    first = across[0]
    lines = (first, y, along) if chosen.along == 2 else (along, y, first)
    mesh = MeshHex.init_tensor(*lines)
    places = np.array(mesh.p)
    line, level = np.searchsorted(first, places[2 - chosen.along]), places[chosen.along]
    places[2 - chosen.along] = across[np.searchsorted(along, level), line]
    return MeshHex(places, mesh.t)


def _across(block: BlockPin, like: BlockPin, chosen: Lie, how: Manner, n: int, at: float) -> Array:
    """(2 n + 1,) lines across the bar at a place along it, mm from the block's centre."""
    own = _straightened(block, chosen.along, at)
    middle = _straightened(like, chosen.along, like.pin_shift[chosen.along // 2])
    return both_sides(
        *(from_axis(seen_from_axis(own, s), seen_from_axis(middle, s), how, n) for s in (-1, 1))
    )


def _straightened(block: BlockPin, along: int, at: float) -> BlockPin:
    """The block with its bar as it is cut at a place along x (0) or z (2), as if it went along z.

    The bar may be beside the block there, which a `BlockPin` refuses: its axis is then at the face.
    """
    angle = np.radians(_angle(block))
    x, z = block.pin_shift
    if along == 2:
        width, depth, axis = block.width, block.depth, x + np.tan(angle) * (at - z)
        cut = np.cos(angle)
    else:
        width, depth, axis = block.depth, block.width, z + (at - x) / np.tan(angle)
        cut = abs(np.sin(angle))
    limit = (1.0 - 1e-9) * width / 2.0
    return replace(
        block,
        width=width,
        depth=depth,
        pin_width=block.pin_width / cut,
        pin_fillet=block.pin_fillet / cut,
        pin_shift=(float(np.clip(axis, -limit, limit)), 0.0),
        pin_rotation=0.0,
    )


def _angle(block: BlockPin) -> float:
    """Of the bar's axis from z towards x, degrees, from -90 to below 90."""
    return (block.pin_rotation + 90.0) % 180.0 - 90.0
