"""What a tilted pin does to the front face, by FElupe: how much of it is more travel there.

    python -m benchmarks.tilted_pin [--cells 10 6 16] [--angle 0.5]

A stuck block of 10 x 10 x 2.5 mm, half of it (x > 0), neo-Hookean, bulk modulus 50 times mu. What
is under the flat of a bar that is tilted along its length by an angle comes down by
travel + z tan(angle). Its front face, at z = 5 mm, is held against that of an untilted bar which
comes down as far everywhere: the share of that change, by least squares, and what is left.
`[noise] face_travel_sd` stands for it. Units mm, N, MPa.
"""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

import felupe as fem
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

WIDTH, HEIGHT, DEPTH = 10.0, 2.5, 10.0
FLAT = 1.7
"""half of the flat of a pin of 4 mm with edges of 0.3 mm, mm"""
BULK = 50.0
N_STEP = 6
NEAR = 1e-9


class Face(NamedTuple):
    """The front face of a block that was pressed, and the force on half of the block."""

    displacement: Array
    """(n_node, 3) mm"""
    force: float
    """N at mu = 1 MPa"""


class Tilt(NamedTuple):
    """What a tilt of the pin changes at the front face."""

    share: float
    """of the change by as much more travel, all components together"""
    by_component: tuple[float, float, float]
    """the same of x, y, z alone"""
    rms: float
    """of the change, mm"""
    left: float
    """RMS of what that share does not explain, mm"""
    force: float
    """relative change of the force"""


def tilt(cells: tuple[int, int, int], travel: float, angle: float) -> Tilt:
    """Effect of a tilt by `angle` degrees at a travel, mm, on a mesh of first-order elements."""
    slope = float(np.tan(np.radians(angle)))
    straight, further, tilted = (
        press(cells, travel, 0.0),
        press(cells, travel + slope * DEPTH / 2.0, 0.0),
        press(cells, travel, slope),
    )
    by_travel = further.displacement - straight.displacement
    change = tilted.displacement - straight.displacement
    x, y, z = (_share(change[:, k], by_travel[:, k]) for k in range(3))
    share = _share(change, by_travel)
    left = change - share * by_travel
    return Tilt(
        share,
        (x, y, z),
        float(np.sqrt(np.mean(change**2))),
        float(np.sqrt(np.mean(left**2))),
        tilted.force / straight.force - 1.0,
    )


def _share(change: Array, along: Array) -> float:
    return float(np.sum(change * along) / np.sum(along**2))


def press(cells: tuple[int, int, int], travel: float, slope: float) -> Face:
    """Half of a block under a bar that is `slope` lower for each mm along z."""
    mesh = _mesh(cells)
    x, y, z = mesh.points.T
    field = fem.FieldsMixed(fem.RegionHexahedron(mesh), n=3)
    solid = fem.SolidBody(fem.ThreeFieldVariation(fem.NeoHooke(mu=1.0, bulk=BULK)), field)
    under = (abs(y - HEIGHT) < NEAR) & (x < FLAT + NEAR)
    held = fem.Boundary(field[0], mask=under)
    bounds: dict[str, Any] = {
        "base": fem.Boundary(field[0], fy=0.0),
        "middle": fem.Boundary(field[0], fx=0.0, skip=(0, 1, 1)),
        "pin": held,
    }
    moved = np.zeros((under.sum(), 3))
    for part in np.linspace(0.0, 1.0, N_STEP + 1)[1:]:
        moved[:, 1] = -part * (travel + slope * z[under])
        held.value = moved.ravel()
        free, fixed = fem.dof.partition(field, bounds)
        given = fem.dof.apply(field, bounds, free)
        fem.newtonraphson(items=[solid], dof0=free, dof1=fixed, ext0=given, tol=1e-8, verbose=0)
    forces = solid.results.force.toarray().ravel()[: 3 * len(x)].reshape(-1, 3)
    front = abs(z - DEPTH / 2.0) < NEAR
    return Face(field[0].values[front].copy(), float(-forces[under, 1].sum()))


def _mesh(cells: tuple[int, int, int]) -> fem.Mesh:
    """Even lines, but for x, where one is at the edge of the flat."""
    nx, ny, nz = cells
    mesh = fem.Cube(b=(WIDTH / 2.0, HEIGHT, DEPTH), n=(nx + 1, ny + 1, nz + 1))
    lines = np.linspace(0.0, WIDTH / 2.0, nx + 1)
    at = int(np.argmin(abs(lines - FLAT)))
    moved = np.interp(lines, [0.0, lines[at], lines[-1]], [0.0, FLAT, lines[-1]])
    mesh.points[:, 0] = np.interp(mesh.points[:, 0], lines, moved)
    mesh.points[:, 2] -= DEPTH / 2.0
    return mesh


def main() -> None:
    """Print the figures at two travels."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.tilted_pin", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--cells", type=int, nargs=3, default=(10, 6, 16), metavar="N")
    parser.add_argument("--angle", type=float, default=0.5, help="degrees")
    arguments = parser.parse_args()
    nx, ny, nz = arguments.cells
    for travel in (0.6, 1.0):
        found = tilt((nx, ny, nz), travel, arguments.angle)
        print(f"{travel:g} mm, {arguments.angle:g} degrees: {found}")


if __name__ == "__main__":
    main()
