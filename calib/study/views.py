"""One FE run of a planned block, seen by cameras on its faces, with derivatives by its ratios."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from skfem import Basis, ElementHex2

from fe.response import Array
from fe.specimens.block_pin import BlockPinModel
from fe.specimens.block_pin_part import SYMMETRY_FACTOR

Face = Literal["front", "side"]

GRID = (35, 24)
"""points along half the face and along its height, as on the thesis' front face"""


class Seen(NamedTuple):
    """Field on one face in the camera's axes: along the face, up, towards the camera."""

    points: Array
    """(n_point, 2) place along the face from the middle, and height, mm"""
    displacement: Array
    """(n_step, n_point, 3) mm"""
    gradient: Array
    """(n_step, n_point, 3, n_ratio) mm by r, or r and s"""


class Run(NamedTuple):
    """A run at kappa = 1 MPa."""

    ratios: Array
    """(n_ratio,)"""
    travel: Array
    """(n_step,) mm"""
    force: Array
    """(n_step,) N, whole sample"""
    force_gradient: Array
    """(n_step, n_ratio) N by r, or r and s"""
    faces: dict[Face, Seen]


def run_with_views(model: BlockPinModel, ratios: Array) -> Run:
    """Solve a quarter model at r, or (r, s); both faces are seen, whatever its field points.

    With r alone the law is Mooney-Rivlin of two constants, s = 0.  Raises ValueError when the run
    stops before its last travel.
    """
    n_ratio = len(ratios)
    states, _, _ = model.solve(np.append(ratios, 0.0)[:2])
    if len(states) < len(model.travel):
        reached = states[-1].travel if states else 0.0
        raise ValueError(
            f"travel: the run stopped at {reached:g} mm, expected {model.travel[-1]:g} mm"
        )
    basis = Basis(model.mesh(), ElementHex2(), intorder=1)
    factor = SYMMETRY_FACTOR[model.part]
    faces: dict[Face, Seen] = {}
    for face in ("front", "side"):
        points, places, axes = _face(model, face)
        # just inside: some versions of scikit-fem do not find points on the border
        probe = basis.probes((1.0 - INSIDE) * places.T).tocsr()
        n = probe.shape[1]
        fields = np.array([probe @ state.u[:n] for state in states])
        slopes = np.array(
            [
                (probe @ state.u_gradient[:n].reshape(n, -1)).reshape(len(places), 3, -1)
                for state in states
            ]
        )[..., :n_ratio]
        faces[face] = Seen(points, fields[:, :, axes], slopes[:, :, axes])
    return Run(
        ratios=np.asarray(ratios, dtype=np.float64),
        travel=np.array(model.travel),
        force=factor * np.array([state.pin_force for state in states]),
        force_gradient=factor * np.array([state.force_gradient[:n_ratio] for state in states]),
        faces=faces,
    )


def _face(model: BlockPinModel, face: Face) -> tuple[Array, Array, list[int]]:
    """Points on the face, their places (n_point, 3) in the block, and the camera's axes."""
    specimen = model.specimen
    length = (specimen.width if face == "front" else specimen.depth) / 2.0
    along, up = np.meshgrid(
        (np.arange(GRID[0]) + 0.5) * length / GRID[0],
        (np.arange(GRID[1]) + 0.5) * specimen.height / GRID[1],
        indexing="ij",
    )
    points = np.stack([along.ravel(), up.ravel()], axis=1)
    fixed = np.full(len(points), (specimen.depth if face == "front" else specimen.width) / 2.0)
    if face == "front":
        return points, np.column_stack([points, fixed]), [0, 1, 2]
    return points, np.column_stack([fixed, points[:, 1], points[:, 0]]), [2, 1, 0]


def similar(run: Run, scale: float) -> Run:
    """The run of a geometrically similar block, all lengths and travels `scale` times as large.

    Exact without a solve: displacements scale with the length, forces with its square.
    """
    faces: dict[Face, Seen] = {
        face: Seen(scale * seen.points, scale * seen.displacement, scale * seen.gradient)
        for face, seen in run.faces.items()
    }
    return Run(
        run.ratios,
        scale * run.travel,
        scale**2 * run.force,
        scale**2 * run.force_gradient,
        faces,
    )


INSIDE = 1e-9
"""of a place, by which it is moved towards the origin"""
FAR = 1000.0
"""mm between the points of two faces: their noise is not correlated"""


def together(run: Run, faces: tuple[Face, ...]) -> Seen:
    """What cameras on these faces see, as one field."""
    seen = [run.faces[face] for face in faces]
    points = [one.points + np.array([FAR * i, 0.0]) for i, one in enumerate(seen)]
    return Seen(
        np.concatenate(points),
        np.concatenate([one.displacement for one in seen], axis=1),
        np.concatenate([one.gradient for one in seen], axis=1),
    )
