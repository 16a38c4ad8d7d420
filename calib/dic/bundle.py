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

from calib.dic.bundle_residual import (
    INTRINSIC_NAMES,
    N_INTRINSIC,
    Guess,
    Pair,
    Plate,
    circle_shifts,
    flat_residual,
    gather,
    intrinsics_at,
    jacobian_of,
    pack,
    points_at,
    pose_at,
    residual_of,
)
from calib.dic.camera import Camera, StereoRig
from calib.dic.distortion import Array

FOCAL_LENGTHS = (True, True, *[False] * (N_INTRINSIC - 2))
FOCAL_RANGE = 5.0
"""factor by which a focal length may change in one fit"""
MOST_STEPS = 200
COARSE, FINE = 1e-5, 1e-9
"""relative change of the sum of squares that ends the earlier fits, and the last"""
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
    covariance: Array
    """(26, 26) of the rig: intrinsics of left and right, then rotation vector [rad] and translation
    [mm] of the right camera; zero where a parameter is fixed"""


def adjust(
    pairs: tuple[Pair, ...], guess: Guess, lens: LensModel, plate_error: float = 0.0
) -> Bundle:
    """Fit a rig to the views of a plate. Raises ValueError when the fit does not converge.

    With a `plate_error` (SD along each axis, mm) the places of the plate's points are fitted too,
    held by that error: it also fixes scale and pose of the plate.
    """
    plate = gather(pairs, plate_error)
    n_plate = plate.places.size if plate_error > 0.0 else 0
    full = np.concatenate([pack(guess), np.zeros(n_plate)])
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
    shift = circle_shifts(full, pairs)
    n_plate = plate.places.size if plate.error > 0.0 else 0
    first = full.size - n_plate
    stiffness = noise / plate.error if n_plate else 0.0
    low, high = np.full(full.size, -np.inf), np.full(full.size, np.inf)
    for focal in (0, 1, N_INTRINSIC, N_INTRINSIC + 1):
        low[focal], high[focal] = full[focal] / FOCAL_RANGE, full[focal] * FOCAL_RANGE

    def residual(x: Array) -> Array:
        now = _insert(full, free, x)
        off = flat_residual(residual_of(now, pairs, plate, shift))
        return np.concatenate([off, stiffness * now[first:]])

    def jacobian(x: Array) -> Array:
        views = jacobian_of(_insert(full, free, x), pairs, plate)
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


def _bundle(
    full: Array,
    free: npt.NDArray[np.bool_],
    pairs: tuple[Pair, ...],
    plate: Plate,
    off: Array,
    jacobian: Array,
    noise: float,
) -> Bundle:
    """What was found, with the covariance of the linearised problem."""
    left, right = (
        intrinsics_at(full[:N_INTRINSIC]),
        intrinsics_at(full[N_INTRINSIC : 2 * N_INTRINSIC]),
    )
    turn, move = pose_at(full, 0)
    far = np.abs(off) > ROBUST * noise
    weighted = jacobian[~far]
    # columns of very different size: scaled, the inverse keeps its digits
    scale = np.linalg.norm(weighted, axis=0)
    inverse = np.linalg.inv((weighted / scale).T @ (weighted / scale))
    covariance = noise**2 * inverse / np.outer(scale, scale)
    names = [f"{side}.{name}" for side in ("left", "right") for name in INTRINSIC_NAMES]
    names += [f"relative.{name}" for name in ("rx", "ry", "rz", "tx", "ty", "tz")]
    whole = np.zeros((full.size, full.size))
    whole[np.ix_(free, free)] = covariance
    sigma = np.zeros(full.size)
    sigma[free] = np.sqrt(np.diag(covariance))
    start = 2 * N_INTRINSIC
    sigma[start : start + 3] = np.degrees(sigma[start : start + 3])
    rig = StereoRig(
        Camera(left), Camera(right, Rotation.from_rotvec(turn).as_matrix(), move.copy())
    )
    poses = tuple(
        (Rotation.from_rotvec(vector).as_matrix(), moved.copy())
        for vector, moved in (pose_at(full, number + 1) for number in range(len(pairs)))
    )
    shift = circle_shifts(full, pairs)
    residual = residual_of(full, pairs, plate, shift)
    stated = dict(zip(names, sigma[: len(names)].tolist(), strict=True))
    off_plate = float(np.sqrt(np.mean((points_at(full, plate) - plate.places) ** 2)))
    n = len(names)
    return Bundle(
        rig, poses, residual, shift, stated, noise, int(far.sum()), off_plate, whole[:n, :n].copy()
    )
