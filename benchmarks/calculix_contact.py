"""The block under a pin with contact, solved by CalculiX and by softcal.

    python -m benchmarks.calculix_contact [--size 1] [--only CASE ...]

CalculiX gets what the product has not: serendipity bricks, and a pin of small flat facets that the
block's top meets by its surface-to-surface penalty, linear in the overclosure, with CalculiX's own
friction.  softcal gets a penalty stiffened ten times, as a rigid pin is compared.  Same geometry,
law, travels; both on meshes of their own.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from skfem import MeshHex

from benchmarks import calculix
from fe import BlockPin, BlockPinModel, Contact, PenaltyLaw

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

QUARTER = 4.0
TOLERANCE = 1e-9
"""mm, of places on a face"""
OVERCLOSURE = 50.0
"""CalculiX's contact pressure per overclosure, MPa/mm: 0.2 MPa are 4 um"""
STICK = 2.0
"""CalculiX's friction per slip before the limit, MPa/mm"""
STIFFENED, SLIP = 10.0, 0.003
"""of softcal's penalty: times as stiff, and mm of slip before the limit"""
ARC, AROUND, TOP = 16, 15, 1.6
"""facets of the pin along its fillet and across that, and how high its side goes, mm"""


@dataclass(frozen=True)
class PinCase:
    """A quarter block under a pin, lengths in mm."""

    pin: Literal["bar", "round"]
    friction: float
    """coefficient on the pin, 0 for none"""
    base: Literal["stick", "slide"]
    travel: tuple[float, ...] = (0.2, 0.4, 0.6, 0.8, 1.0)
    constants: tuple[float, float, float] = (0.004, 0.008, 0.003)
    """C10, C01, C11, MPa"""
    bulk_ratio: float = 2.0
    """bulk modulus over mu: CalculiX's bricks stiffen where it is large"""

    def __str__(self) -> str:
        on_pin = f"friction {self.friction:g}" if self.friction else "sliding"
        base = "glued" if self.base == "stick" else "sliding"
        return f"{self.pin}, {on_pin}, {base} base, bulk/mu {self.bulk_ratio:g}"

    @property
    def specimen(self) -> BlockPin:
        """Block and pin."""
        return BlockPin(pin=self.pin)

    @property
    def kappa(self) -> float:
        """C10 + C01, MPa."""
        return self.constants[0] + self.constants[1]


CASES = (
    PinCase("bar", 0.0, "slide"),
    PinCase("bar", 0.0, "slide", bulk_ratio=10.0),
    PinCase("bar", 0.3, "stick"),
    PinCase("round", 0.0, "slide"),
    PinCase("round", 0.3, "stick"),
)


def _lines(half: float, edge: float, size: int) -> Array:
    """Lines of the mesh from the middle to a side, dense about the pin's edge, mm."""
    inner, outer = edge - 0.6, edge + 0.4
    last = np.linspace(0.0, 1.0, 3 * size + 1)[1:] ** 1.3
    return np.concatenate(
        [
            np.linspace(0.0, inner, 2 * size + 1),
            np.linspace(inner, outer, 4 * size + 1)[1:],
            outer + (half - outer) * last,
        ]
    )


def block_mesh(case: PinCase, size: int) -> MeshHex:
    """Hexahedra of the quarter block, finer by `size`."""
    block = case.specimen
    x = _lines(block.width / 2.0, block.pin_width / 2.0, size)
    z = x if case.pin == "round" else np.linspace(0.0, block.depth / 2.0, 3 * size + 1)
    return MeshHex.init_tensor(x, np.linspace(0.0, block.height, 3 * size + 1), z)


def pin_profile(block: BlockPin) -> tuple[Array, Array]:
    """(n, 2) points of the pin's half profile above the block at rest, and of one inside it, mm."""
    angle = np.linspace(0.0, np.pi / 2.0, ARC + 1)
    flat = np.linspace(0.0, block.half_flat, 7)[:-1]
    side = np.linspace(block.pin_fillet, TOP, 9)[1:]
    out = [
        flat,
        block.half_flat + block.pin_fillet * np.sin(angle),
        np.full(side.size, block.pin_width / 2.0),
    ]
    up = [np.zeros(flat.size), block.pin_fillet * (1.0 - np.cos(angle)), side]
    r, y = np.concatenate(out), np.concatenate(up)
    inside = np.stack([0.875 * r, 0.875 * y + 0.125 * (TOP + 2.5)], axis=1)
    base = np.array([0.0, block.height])
    return base + np.stack([r, y], axis=1), base + inside


def pin_bricks(block: BlockPin) -> tuple[Array, IntArray]:
    """Positions (n_node, 3), mm, and nodes (n_elem, 8) of a shell of the pin, facets outside first.

    A round one leaves out the axis, where its facets would have no area.
    """
    profiles = pin_profile(block)
    layers = []
    for k in range(AROUND + 1):
        for profile in profiles:
            r, y = profile.T
            if block.pin == "bar":
                z = np.full(r.size, -0.5 + 7.5 * k / AROUND)
                layers.append(np.stack([r, y, z], axis=1))
            else:
                turn = np.radians(-6.0 + 102.0 * k / AROUND)
                out = np.maximum(r, 0.02)
                layers.append(np.stack([out * np.cos(turn), y, out * np.sin(turn)], axis=1))
    n = len(profiles[0])
    k, i = (index.ravel() for index in np.meshgrid(np.arange(AROUND), np.arange(n - 1)))
    corner = 2 * n * k + i
    outside = np.stack([corner, corner + 1, corner + 2 * n + 1, corner + 2 * n], axis=1)
    positions, nodes = np.vstack(layers), np.hstack([outside, outside + n])
    a, b, d, e = (positions[nodes[:, j]] for j in (0, 1, 3, 4))
    inverted = np.einsum("ni,ni->n", np.cross(b - a, d - a), e - a) < 0.0
    nodes[inverted] = nodes[inverted][:, [0, 3, 2, 1, 4, 7, 6, 5]]
    return positions, nodes.astype(np.int64)


_FACES = {
    1: [0, 1, 2, 3],
    2: [4, 7, 6, 5],
    3: [0, 4, 5, 1],
    4: [1, 5, 6, 2],
    5: [2, 6, 7, 3],
    6: [3, 7, 4, 0],
}
"""corners of a brick's faces as CalculiX counts them"""


def deck(case: PinCase, size: int) -> tuple[str, Array, IntArray]:
    """Input of CalculiX; all positions of the block (n, 3) mm; its nodes on the front face."""
    positions, nodes = calculix.bricks(block_mesh(case, size))
    pin, shell = pin_bricks(case.specimen)
    n, first = len(positions), len(nodes) + 1
    lines = calculix.node_lines(np.vstack([positions, pin]))
    lines += calculix.element_lines("C3D20R", "BLOCK", nodes)
    lines += calculix.element_lines("C3D8", "PIN", shell + n, first)
    front = np.flatnonzero(positions[:, 2] > case.specimen.depth / 2.0 - TOLERANCE)
    lines += calculix.node_set_lines("PINNODES", range(n, n + len(pin)))
    lines += calculix.node_set_lines("FRONT", front.tolist())
    for axis, name in enumerate(("MIDDLEX", "BASE", "MIDDLEZ")):
        members = np.flatnonzero(positions[:, axis] < TOLERANCE)
        lines += calculix.node_set_lines(name, members.tolist())
    lines += ["*SURFACE, NAME=TOP"]
    for face, corners in _FACES.items():
        height = positions[nodes[:, corners], 1]
        on_top = (height > case.specimen.height - TOLERANCE).all(axis=1)
        lines += [f"{e + 1}, S{face}" for e in np.flatnonzero(on_top)]
    lines += ["*SURFACE, NAME=FACETS"]
    lines += [f"{e}, S1" for e in range(first, first + len(shell))]
    return "\n".join([*lines, *_model_lines(case)]) + "\n", positions, front


def _model_lines(case: PinCase) -> list[str]:
    """Materials, contact, supports and steps."""
    lines = calculix.rubber_lines(case.constants, 2.0 * case.kappa * case.bulk_ratio, "BLOCK")
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", "10., 0.3"]  # every node of it is held
    lines += ["*SOLID SECTION, ELSET=PIN, MATERIAL=STEEL", "*SURFACE INTERACTION, NAME=TOUCH"]
    lines += ["*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{OVERCLOSURE:g}, 1e-5, 1e-3"]
    if case.friction:
        lines += ["*FRICTION", f"{case.friction:g}, {STICK:g}"]
    lines += ["*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE", "TOP, FACETS"]
    lines += ["*BOUNDARY", "MIDDLEX, 1", "MIDDLEZ, 3", "PINNODES, 1", "PINNODES, 3"]
    lines += ["BASE, 1, 3" if case.base == "stick" else "BASE, 2"]
    for travel in case.travel:
        lines += ["*STEP, NLGEOM, INC=500", "*STATIC", "0.1, 1., 1e-5, 0.25"]
        lines += ["*BOUNDARY", f"PINNODES, 2, 2, {-travel:.12e}"]
        lines += ["*NODE PRINT, NSET=PINNODES, TOTALS=ONLY, FREQUENCY=1000", "RF"]
        lines += ["*NODE PRINT, NSET=FRONT, FREQUENCY=1000", "U", "*END STEP"]
    return lines


@dataclass(frozen=True)
class Compared:
    """Forces and front face of both codes at each travel that CalculiX reached."""

    force: Array
    """(n_step,) of the whole block by softcal, N"""
    other: Array
    """(n_step,) by CalculiX, N"""
    field_rms: Array
    """(n_step,) RMS difference of a displacement component on the front face, mm"""
    field_size: Array
    """(n_step,) RMS of a component, mm"""
    seconds: tuple[float, float]
    """of softcal and of CalculiX"""

    @property
    def percent(self) -> Array:
        """(n_step,) softcal's force over CalculiX's, less 1."""
        return 100.0 * (self.force / self.other - 1.0)


def compare(case: PinCase, cells: tuple[int, int, int], size: int) -> Compared:
    """Solve by both codes; softcal's mesh has `cells`, its field is taken at CalculiX's nodes.

    CalculiX, which follows no path through states that are not stable, may stop early; what it
    has reached is compared.  Raises RuntimeError where that is nothing, and where softcal stops.
    """
    started = time.perf_counter()
    text, positions, front = deck(case, size)
    solved = calculix.run(text)
    other = -QUARTER * calculix.total_forces(solved)
    if not other.size:
        raise calculix.not_solved(solved, len(case.travel))
    case = replace(case, travel=case.travel[: other.size])
    moved = calculix.displacements(solved, other.size, front)
    between = time.perf_counter()
    block = case.specimen
    inside = (positions[front, 0] > 1e-9) & (positions[front, 1] > 1e-9)
    inside &= positions[front, 0] < block.width / 2.0 - 1e-9
    inside &= positions[front, 1] < block.height - 1e-9
    at = positions[front][inside, :2]
    model = BlockPinModel(
        block,
        Contact(case.friction or "slide", case.base),
        cells,
        case.travel,
        bulk_ratio=case.bulk_ratio,
        field_grid=tuple((float(x), float(y)) for x, y in at),
        penalty=replace(PenaltyLaw(), slip=SLIP).stiffened(STIFFENED),
        sensitivities=(),
    )
    found = model([case.constants[1] / case.kappa, case.constants[2] / case.kappa])
    if not found.status == "converged":
        raise RuntimeError(f"softcal: {found.message}")
    apart = found.displacement - moved[:, inside]
    return Compared(
        case.kappa * found.force,
        other,
        np.sqrt((apart**2).mean(axis=(1, 2))),
        np.sqrt((found.displacement**2).mean(axis=(1, 2))),
        (time.perf_counter() - between, between - started),
    )


CELLS = {"bar": (16, 6, 4), "round": (14, 6, 14)}
"""softcal's meshes of the table"""
RUNS = [(case, size) for case in CASES for size in ((1, 2) if case.pin == "bar" else (1,))]
"""of the table; a round pin on the finer mesh takes hours"""


def figures(runs: Sequence[tuple[PinCase, int]] = RUNS) -> dict[str, Any]:
    """Compare cases on CalculiX's meshes of a size each, and print a table; JSON values."""
    table = []
    for case, size in runs:
        found = compare(case, CELLS[case.pin], size)
        ours, theirs = found.seconds
        print(f"{case}, CalculiX size {size} ({ours:.0f} s, CalculiX {theirs:.0f} s)", flush=True)
        travels = case.travel[: found.other.size]
        for travel, *row in zip(
            travels, found.other, found.percent, found.field_rms, found.field_size, strict=True
        ):
            line = "  {:.1f} mm: {:.4f} N, {:+.2f} %, field {:.4f} of {:.3f} mm"
            print(line.format(travel, *row), flush=True)
        table.append(
            {
                "case": str(case),
                "size": size,
                "travel_mm": list(travels),
                "calculix_N": found.other.tolist(),
                "force_difference_percent": found.percent.tolist(),
                "field_difference_mm": found.field_rms.tolist(),
                "field_size_mm": found.field_size.tolist(),
            }
        )
    return {"calculix_contact": table}


def main(arguments: list[str] | None = None) -> None:
    """Compare the cases asked for."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.calculix_contact", description=__doc__.splitlines()[0]
    )
    names = [str(case) for case in CASES]
    parser.add_argument("--size", type=int, default=1, help="fineness of CalculiX's mesh")
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="CASE")
    options = parser.parse_args(arguments)
    figures([(case, options.size) for case in CASES if str(case) in options.only])


if __name__ == "__main__":
    main()
