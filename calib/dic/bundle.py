"""Bundle adjustment: intrinsics, distortion, relative pose and poses of the plate, all at once.

Minimises a robust sum of the distances between the points found in the images and those the
cameras would show; exact derivatives; the parameters' covariance is that of the linearised problem.
Source: B. Triggs et al., "Bundle adjustment - a modern synthesis", LNCS 1883 (2000) 298-372;
plates: Z. Zhang, IEEE Trans. Pattern Anal. Mach. Intell. 22 (2000) 1330-1334.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calib.dic.camera import Camera, Intrinsics, StereoRig, cross_matrix, project_in_camera
from calib.dic.distortion import Array, Distortion
from calib.dic.plate_view import PlateView

INTRINSIC_NAMES = ("fx", "fy", "cx", "cy", "skew", "k1", "k2", "k3", "p1", "p2")
IntArray = npt.NDArray[np.int64]
N_INTRINSIC = len(INTRINSIC_NAMES)
FOCAL_LENGTHS = (True, True, *[False] * (N_INTRINSIC - 2))
FOCAL_RANGE = 5.0
"""factor by which a focal length may change in one fit"""
MOST_STEPS = 200
COARSE, FINE = 1e-5, 1e-9
"""relative change of the sum of squares that ends the earlier fits, and the last"""
N_POSE = 6
BEHIND = 1e6
"""px, residual of a point behind the camera: no step goes there"""
ROBUST = 3.0
"""SDs beyond which a residual counts less (Huber)"""
ROUNDS = 4
"""of the robust fit: each takes the noise and the centres of circles from the one before"""
MAD = 1.4826
"""of a normal distribution: SD over the median of the absolute values"""


@dataclass(frozen=True)
class LensModel:
    """Which parameters of a lens are fitted; the others stay 0."""

    radial: int = 2
    """how many of k1, k2, k3"""
    is_tangential: bool = False
    has_skew: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.radial <= 3:
            raise ValueError(f"radial: expected 0 to 3 coefficients, found {self.radial}")

    @property
    def is_free(self) -> npt.NDArray[np.bool_]:
        """(10,) in the order of INTRINSIC_NAMES."""
        radial = [number < self.radial for number in range(3)]
        return np.array([*[True] * 4, self.has_skew, *radial, *[self.is_tangential] * 2])


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


class Bundle(NamedTuple):
    """What the adjustment found."""

    rig: StereoRig
    """the left camera's frame is that of the rig"""
    poses: tuple[tuple[Array, Array], ...]
    residual: tuple[tuple[Array, Array], ...]
    """per pose, (n, 2) of the left and (n, 2) of the right image, px"""
    shift: tuple[Array, ...]
    """(n, 2) a view, left and right of each pose: what the shape of dots moves their centres, px"""
    sigma: dict[str, float]
    """standard deviation of each parameter: px, 1, degrees, mm"""
    noise: float
    """robust SD of one coordinate of a point, px"""
    n_far: int
    """coordinates beyond `ROBUST` SDs, which counted less"""
    plate_error: float
    """RMS deviation of a point of the plate from its place along one axis, as fitted, mm"""


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


def gather(pairs: tuple[Pair, ...], error: float) -> Plate:
    """The plate that views show; points of equal place are one."""
    views = [view for pair in pairs for view in pair]
    stacked = np.round(np.concatenate([view.places for view in views]), 6)
    places, inverse = np.unique(stacked, axis=0, return_inverse=True)
    cuts = np.cumsum([len(view.places) for view in views])[:-1]
    parts = np.split(inverse.ravel().astype(np.int64), cuts)
    index = tuple(zip(parts[::2], parts[1::2], strict=True))
    return Plate(np.column_stack([places, np.zeros(len(places))]), index, error)


def adjust(
    pairs: tuple[Pair, ...], guess: Guess, lens: LensModel, plate_error: float = 0.0
) -> Bundle:
    """Fit a rig to the views of a plate. Raises ValueError when the fit does not converge.

    With a `plate_error` (SD along each axis, mm) the places of the plate's points are fitted too,
    held by that error: it also fixes scale and pose of the plate.
    """
    plate = gather(pairs, plate_error)
    n_plate = plate.places.size if plate_error > 0.0 else 0
    full = np.concatenate([_pack(guess), np.zeros(n_plate)])
    n_rest = full.size - 2 * N_INTRINSIC
    noise = 1.0
    for number in range(ROUNDS):
        # focal lengths and poses first: with wrong points a far start leads distortion astray
        inner = lens.is_free if number > 0 else np.array(FOCAL_LENGTHS)
        free = np.concatenate([inner, inner, np.ones(n_rest, dtype=np.bool_)])
        tolerance = FINE if number == ROUNDS - 1 else COARSE
        full, off, jacobian = _fit(full, free, pairs, plate, noise, tolerance)
        n_view = off.size - n_plate
        lost = np.sqrt(n_view / max(n_view - np.count_nonzero(free) + n_plate / 2, 1.0))
        noise = max(lost * MAD * float(np.median(np.abs(off[:n_view]))), 1e-9)
    return _bundle(full, free, pairs, plate, off, jacobian, noise)


def _fit(
    full: Array,
    free: npt.NDArray[np.bool_],
    pairs: tuple[Pair, ...],
    plate: Plate,
    noise: float,
    tolerance: float,
) -> tuple[Array, Array, Array]:
    """One robust fit: all parameters, residuals in px and their derivative by the free ones."""
    shift = _circle_shifts(full, pairs)
    n_plate = plate.places.size if plate.error > 0.0 else 0
    first = full.size - n_plate
    stiffness = noise / plate.error if n_plate else 0.0
    low, high = np.full(full.size, -np.inf), np.full(full.size, np.inf)
    for focal in (0, 1, N_INTRINSIC, N_INTRINSIC + 1):
        low[focal], high[focal] = full[focal] / FOCAL_RANGE, full[focal] * FOCAL_RANGE

    def residual(x: Array) -> Array:
        now = _insert(full, free, x)
        off = _flat_residual(_residual(now, pairs, plate, shift))
        return np.concatenate([off, stiffness * now[first:]])

    def jacobian(x: Array) -> Array:
        views = _jacobian(_insert(full, free, x), pairs, plate)
        held = np.zeros((n_plate, full.size))
        held[:, first:] = stiffness * np.eye(n_plate)
        return np.vstack([views, held])[:, free]

    fit = least_squares(
        residual, full[free], jacobian, (low[free], high[free]), method="trf", loss="huber",
        f_scale=ROBUST * noise, x_scale="jac", max_nfev=MOST_STEPS, gtol=1e-10, xtol=1e-10,
        ftol=tolerance,
    )  # fmt: skip
    if not fit.success:
        raise ValueError(
            f"plates: no pair of cameras fits them after {fit.nfev} steps; images of one pose do "
            "not belong together"
        )
    return _insert(full, free, fit.x), residual(fit.x), jacobian(fit.x)


def _insert(full: Array, free: npt.NDArray[np.bool_], values: Array) -> Array:
    changed = full.copy()
    changed[free] = values
    return changed


def _pack(guess: Guess) -> Array:
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


def _intrinsics(values: Array) -> Intrinsics:
    k1, k2, k3, p1, p2 = (float(value) for value in values[5:])
    fx, fy, cx, cy, skew = (float(value) for value in values[:5])
    return Intrinsics(fx, fy, cx, cy, skew, Distortion((k1, k2, k3), (p1, p2)))


def _pose(full: Array, number: int) -> tuple[Array, Array]:
    """Rotation vector and translation; number 0 is the right camera, then the plates."""
    start = 2 * N_INTRINSIC + N_POSE * number
    return full[start : start + 3], full[start + 3 : start + 6]


def _points(full: Array, plate: Plate) -> Array:
    """(n_place, 3) of the plate, with their fitted deviations if there are any."""
    if plate.error == 0.0:
        return plate.places
    moved: Array = plate.places + full[full.size - plate.places.size :].reshape(-1, 3)
    return moved


def _flat_residual(parts: tuple[tuple[Array, Array], ...]) -> Array:
    flat = np.concatenate([off.ravel() for pair in parts for off in pair])
    return np.where(np.isfinite(flat), flat, BEHIND)


def _residual(
    full: Array, pairs: tuple[Pair, ...], plate: Plate, shifts: tuple[Array, ...]
) -> tuple[tuple[Array, Array], ...]:
    """Per pose (n, 2) of the left and of the right view: projection less what was found, px."""
    left, right = _intrinsics(full[:N_INTRINSIC]), _intrinsics(full[N_INTRINSIC : 2 * N_INTRINSIC])
    turn, move = _pose(full, 0)
    points = _points(full, plate)
    parts = []
    for number, (pair, (in_left, in_right)) in enumerate(zip(pairs, plate.shown, strict=True)):
        plate_turn, plate_move = _pose(full, number + 1)
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


def _jacobian(full: Array, pairs: tuple[Pair, ...], plate: Plate) -> Array:
    """(n_residual, n_parameter); zero blocks are kept, as the solver's factorisation is dense."""
    n = 2 * N_INTRINSIC
    lenses = _intrinsics(full[:N_INTRINSIC]), _intrinsics(full[N_INTRINSIC:n])
    turn, move = _pose(full, 0)
    relative = Rotation.from_rotvec(turn).as_matrix()
    points = _points(full, plate)
    rows = []
    for number in range(len(pairs)):
        vector, shift = _pose(full, number + 1)
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


def _circle_shifts(full: Array, pairs: tuple[Pair, ...]) -> tuple[Array, ...]:
    """(n, 2) a view: image of a dot's centre less centre of the dot's image, px, to be taken off.

    The residual is projection plus this shift less the centre found.
    """
    left, right = _intrinsics(full[:N_INTRINSIC]), _intrinsics(full[N_INTRINSIC : 2 * N_INTRINSIC])
    turn, move = _pose(full, 0)
    relative = Rotation.from_rotvec(turn).as_matrix()
    shifts = []
    for number, pair in enumerate(pairs):
        plate_turn, plate_move = _pose(full, number + 1)
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


def _bundle(
    full: Array,
    free: npt.NDArray[np.bool_],
    pairs: tuple[Pair, ...],
    plate: Plate,
    off: Array,
    jacobian: Array,
    noise: float,
) -> Bundle:
    left, right = _intrinsics(full[:N_INTRINSIC]), _intrinsics(full[N_INTRINSIC : 2 * N_INTRINSIC])
    turn, move = _pose(full, 0)
    far = np.abs(off) > ROBUST * noise
    weighted = jacobian[~far]
    # columns of very different size: scaled, the inverse keeps its digits
    scale = np.linalg.norm(weighted, axis=0)
    inverse = np.linalg.inv((weighted / scale).T @ (weighted / scale))
    covariance = noise**2 * inverse / np.outer(scale, scale)
    names = [f"{side}.{name}" for side in ("left", "right") for name in INTRINSIC_NAMES]
    names += [f"relative.{name}" for name in ("rx", "ry", "rz", "tx", "ty", "tz")]
    sigma = np.zeros(full.size)
    sigma[free] = np.sqrt(np.diag(covariance))
    start = 2 * N_INTRINSIC
    sigma[start : start + 3] = np.degrees(sigma[start : start + 3])
    rig = StereoRig(
        Camera(left), Camera(right, Rotation.from_rotvec(turn).as_matrix(), move.copy())
    )
    poses = tuple(
        (Rotation.from_rotvec(vector).as_matrix(), moved.copy())
        for vector, moved in (_pose(full, number + 1) for number in range(len(pairs)))
    )
    shift = _circle_shifts(full, pairs)
    residual = _residual(full, pairs, plate, shift)
    stated = dict(zip(names, sigma[: len(names)].tolist(), strict=True))
    off_plate = float(np.sqrt(np.mean((_points(full, plate) - plate.places) ** 2)))
    return Bundle(rig, poses, residual, shift, stated, noise, int(far.sum()), off_plate)
