"""Mesh of a quarter block under a round pin whose lines follow the pin's rim.

Seen from above: a square core about the axis, and around it rings of elements between rays from the
axis.  The rings are squares at the core and the block's sides, and circles where the rim is.  The
solution hardly changes along the rim, so that two elements along an eighth of it do what takes ten
on a grid; elements can be spent where material passes the fillet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from skfem import MeshHex

from fe.specimens.block_pin_geometry import BlockPin, Contact, Symmetry
from fe.specimens.checks import check_counts
from fe.specimens.mesh_lines import N_DENSITY, Dense, bump, lines_of_density, thinner

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

CORE, INNER, OUTER = 0.3, 0.65, 1.15
"""half the core's side, and where circles begin and end, over the pin's radius"""
GLUED_RIM, SLIDING_RIM = (0.9, Dense(peak=6.0, spread=0.4)), (0.8, Dense(peak=4.0, spread=0.4))
"""where rings are dense, over the pin's radius, the unit of the spread; a pin that sticks or not"""
BASE, TOP = Dense(peak=3.0, spread=0.1), Dense(peak=6.0, spread=0.12)
"""of the layers at a base and under a pin that sticks, by the height"""
THINNING = 0.5
"""of the layers towards the top where neither sticks"""
WIDEST = 0.7
"""pin over block, with room for squares to become circles"""
LONGEST = 1.5
"""ratio of the block's sides"""


@dataclass(frozen=True)
class Rings:
    """Numbers of Q2 elements of a quarter; raises ValueError unless at least 1."""

    rings: int
    """from the core to the block's side"""
    layers: int
    """over the height"""
    sectors: int = 2
    """along an eighth of the rim"""

    def __post_init__(self) -> None:
        for name in ("rings", "layers", "sectors"):
            check_counts(name, getattr(self, name), 1)


Cells = tuple[int, int, int] | Rings
"""numbers of elements along x, y, z, or rings"""


def check_rings(specimen: BlockPin, part: Symmetry) -> None:
    """Raise ValueError for a pin that rings cannot follow to the block's sides."""
    sides = sorted((specimen.width, specimen.depth))
    wide = specimen.pin_width > WIDEST * sides[0]
    if specimen.pin != "round" or part != "quarter" or wide:
        raise ValueError(
            f"cells: expected for rings a quarter model of a round pin, at most {WIDEST} times as "
            f"wide as the block, found a {part} model of {specimen.pin!r}, "
            f"{specimen.pin_width} mm, on {specimen.width} x {specimen.depth} mm"
        )
    if sides[1] > LONGEST * sides[0]:
        raise ValueError(
            f"cells: expected for rings sides of a ratio up to {LONGEST}, found "
            f"{specimen.width} x {specimen.depth} mm"
        )


def ring_mesh(specimen: BlockPin, cells: Rings, contact: Contact) -> MeshHex:
    """Hexahedra of the quarter."""
    plan, quads = _plan(specimen, cells.rings, cells.sectors, contact)
    y = _layers(specimen.height, cells.layers, contact)
    n = plan.shape[1]
    points = np.stack([np.tile(plan[0], y.size), np.repeat(y, n), np.tile(plan[1], y.size)])
    corners = np.asarray(MeshHex.elem.refdom.p, dtype=np.int64)
    around = np.array([[0, 3], [1, 2]])[corners[0], corners[2]]
    layers = [quads[around] + n * (layer + corners[1][:, None]) for layer in range(cells.layers)]
    return MeshHex(points, np.hstack(layers))


def _plan(
    specimen: BlockPin, n_ring: int, n_sector: int, contact: Contact
) -> tuple[Array, IntArray]:
    """Points (2, n) x, z in mm and quadrilaterals (4, m) of the section, counted around."""
    radius = specimen.pin_width / 2.0
    side = np.array([specimen.width, specimen.depth]) / 2.0
    at, dense = GLUED_RIM if contact.pin == "stick" else SLIDING_RIM
    s = np.linspace(CORE * radius, side[0], N_DENSITY)
    s = lines_of_density(s, 1.0 + bump(s - at * radius, dense, radius), n_ring)
    angle = np.pi / 4.0 * np.arange(2 * n_sector + 1) / n_sector
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    circle[0, 1] = circle[-1, 0] = 0.0
    square = circle / circle.max(axis=1, keepdims=True)
    inner = _smooth((s - s[0]) / (INNER * radius - s[0]))
    outer = _smooth((s - OUTER * radius) / (side[0] - OUTER * radius))
    round_ = np.where(s < radius, inner, 1.0 - outer)[:, None, None]
    stretch = np.where(s[:, None] < radius, 1.0, side / side[0])[:, None]
    rings = s[:, None, None] * (round_ * circle + (1.0 - round_) * square * stretch)
    rings[-1] = np.where(np.isclose(square, 1.0), side, rings[-1])  # no rounding
    ticks = np.concatenate([[0.0], rings[0, 1 : n_sector + 1, 1]])
    core = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=2)
    return _joined(core, rings, n_sector)


def _joined(core: Array, rings: Array, n_sector: int) -> tuple[Array, IntArray]:
    """Core (k + 1, k + 1, 2) and rings (n + 1, 2 k + 1, 2), the first of which is its rim."""
    k, n_ray = n_sector, 2 * n_sector + 1
    inside = np.arange((k + 1) ** 2).reshape(k + 1, k + 1)
    rim = np.concatenate([inside[k, :], inside[k - 1 :: -1, k]])
    further = inside.size + np.arange((len(rings) - 1) * n_ray).reshape(-1, n_ray)
    around = np.vstack([rim, further])
    points = np.vstack([core.reshape(-1, 2), rings[1:].reshape(-1, 2)])
    quads = [
        np.stack([a[:-1, :-1], a[1:, :-1], a[1:, 1:], a[:-1, 1:]]).reshape(4, -1)
        for a in (inside, around)
    ]
    return points.T, np.hstack(quads)


def _layers(height: float, n: int, contact: Contact) -> Array:
    """(n + 1,) heights of the layers, mm."""
    if "stick" not in (contact.pin, contact.base):
        return thinner(height, THINNING, n)
    y = np.linspace(0.0, height, N_DENSITY)
    density = np.ones(N_DENSITY)
    density += bump(y, BASE, height) if contact.base == "stick" else 0.0
    density += bump(height - y, TOP, height) if contact.pin == "stick" else 0.0
    return lines_of_density(y, density, n)


def _smooth(t: Array) -> Array:
    """From 0 to 1 without a kink."""
    t = np.clip(t, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))
