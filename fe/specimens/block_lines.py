"""Where the mesh lines of a block under a pin stand: across the pin, along a bar, over the height.

Where material passes the pin's edge whole rows of nodes snap past its fillet.  Glued faces are
singular where they end: at the flat of the pin, and where base and top meet the free faces.
Elements thin enough for those would make a block that slides chatter, so the lines follow what is
glued.  Along a bar little happens until near the front face, so the depth takes few elements.  One
mesh line under a bar that sticks is the edge of its flat, for glue that ends inside an element ends
somewhere else on every mesh.  Lines are values of one smooth map for all numbers of elements, so
that meshes of proportional numbers are similar: under a bar that sticks exactly with even numbers
across it, whose middle line is that edge.  Of a flat that is narrow or nearly as wide as the block
it is another line.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.specimens.block_pin_geometry import BlockPin, Contact
from fe.specimens.mesh_lines import (
    N_DENSITY,
    Dense,
    Pinned,
    bump,
    line_for,
    lines_of_density,
    thinner,
)

Array = npt.NDArray[np.float64]


class Edge(NamedTuple):
    """Lines that stand closer under the edge of a pin, whose half width or radius is the unit."""

    at: float
    dense: Dense


FLAT = 0.85
"""usual half width of a bar's flat over that of the bar"""
GLUED_EDGE = Edge(FLAT, Dense(peak=8.0, spread=0.35))
"""of a bar that sticks: at the edge of its flat the glue ends"""
RUBBING_EDGE = Edge(FLAT, Dense(peak=4.0, spread=0.35))
"""of a bar with friction and more than two elements along it: what sticks under its flat ends near
there, but not on a line of the mesh"""
SLIDING_EDGE = Edge(0.7, Dense(peak=2.0, spread=0.45))
"""of a pin that slides: material that slides past the fillet comes from further in"""
GLUED_RIM = Edge(0.7, Dense(peak=3.0, spread=0.35))
"""of a round pin that sticks: its rim runs across the elements"""
SIDE = Dense(peak=0.7, spread=0.12)
"""at the free side of a glued base, by the length to it: its edge is singular"""
BASE = Dense(peak=5.0, spread=0.1)
"""above a glued base, by the height: close to it the free faces bend sharply"""
TOP = Dense(peak=4.0, spread=0.12)
"""below a glued top, by the height"""
GLUED_DEPTH = 2.25
"""along a bar elements get thinner towards the front face: 1 - (1 - t)^GLUED_DEPTH"""


class Thinning(NamedTuple):
    """How elements get thinner towards an end: t (1 + thinning (1 - t))."""

    front: float
    """along a bar, towards the front face"""
    top: float
    """over the height, towards the top"""


SLIDING = Thinning(front=0.6, top=0.0)
"""of a bar without glue and without friction, or of one or two elements along it"""
RUBBING = Thinning(front=0.9, top=0.0)
"""of a bar with friction and more elements along it: the front face rolls under the pin.  Not
thinner at the top: 16 x 8 x 4 elements so thinned took 331 factorisations in place of 201"""
UNDER_ROUND, STUCK_TO_ROUND = Thinning(front=0.0, top=0.5), Thinning(front=0.0, top=1.0)
"""of a round pin that slides or sticks"""


class Glued(NamedTuple):
    """What of a block under a bar is glued."""

    top: bool
    base: bool


class Manner(NamedTuple):
    """How the lines of a block stand for its contact."""

    is_round: bool
    glued: Glued
    """of a block under a bar; a round pin's lines do not follow glue"""
    edge: Edge
    thinning: Thinning


def manner(contact: Contact, is_round: bool, n_along: int) -> Manner:
    """Of a block with so many elements along a bar."""
    sticks = contact.pin == "stick"
    glued = Glued(not is_round and sticks, not is_round and contact.base == "stick")
    if is_round:
        edge, thinning = (GLUED_RIM, STUCK_TO_ROUND) if sticks else (SLIDING_EDGE, UNDER_ROUND)
        return Manner(True, glued, edge, thinning)
    law = contact.friction(1.0)
    rubs = n_along > 2 and max(law.pin, law.base) > 0.0
    edge, thinning = (RUBBING_EDGE, RUBBING) if rubs else (SLIDING_EDGE, SLIDING)
    return Manner(False, glued, GLUED_EDGE if glued.top else edge, thinning)


class Seen(NamedTuple):
    """A pin as one side of it is seen, on the way from its axis to a face of the block; mm."""

    length: float
    """from the axis to the face"""
    half_width: float
    """of the pin, or its radius"""
    flat: float
    """half width of its flat"""


def seen_from_axis(block: BlockPin, side: float) -> Seen:
    """A straight bar, or a round pin, on the side of lower (-1) or higher (1) x."""
    length = block.width / 2.0 - side * block.pin_shift[0]
    return Seen(length, block.pin_width / 2.0, block.half_flat)


def from_axis(seen: Seen, like: Seen, how: Manner, n: int) -> Array:
    """(n + 1,) lines at distances from the pin's axis, mm.

    Which line is the edge of a flat is chosen for what is seen of `like`, so that lines do not jump
    where a dimension is differenced.
    """
    own, chosen = _density(seen, how), _density(like, how)
    pinned = None
    if how.glued.top:
        line = line_for(*chosen, n, like.flat)
        pinned = None if line is None else Pinned(line, seen.flat)
    return lines_of_density(*own, n, pinned)


def _density(seen: Seen, how: Manner) -> tuple[Array, Array]:
    """Distances from the pin's axis, mm, and the density of lines there."""
    x = np.linspace(0.0, seen.length, N_DENSITY)
    density = 1.0 + (bump(seen.length - x, SIDE, seen.length) if how.glued.base else 0.0)
    at, dense = how.edge
    return x, density + bump(x - at * seen.half_width, dense, seen.half_width)


def along_bar(length: float, how: Manner, n: int) -> Array:
    """(n + 1,) lines at distances along a bar from the plane of symmetry, mm."""
    if any(how.glued):
        return length * (1.0 - (1.0 - np.linspace(0.0, 1.0, n + 1)) ** GLUED_DEPTH)
    return thinner(length, how.thinning.front, n)


def across_no_bar(length: float, how: Manner, n: int) -> Array:
    """(n + 1,) lines at distances from the block's centre, mm, where they follow no pin."""
    x = np.linspace(0.0, length, N_DENSITY)
    glued = bump(length - x, SIDE, length) if any(how.glued) else np.zeros(N_DENSITY)
    return lines_of_density(x, 1.0 + glued, n)


def over_height(height: float, how: Manner, n: int) -> Array:
    """(n + 1,) lines above the base, mm."""
    if not any(how.glued):
        return thinner(height, how.thinning.top, n)
    y = np.linspace(0.0, height, N_DENSITY)
    density = np.ones(N_DENSITY)
    density += bump(y, BASE, height) if how.glued.base else 0.0
    density += bump(height - y, TOP, height) if how.glued.top else 0.0
    return lines_of_density(y, density, n)


def both_sides(behind: Array, before: Array) -> Array:
    """Lines on both sides of the pin's axis from those at growing distances from it, mm.

    Counted from the block's centre, between equal ends.
    """
    half = (behind[-1] + before[-1]) / 2.0
    axis = half - before[-1]
    lines = np.concatenate([axis - behind[:0:-1], axis + before])
    lines[[0, -1]] = -half, half
    return lines
