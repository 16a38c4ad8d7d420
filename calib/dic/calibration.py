"""Calibration of a stereo rig from images of a plate: first guess, fit, checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from calib.dic.bundle import Bundle, LensModel, adjust
from calib.dic.bundle_residual import Guess, Pair
from calib.dic.camera import Camera, Intrinsics, StereoRig, epipolar_distance
from calib.dic.distortion import Array
from calib.dic.plate_view import PlateView, fit_homography

LEAST_POSES = 8
"""the thesis, section 2.6.4: a plate is photographed in at least eight orientations"""
LEAST_SHARED = 8
SWAPPED = 5.0
"""px: a fit that misses the plates by more does not belong to these cameras"""


@dataclass(frozen=True)
class CalibrationSettings:
    """How to calibrate. Raises ValueError for impossible numbers."""

    lens: LensModel = field(default_factory=LensModel)
    least_poses: int = LEAST_POSES
    """fewer are refused; 3 is the least that a plane allows"""
    plate_error_mm: float = 0.0
    """SD of a point of the plate about its place along each axis, mm; with 0 the plate is exact,
    otherwise its points are fitted too"""

    def __post_init__(self) -> None:
        if self.least_poses < 3:
            raise ValueError(f"least_poses: expected 3 or more, found {self.least_poses}")
        if not 0.0 <= self.plate_error_mm < np.inf:
            raise ValueError(f"plate_error_mm: expected 0 or more, found {self.plate_error_mm}")


@dataclass(frozen=True)
class Calibration:
    """A rig, how well it fits and how well it is known."""

    rig: StereoRig
    """in the left camera's frame"""
    size: tuple[int, int]
    """columns, rows of the images, px"""
    sigma: dict[str, float] = field(default_factory=dict)
    """SD of the parameters (px, 1, degrees, mm); empty for a calibration of another program"""
    reprojection: tuple[float, float] = (np.nan, np.nan)
    """RMS distance of points and projections in the left and the right images, px"""
    per_pose: tuple[tuple[str, float, float], ...] = ()
    """name, left and right RMS distance, px"""
    epipolar: float = np.nan
    """RMS distance of the plate's points from the epipolar lines, px"""
    noise: float = np.nan
    """robust SD of one coordinate of a point, px"""
    n_poses: int = 0
    n_points: int = 0
    n_far: int = 0
    """coordinates beyond three SDs, which counted less"""
    plate_error: float = 0.0
    """RMS deviation of the plate's points along one axis as fitted, mm"""
    covariance: Array | None = None
    """(26, 26) of the rig's parameters: see `Bundle.covariance`; None where it is not known"""

    @property
    def rms(self) -> float:
        """RMS distance over both cameras, px."""
        return float(np.sqrt(np.mean(np.square(self.reprojection))))


def calibrate(
    left: Sequence[PlateView],
    right: Sequence[PlateView],
    size: tuple[int, int],
    settings: CalibrationSettings | None = None,
) -> Calibration:
    """Calibrate a rig from views of one plate, the same pose in left[i] and right[i].

    Raises ValueError for too few poses, and when no pair of cameras fits the views.
    """
    settings = settings or CalibrationSettings()
    if len(left) != len(right):
        raise ValueError(
            f"left, right: expected as many images of each camera, found {len(left)}, {len(right)}"
        )
    if len(left) < settings.least_poses:
        raise ValueError(
            f"plates: found {len(left)} poses, expected {settings.least_poses} or more "
            "(least_poses in the settings allows fewer)"
        )
    pairs = tuple(Pair(*views) for views in zip(left, right, strict=True))
    bundle = adjust(pairs, first_guess(pairs, size), settings.lens, settings.plate_error_mm)
    calibration = _result(pairs, bundle, size)
    if calibration.rms > SWAPPED:
        raise ValueError(
            f"plates: the best fit misses them by {calibration.rms:.1f} px RMS, expected below "
            f"{SWAPPED:g}; images of one pose do not belong together"
        )
    return calibration


def first_guess(pairs: tuple[Pair, ...], size: tuple[int, int]) -> Guess:
    """Square pixels, the principal point in the middle, no distortion (Zhang 2000, section 3.1)."""
    cameras, poses = [], []
    for views in ([pair.left for pair in pairs], [pair.right for pair in pairs]):
        maps = [fit_homography(view.places, view.pixels) for view in views]
        intrinsics = _focal_length(maps, size)
        cameras.append(intrinsics)
        poses.append([_pose(intrinsics, homography) for homography in maps])
    turns = [b[0] @ a[0].T for a, b in zip(*poses, strict=True)]
    turn = Rotation.from_matrix(np.array(turns)).mean().as_matrix()
    shifts = [b[1] - turn @ a[1] for a, b in zip(*poses, strict=True)]
    rig = StereoRig(Camera(cameras[0]), Camera(cameras[1], turn, np.median(shifts, axis=0)))
    return Guess(rig, tuple(poses[0]))


def _focal_length(maps: list[Array], size: tuple[int, int]) -> Intrinsics:
    cx, cy = 0.5 * (size[0] - 1), 0.5 * (size[1] - 1)
    rows, right = [], []
    for homography in maps:
        h = np.array([[1.0, 0.0, -cx], [0.0, 1.0, -cy], [0.0, 0.0, 1.0]]) @ homography
        h = h / np.linalg.norm(h[:2, :2])
        a, b = h[:, 0], h[:, 1]
        # the plate's axes are at right angles and equally long: w = 1 / f^2
        rows += [a[0] * b[0] + a[1] * b[1], a[0] ** 2 + a[1] ** 2 - b[0] ** 2 - b[1] ** 2]
        right += [-a[2] * b[2], b[2] ** 2 - a[2] ** 2]
    w = float(np.dot(rows, right) / np.dot(rows, rows))
    if not w > 0.0:
        raise ValueError(
            "plates: their perspective gives no focal length; expected poses turned by 10 degrees "
            "and more about both axes"
        )
    return Intrinsics(w**-0.5, w**-0.5, cx, cy)


def _pose(intrinsics: Intrinsics, homography: Array) -> tuple[Array, Array]:
    columns = np.linalg.solve(intrinsics.matrix, homography)
    scale = 2.0 / (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1]))
    if columns[2, 2] < 0.0:
        scale = -scale
    first, second, shift = (scale * columns).T
    u, _, vt = np.linalg.svd(np.column_stack([first, second, np.cross(first, second)]))
    turn: Array = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return turn, shift


def shared(pair: Pair) -> tuple[Array, Array]:
    """Pixels (n, 2), (n, 2) of the points of a plate that both cameras see."""
    number = {tuple(np.round(place, 6)): i for i, place in enumerate(pair.left.places)}
    both = [
        (number[key], j)
        for j, place in enumerate(pair.right.places)
        if (key := tuple(np.round(place, 6))) in number
    ]
    if len(both) < LEAST_SHARED:
        raise ValueError(
            f"{pair.left.name}, {pair.right.name}: found {len(both)} points of the plate in both, "
            f"expected {LEAST_SHARED} or more"
        )
    i, j = np.array(both).T
    return pair.left.pixels[i], pair.right.pixels[j]


def _rms(off: Array) -> float:
    """Of distances: both coordinates count."""
    return float(np.sqrt(np.mean(np.sum(off**2, axis=-1))))


def _result(pairs: tuple[Pair, ...], bundle: Bundle, size: tuple[int, int]) -> Calibration:
    both = [
        shared(
            Pair(
                replace(pair.left, pixels=pair.left.pixels - bundle.shift[2 * number]),
                replace(pair.right, pixels=pair.right.pixels - bundle.shift[2 * number + 1]),
            )
        )
        for number, pair in enumerate(pairs)
    ]
    left, right = (np.concatenate(part) for part in zip(*both, strict=True))
    all_left, all_right = (np.concatenate(part) for part in zip(*bundle.residual, strict=True))
    per_pose = tuple(
        (pair.left.name, _rms(off[0]), _rms(off[1]))
        for pair, off in zip(pairs, bundle.residual, strict=True)
    )
    return Calibration(
        rig=bundle.rig,
        size=size,
        sigma=bundle.sigma,
        reprojection=(_rms(all_left), _rms(all_right)),
        per_pose=per_pose,
        epipolar=float(np.sqrt(np.mean(epipolar_distance(bundle.rig, left, right) ** 2))),
        noise=bundle.noise,
        n_poses=len(pairs),
        n_points=len(all_left) + len(all_right),
        n_far=bundle.n_far,
        plate_error=bundle.plate_error,
        covariance=bundle.covariance,
    )
