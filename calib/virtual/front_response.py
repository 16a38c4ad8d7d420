"""Force and front-face field of one FE run, small enough to keep, at any point and travel."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from scipy.interpolate import PchipInterpolator

from fe.atomic_file import replacing
from fe.response import Array, IntArray
from fe.specimens.block_pin import BlockPinModel
from fe.specimens.block_pin_part import SYMMETRY_FACTOR

SAME = 1e-9
"""mm: lines of nodes closer than this are one"""


@dataclass(frozen=True)
class FrontResponse:
    """What a block under a pin does, seen from the front; the undeformed state is added.

    The front face of a quarter model has its nodes on lines x >= 0, those of a half model on lines
    of both sides. Raises ValueError when shapes disagree or lines or travels do not increase.
    """

    x: Array
    """(2 nx + 1,) lines of nodes of quadratic elements along the width, mm"""
    y: Array
    """(2 ny + 1,) lines of nodes along the height, mm"""
    travel: Array
    """(n_step,) travels of the pin, mm, increasing, above 0"""
    force: Array
    """(n_step,) force of the whole sample, positive in compression, N"""
    displacement: Array
    """(n_step, 2 nx + 1, 2 ny + 1, 3) displacement (x, y, z) of the nodes, mm"""

    def __post_init__(self) -> None:
        n_step = self.travel.size
        shapes = {
            "travel": (n_step,),
            "force": (n_step,),
            "displacement": (n_step, self.x.size, self.y.size, 3),
        }
        for name, shape in shapes.items():
            found = getattr(self, name)
            if found.shape != shape or not np.all(np.isfinite(found)):
                raise ValueError(
                    f"{name}: expected finite values of shape {shape}, found shape {found.shape}"
                )
        for name in ("x", "y"):
            lines = getattr(self, name)
            if lines.size < 3 or lines.size % 2 == 0 or np.any(np.diff(lines) <= 0):
                raise ValueError(
                    f"{name}: expected an odd number of increasing lines, 3 or more, "
                    f"found {lines.size}"
                )
        if n_step < 2 or np.any(np.diff(self.travel, prepend=0.0) <= 0):
            raise ValueError(f"travel: expected two or more increasing mm, found {self.travel}")

    @property
    def is_quarter(self) -> bool:
        """Whether the plane x = 0 is one of symmetry."""
        return bool(self.x[0] >= -SAME)

    @cached_property
    def _force_curve(self) -> PchipInterpolator:
        return PchipInterpolator(np.append(0.0, self.travel), np.append(0.0, self.force))

    @cached_property
    def _field_curve(self) -> PchipInterpolator:
        start = np.zeros_like(self.displacement[:1])
        nodes = np.concatenate([start, self.displacement])
        return PchipInterpolator(np.append(0.0, self.travel), nodes, axis=0)

    def force_at(self, travel: Array) -> Array:
        """Force at travels (mm, any shape), N; 0 where the pin is above the block.

        Raises ValueError beyond the last travel that was computed.
        """
        self._check(travel)
        found: Array = self._force_curve(np.maximum(travel, 0.0))
        return found

    def field_at(self, points: Array, travel: Array) -> Array:
        """(n_travel, n_point, 3) displacement at points (n_point, 2) of the front face, mm.

        Shape functions of the elements in space, a monotone cubic between the travels. Points off
        the face take the value of its nearest edge. Raises ValueError beyond the last travel.
        """
        self._check(travel)
        nodes = self._field_curve(np.maximum(travel, 0.0))
        mirrored = np.abs(points[:, 0]) if self.is_quarter else points[:, 0]
        column, across = _quadratic(self.x, mirrored)
        row, up = _quadratic(self.y, points[:, 1])
        found = np.zeros((len(nodes), len(points), 3))
        for i in range(3):
            for j in range(3):
                weight = across[:, i] * up[:, j]
                found += weight[:, None] * nodes[:, column + i, row + j]
        if self.is_quarter:
            found[..., 0] *= np.where(points[:, 0] < 0.0, -1.0, 1.0)
        return found

    def _check(self, travel: Array) -> None:
        if np.max(travel, initial=0.0) > self.travel[-1] + SAME:
            raise ValueError(
                f"travel: expected at most {self.travel[-1]:g} mm, as computed, "
                f"found {np.max(travel):g}"
            )


def _quadratic(lines: Array, at: Array) -> tuple[IntArray, Array]:
    """First line (n,) and weights (n, 3) of the quadratic element of each place, mm.

    lines (2 n + 1,) of nodes, those in the middle of elements halfway. Places beyond the lines are
    taken at the nearest one.
    """
    corners, inside = lines[::2], np.clip(at, lines[0], lines[-1])
    element = np.clip(np.searchsorted(corners, inside, side="right") - 1, 0, corners.size - 2)
    t = (inside - corners[element]) / (corners[element + 1] - corners[element])
    weights = np.stack([(2 * t - 1) * (t - 1), 4 * t * (1 - t), t * (2 * t - 1)], axis=1)
    return 2 * element, weights


def solve_front(model: BlockPinModel, ratios: Array) -> FrontResponse:
    """Solve a quarter or half model at kappa = 1 MPa for ratios (r, s) and keep its front face.

    Raises ValueError when the solver does not reach every travel.
    """
    states, outcome, _ = model.solve(ratios)
    if len(states) < len(model.travel):
        raise ValueError(
            f"travel: the simulation stopped at {outcome.reached:g} mm before "
            f"{model.travel[-1]:g} mm; choose a shorter travel or another mesh"
        )
    position = model.discretise().elements.positions
    front = np.flatnonzero(position[:, 2] > model.specimen.depth / 2.0 - SAME)
    front = front[np.lexsort(np.round(position[front, 1::-1].T, 9))]
    x, y = (np.unique(np.round(position[front, axis], 9)) for axis in (0, 1))
    factor = SYMMETRY_FACTOR[model.part]
    return FrontResponse(
        x,
        y,
        np.asarray(model.travel, dtype=np.float64),
        np.array([factor * state.pin_force for state in states]),
        np.stack([state.u[front].reshape(x.size, y.size, 3) for state in states]),
    )


def save_front(path: Path, response: FrontResponse) -> None:
    """Write a response as npz, atomically."""
    with replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **{f.name: getattr(response, f.name) for f in fields(FrontResponse)})


def load_front(path: Path) -> FrontResponse:
    """Read what `save_front` wrote. Raises ValueError naming the file when it is another."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            return FrontResponse(*(stored[f.name] for f in fields(FrontResponse)))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise ValueError(f"{path}: not a stored front-face response ({error})") from error
