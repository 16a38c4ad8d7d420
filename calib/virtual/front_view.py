"""What stereo cameras see of one sample: its points, its true displacements, what is hidden."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.data.readers.frames import BoolArray
from calib.virtual.laboratory_settings import Cameras
from calib.virtual.placement import Placement
from calib.virtual.truth import TruthResponse
from fe.response import Array


@dataclass(frozen=True)
class FrontView:
    """The points of a measurement in the cameras' frame: x right, y up, z towards the cameras."""

    position: Array
    """(n_point, 3) true reference positions, mm"""
    material: Array
    """(n_point, 2) x, y on the face from its bottom centre, mm; beyond the face for some"""
    displacement: Array
    """(n_frame, n_point, 3) true displacements, mm"""
    seen: BoolArray
    """(n_frame, n_point) on the face, not behind the pin and not turned away"""


def grid_spacing(cameras: Cameras, width: float, height: float) -> tuple[float, float]:
    """Distance of neighbouring points along width and height, mm."""
    beyond = 2.0 * cameras.margin_mm
    return (width + beyond) / (cameras.grid[0] - 1), (height + beyond) / (cameras.grid[1] - 1)


def view(truth: TruthResponse, placement: Placement, travel: Array, cameras: Cameras) -> FrontView:
    """The front face of a placed sample at travels (n_frame,) mm.

    The placing is a rigid motion of the face and a shift of the pin; that a sample turned under
    the pin deforms a little otherwise is left out, as such samples are to be rejected.
    """
    specimen = truth.truth.specimen
    n_x, n_y = cameras.grid
    reach = specimen.width / 2.0 + cameras.margin_mm
    step = grid_spacing(cameras, specimen.width, specimen.height)
    right, up = np.array(step) * placement.grid_phase
    x = right - reach + step[0] * np.arange(n_x)
    y = up - cameras.margin_mm + step[1] * np.arange(n_y)
    in_image = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    turn = placement.rotation
    # the points are regular in the image: which places of the plane of the face lie behind them
    material = np.asarray(np.linalg.solve(turn[:2, :2], in_image.T).T, dtype=np.float64)
    flat = np.column_stack([material, np.zeros(len(material))])
    moved = truth.field_at(material, travel, placement.x_shift)
    seen = np.stack(
        [
            _seen(truth, placement.x_shift, flat + by, material, depth, cameras)
            for by, depth in zip(moved, travel, strict=True)
        ]
    )
    position = flat @ turn.T + np.array(placement.origin)
    return FrontView(position, material, moved @ turn.T, seen)


def _seen(
    truth: TruthResponse,
    shift: float,
    place: Array,
    material: Array,
    travel: float,
    cameras: Cameras,
) -> BoolArray:
    """Whether points at `place` (n_point, 3), from `material` of the face, can be correlated."""
    specimen, lost, edge = truth.truth.specimen, cameras.hidden_mm, cameras.edge_mm
    half = specimen.width / 2.0
    on_face = (np.abs(material[:, 0]) < half - edge) & (
        np.abs(material[:, 1] - specimen.height / 2.0) < specimen.height / 2.0 - edge
    )
    if travel <= 0.0:
        return on_face
    behind_pin = (np.abs(place[:, 0] - shift) < specimen.pin_width / 2.0 + lost) & (
        place[:, 1] > specimen.height - travel - lost
    )
    return on_face & ~behind_pin & (_facing(place, cameras.grid) > cameras.least_seen)


def _facing(place: Array, grid: tuple[int, int]) -> Array:
    """(n_point,) cosine between the deformed surface's normal and the line of sight."""
    surface = place.reshape(*grid, 3)
    normal = np.cross(np.gradient(surface, axis=0), np.gradient(surface, axis=1))
    length = np.linalg.norm(normal, axis=-1)
    facing: Array = (normal[..., 2] / np.maximum(length, 1e-12)).ravel()
    return facing
