"""Residuals of a bundle adjustment and their derivatives by the vector of its parameters.

The vector holds the intrinsics of both cameras, the relative pose, the poses of the plate and, if
it is not taken as exact, the deviations of its points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from calib.dic.camera import Intrinsics, StereoRig, cross_matrix, project_in_camera
from calib.dic.distortion import Array, Distortion
from calib.dic.plate_view import PlateView

IntArray = npt.NDArray[np.int64]
INTRINSIC_NAMES = ("fx", "fy", "cx", "cy", "skew", "k1", "k2", "k3", "p1", "p2")
N_INTRINSIC = len(INTRINSIC_NAMES)
N_POSE = 6
BEHIND = 1e6
"""px, residual of a point behind the camera: no step goes there"""


class Pair(NamedTuple):
    """One pose of the plate, seen by both cameras."""

    left: PlateView
    right: PlateView


class Plate(NamedTuple):
    """All points of the plate that some view shows."""

    places: Array
    """(n_place, 3) mm, z = 0: as it should be"""
    shown: tuple[tuple[IntArray, IntArray], ...]
    """per pose, which of them the left and the right view show"""
    error: float
    """SD of a place's deviation from that along each axis, mm; 0: the plate is exact"""


class Guess(NamedTuple):
    """From where the adjustment starts."""

    rig: StereoRig
    """the left camera at the origin"""
    poses: tuple[tuple[Array, Array], ...]
    """rotation (3, 3) and translation (3,) [mm] of each plate in the left camera's frame"""


def gather(pairs: tuple[Pair, ...], error: float) -> Plate:
    """The plate that views show; points of equal place are one."""
    views = [view for pair in pairs for view in pair]
    stacked = np.round(np.concatenate([view.places for view in views]), 6)
    places, inverse = np.unique(stacked, axis=0, return_inverse=True)
    cuts = np.cumsum([len(view.places) for view in views])[:-1]
    parts = np.split(inverse.ravel().astype(np.int64), cuts)
    index = tuple(zip(parts[::2], parts[1::2], strict=True))
    return Plate(np.column_stack([places, np.zeros(len(places))]), index, error)


def pack(guess: Guess) -> Array:
    """(n_parameter,) intrinsics of both cameras in the order of `INTRINSIC_NAMES`, then poses.

    A pose is a rotation vector and a translation [mm]: of the right camera, then of each plate.
    """
    parts: list[Array] = []
    for camera in (guess.rig.left, guess.rig.right):
        inner = camera.intrinsics
        parts.append(
            np.array(
                [inner.fx, inner.fy, inner.cx, inner.cy, inner.skew, *inner.distortion.coefficients]
            )
        )
    for turn, shift in (guess.rig.relative, *guess.poses):
        parts += [Rotation.from_matrix(turn).as_rotvec(), shift]
    return np.concatenate(parts)


def intrinsics_at(values: Array) -> Intrinsics:
    """Of one camera, from its (10,) parameters in px and 1."""
    k1, k2, k3, p1, p2 = (float(value) for value in values[5:])
    fx, fy, cx, cy, skew = (float(value) for value in values[:5])
    return Intrinsics(fx, fy, cx, cy, skew, Distortion((k1, k2, k3), (p1, p2)))


def pose_at(full: Array, number: int) -> tuple[Array, Array]:
    """Rotation vector (3,), translation (3,) [mm]; 0 is the right camera, then the plates."""
    start = 2 * N_INTRINSIC + N_POSE * number
    return full[start : start + 3], full[start + 3 : start + 6]


def points_at(full: Array, plate: Plate) -> Array:
    """(n_place, 3) of the plate, with their fitted deviations if there are any."""
    if plate.error == 0.0:
        return plate.places
    moved: Array = plate.places + full[full.size - plate.places.size :].reshape(-1, 3)
    return moved


def rotate(vector: Array, points: Array) -> tuple[Array, Array]:
    """Points (n, 3) turned by a rotation vector (3,), and their derivative (n, 3, 3) by it.

    Right Jacobian of SO(3): G. S. Chirikjian, "Stochastic Models, Information Theory, and Lie
    Groups" vol. 2, 2012, eq. 10.86.
    """
    angle = float(np.linalg.norm(vector))
    turn = Rotation.from_rotvec(vector).as_matrix()
    cross = cross_matrix(vector)
    if angle < 1e-4:
        # series: the closed form loses its digits
        first, second = 0.5 - angle**2 / 24.0, 1.0 / 6.0 - angle**2 / 120.0
    else:
        first = (1.0 - np.cos(angle)) / angle**2
        second = (angle - np.sin(angle)) / angle**3
    jacobian = np.eye(3) - first * cross + second * cross @ cross
    skew = np.zeros((len(points), 3, 3))
    skew[:, 0, 1], skew[:, 0, 2] = -points[:, 2], points[:, 1]
    skew[:, 1, 0], skew[:, 1, 2] = points[:, 2], -points[:, 0]
    skew[:, 2, 0], skew[:, 2, 1] = -points[:, 1], points[:, 0]
    return points @ turn.T, -(turn @ skew @ jacobian)


def residual_of(
    full: Array, pairs: tuple[Pair, ...], plate: Plate, shifts: tuple[Array, ...]
) -> tuple[tuple[Array, Array], ...]:
    """Per pose (n, 2) of the left and of the right view: projection less what was found, px."""
    left, right = (
        intrinsics_at(full[:N_INTRINSIC]),
        intrinsics_at(full[N_INTRINSIC : 2 * N_INTRINSIC]),
    )
    turn, move = pose_at(full, 0)
    points = points_at(full, plate)
    parts = []
    for number, (pair, (in_left, in_right)) in enumerate(zip(pairs, plate.shown, strict=True)):
        plate_turn, plate_move = pose_at(full, number + 1)
        placed = rotate(plate_turn, points)[0] + plate_move
        at_left = project_in_camera(left, placed[in_left]).pixels
        at_right = project_in_camera(right, rotate(turn, placed[in_right])[0] + move).pixels
        parts.append(
            (
                at_left + shifts[2 * number] - pair.left.pixels,
                at_right + shifts[2 * number + 1] - pair.right.pixels,
            )
        )
    return tuple(parts)


def flat_residual(parts: tuple[tuple[Array, Array], ...]) -> Array:
    """(n_residual,) px, all views one after the other; finite also for points behind a camera."""
    flat = np.concatenate([off.ravel() for pair in parts for off in pair])
    return np.where(np.isfinite(flat), flat, BEHIND)


def jacobian_of(full: Array, pairs: tuple[Pair, ...], plate: Plate) -> Array:
    """(n_residual, n_parameter); zero blocks are kept, as the solver's factorisation is dense."""
    n = 2 * N_INTRINSIC
    lenses = intrinsics_at(full[:N_INTRINSIC]), intrinsics_at(full[N_INTRINSIC:n])
    turn, move = pose_at(full, 0)
    relative = Rotation.from_rotvec(turn).as_matrix()
    points = points_at(full, plate)
    rows = []
    for number in range(len(pairs)):
        vector, shift = pose_at(full, number + 1)
        own = Rotation.from_rotvec(vector).as_matrix()
        start = n + N_POSE * (number + 1)
        turned, by_own = rotate(vector, points)
        for side, index in enumerate(plate.shown[number]):
            block = np.zeros((len(index), 2, full.size))
            placed, by_turn, by_move = turned[index] + shift, by_own[index], np.eye(3)
            if side == 1:
                placed, by_relative = rotate(turn, placed)
                placed = placed + move
                by_turn, by_move = relative @ by_turn, relative
            seen = project_in_camera(lenses[side], placed)
            if side == 1:
                block[:, :, n : n + 3] = seen.by_point @ by_relative
                block[:, :, n + 3 : n + 6] = seen.by_point
            block[:, :, side * N_INTRINSIC : (side + 1) * N_INTRINSIC] = seen.by_intrinsics
            block[:, :, start : start + 3] = seen.by_point @ by_turn
            block[:, :, start + 3 : start + 6] = seen.by_point @ by_move
            if plate.error > 0.0:
                first = full.size - plate.places.size
                by_place = seen.by_point @ by_move @ own
                for row, place in enumerate(index):
                    block[row, :, first + 3 * place : first + 3 * place + 3] = by_place[row]
            rows.append(block.reshape(-1, full.size))
    return np.vstack(rows)


def circle_shifts(full: Array, pairs: tuple[Pair, ...]) -> tuple[Array, ...]:
    """(n, 2) a view: image of a dot's centre less centre of the dot's image, px, to be taken off.

    The residual is projection plus this shift less the centre found.
    """
    left, right = (
        intrinsics_at(full[:N_INTRINSIC]),
        intrinsics_at(full[N_INTRINSIC : 2 * N_INTRINSIC]),
    )
    turn, move = pose_at(full, 0)
    relative = Rotation.from_rotvec(turn).as_matrix()
    shifts = []
    for number, pair in enumerate(pairs):
        plate_turn, plate_move = pose_at(full, number + 1)
        plate = Rotation.from_rotvec(plate_turn).as_matrix()
        shifts.append(circle_shift(left, plate, plate_move, pair.left))
        shifts.append(
            circle_shift(right, relative @ plate, relative @ plate_move + move, pair.right)
        )
    return tuple(shifts)


def circle_shift(intrinsics: Intrinsics, turn: Array, move: Array, view: PlateView) -> Array:
    """(n, 2) centre of the image of each dot less image of its centre, px.

    A circle's dual conic goes through the plate's homography, and its centre is the last column
    of what comes out (J. Heikkila, IEEE Trans. Pattern Anal. Mach. Intell. 22 (2000) 1066-1077).
    Distortion is taken as linear over one dot.
    """
    if view.radius == 0.0:
        return np.zeros_like(view.pixels)
    centred = np.zeros((len(view.places), 3, 3))
    centred[:] = np.diag([view.radius**2, view.radius**2, 0.0])
    place = np.column_stack([view.places, np.ones(len(view.places))])
    dual = centred - place[:, :, None] * place[:, None, :]
    homography = np.column_stack([turn[:, 0], turn[:, 1], move])
    conic = homography @ dual @ homography.T
    centre = conic[:, :2, 2] / conic[:, 2, 2:]
    flat = np.column_stack([view.places, np.zeros(len(view.places))])
    point = flat @ turn.T + move
    seen = project_in_camera(intrinsics, np.column_stack([centre, np.ones(len(centre))]))
    shift: Array = seen.pixels - project_in_camera(intrinsics, point).pixels
    return shift
