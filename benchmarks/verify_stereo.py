"""Figures of stereo DIC: parts `plates`, `static`, `stereo` and `end_to_end` of `verify_dic`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from benchmarks.end_to_end import SLIDING, over_seeds
from calib.dic import CorrelationSettings, correlate, read_image
from calib.dic.bundle import LensModel
from calib.dic.calibration import Calibration, CalibrationSettings, calibrate
from calib.dic.calibration_files import read_calibration
from calib.dic.chessboard import Chessboard, chessboard_view
from calib.dic.dot_grid import DotPlate, dot_view
from calib.dic.plate_view import PlateView
from calib.dic.stereo import StereoSettings, follow_pair, place_reference
from calib.dic.surface_frame import surface_frame
from calib.virtual.cameras import CameraPair
from calib.virtual.render import render
from calib.virtual.sensor import Sensor, expose
from calib.virtual.speckle import SpeckleSettings, make_speckle
from calib.virtual.surface import make_surface
from fe.response import Array

PLATE_ERROR = 0.01
"""mm, of the real dot plate: its dots miss their places by 7 um, the same in all poses"""
BOARD_ERROR = 0.05
"""mm, of the chessboard with squares said to be of 10: its corners are off by 0.03"""
STATIC_STEP = 15
SEEDS = range(3)


def _dots(data: Path) -> tuple[list[PlateView], list[PlateView]]:
    folder = data / "stereo_calibration_dots"
    sides: tuple[list[PlateView], list[PlateView]] = ([], [])
    for number in (1, 3, 5, 7, 9, 11):
        for side in (0, 1):
            image = read_image(folder / f"CalB-sys2-{number:04d}_{side}.jpeg")
            sides[side].append(dot_view(image.grey, DotPlate(3.5, 5, 3), image.name))
    return sides


def _chessboards(data: Path) -> tuple[list[PlateView], list[PlateView]]:
    folder = data / "stereo_calibration_chessboard"
    sides: tuple[list[PlateView], list[PlateView]] = ([], [])
    for number in (1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 14):
        try:
            both = [
                chessboard_view(
                    read_image(folder / f"{side}{number:02d}.jpg").grey,
                    Chessboard(9, 6, 10.0),
                    side,
                )
                for side in ("left", "right")
            ]
        except ValueError:
            continue
        for side, view in zip(sides, both, strict=True):
            side.append(view)
    return sides


def _facts(found: Calibration) -> dict[str, Any]:
    rig = found.rig
    return {
        "rms_px": round(found.rms, 4),
        "left_right_px": [round(value, 4) for value in found.reprojection],
        "epipolar_px": round(found.epipolar, 4),
        "poses": found.n_poses,
        "points": found.n_points,
        "plate_error_um": round(1e3 * found.plate_error, 2),
        "fx_px": round(rig.left.intrinsics.fx, 1),
        "fx_sd_px": round(found.sigma["left.fx"], 1),
        "angle_deg": round(rig.angle, 3),
        "baseline_mm": round(rig.baseline, 3),
    }


def _by_opencv(
    left: list[PlateView], right: list[PlateView], size: tuple[int, int]
) -> dict[str, Any]:
    """The same views by OpenCV's stereo calibration, with which DICe calibrates too."""
    places, pixels = [], ([], [])
    for one, other in zip(left, right, strict=True):
        here = {tuple(np.round(place, 6)): k for k, place in enumerate(other.places)}
        both = [
            (k, here[key])
            for k, place in enumerate(one.places)
            if (key := tuple(np.round(place, 6))) in here
        ]
        i, j = np.array(both).T
        flat = np.column_stack([one.places[i], np.zeros(len(i))])
        places.append(flat.astype(np.float32))
        pixels[0].append(one.pixels[i].astype(np.float32))
        pixels[1].append(other.pixels[j].astype(np.float32))
    lenses = []
    for side in pixels:
        _, matrix, distortion, _, _ = cv2.calibrateCamera(
            places, side, size, None, None, flags=cv2.CALIB_FIX_K3
        )
        lenses += [matrix, distortion]
    rms, *_, turn, shift, _, _ = cv2.stereoCalibrate(
        places, *pixels, *lenses, size, flags=cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3
    )
    angle = float(np.degrees(np.arccos((np.trace(turn) - 1) / 2)))
    return {
        "rms_px": round(float(rms), 4),
        "angle_deg": round(angle, 3),
        "baseline_mm": round(float(np.linalg.norm(shift)), 3),
    }


def plates(data: Path) -> dict[str, Any]:
    """Reprojection of the real plates, as exact and as uneven ones, and by OpenCV."""
    dots, boards = _dots(data), _chessboards(data)
    large, small = (2448, 2048), (640, 480)
    lens, bent = LensModel(2), LensModel(2, True)
    fitted = calibrate(*dots, large, CalibrationSettings(lens, 6, PLATE_ERROR))
    return {
        "reprojection_px": round(fitted.rms, 4),
        "dots": _facts(fitted),
        "dots_exact_plate": _facts(calibrate(*dots, large, CalibrationSettings(lens, 6))),
        "dots_opencv": _by_opencv(*dots, large),
        "chessboard": _facts(
            calibrate(*boards, small, CalibrationSettings(bent, plate_error_mm=BOARD_ERROR))
        ),
        "chessboard_exact_board": _facts(calibrate(*boards, small, CalibrationSettings(bent))),
        "chessboard_opencv": _by_opencv(*boards, small),
    }


def _whole_shift(a: Array, b: Array) -> list[float]:
    """Shift (x, y) px from one image to another that has hardly moved, without any subset.

    By least squares of what all grey levels change against their slopes, with an offset of light.
    """
    a, b = (ndimage.gaussian_filter(image, 1.0) for image in (a, b))
    slope_y, slope_x = np.gradient(0.5 * (a + b))
    design = np.stack([slope_x.ravel(), slope_y.ravel(), np.ones(a.size)], axis=1)
    shift = np.linalg.lstsq(design, (a - b).ravel(), rcond=None)[0]
    return [round(float(value), 4) for value in shift[:2]]


def static(data: Path) -> dict[str, Any]:
    """The specimen at rest: what is measured is noise, and as large as stated.

    The calibration that comes with the images misses the epipolar lines by 17 px: their pose is
    found again, so that lengths are as good as the baseline of the file.
    """
    folder = data / "stereo_static_pair"
    images = [[read_image(folder / f"img_000{t}_{c}.tif").grey for c in (0, 1)] for t in (0, 1)]
    x, y = np.meshgrid(np.arange(160.0, 1101.0, STATIC_STEP), np.arange(300.0, 541.0, STATIC_STEP))
    points = np.column_stack([x.ravel(), y.ravel()])
    rig = read_calibration(folder / "cal_vic3d_project.xml").rig
    given = StereoSettings(max_epipolar=100.0, max_median_epipolar=100.0)
    before = place_reference(rig, images[0][0], images[0][1], points, given)
    settings = StereoSettings(refine_pose=True)
    reference = place_reference(rig, images[0][0], images[0][1], points, settings)
    found, _ = follow_pair(reference, images[1][0], images[1][1], settings)
    axes = surface_frame(reference.rig, reference.space.points)
    valid = found.valid
    moved = axes.vectors(found.displacement[valid])
    covariance = axes.rotation @ found.covariance[valid] @ axes.rotation.T
    stated = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    off = (moved - moved.mean(axis=0)) / stated
    box = (slice(300, 541), slice(160, 1101))
    shift = [_whole_shift(images[0][camera][box], images[1][camera][box]) for camera in (0, 1)]
    by_subsets = [
        np.nanmean(correlate(images[0][camera], images[1][camera], points).displacement, axis=0)
        for camera in (0, 1)
    ]
    return {
        "static_shift_px_whole_image": shift,
        "static_shift_px_subsets": np.round(by_subsets, 4).tolist(),
        "static_u_mm": round(float(moved[:, 0].std()), 5),
        "static_v_mm": round(float(moved[:, 1].std()), 5),
        "static_w_mm": round(float(moved[:, 2].std()), 5),
        "static_mean_mm": [round(float(value), 5) for value in moved.mean(axis=0)],
        "static_stated_mm": [round(float(value), 5) for value in np.median(stated, axis=0)],
        "static_standardised_sd": [round(float(value), 3) for value in off.std(axis=0)],
        "static_points": int(valid.sum()),
        "static_epipolar_px_given": round(float(np.median(np.abs(before.epipolar))), 2),
        "static_epipolar_px_refined": round(float(np.sqrt(np.nanmean(reference.epipolar**2))), 4),
    }


CASES = {
    "rigid": ((0.013, -0.021, 0.037), (0.0, 0.0)),
    "stretch": ((0.0, 0.0, 0.02), (0.01, -0.02)),
}


def accuracy() -> dict[str, Any]:
    """Rendered pairs, 1000 x 400 px: errors as shares of the field of view, and as stated."""
    cameras = CameraPair(rows=400)
    low, high = (-5.0, 0.0), (5.0, 2.5)
    speckle = make_speckle(low, high, SpeckleSettings(), np.random.default_rng(0))
    x, y = np.meshgrid(np.linspace(-5, 5, 101), np.linspace(0, 2.5, 26), indexing="ij")
    flat = np.stack([x, y, np.zeros_like(x)], axis=-1)
    pixels = np.stack(np.meshgrid(np.arange(90.0, 910.0, 10), np.arange(118.0, 282.0, 10)), axis=-1)
    points = pixels.reshape(-1, 2)
    settings = StereoSettings(CorrelationSettings())
    found: dict[str, list[Array]] = {name: [] for name in CASES}
    scores: list[Array] = []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)

        def shots(places: Array, rng: np.random.Generator = rng) -> tuple[list[Array], Array]:
            pictures = [
                render(make_surface(low, high, places), speckle, cameras, camera)
                for camera in (cameras.rig.left, cameras.rig.right)
            ]
            images = [expose(one.brightness, Sensor(), rng).astype(float) for one in pictures]
            return images, pictures[0].material

        rest, material = shots(flat)
        here = material[points[:, 1].astype(int), points[:, 0].astype(int)]
        reference = place_reference(cameras.rig, rest[0], rest[1], points, settings)
        for name, (move, stretch) in CASES.items():
            places = flat * np.array([1.0 + stretch[0], 1.0 + stretch[1], 1.0]) + np.array(move)
            images, _ = shots(places)
            frame, _ = follow_pair(reference, images[0], images[1], settings)
            truth = make_surface(low, high, places).at(here) - make_surface(low, high, flat).at(
                here
            )
            good = frame.valid & np.isfinite(here).all(axis=1)
            found[name].append((frame.displacement - truth)[good])
            scores.append(((frame.displacement - truth) / frame.sigma)[good])
    view = cameras.field_of_view
    standard = np.concatenate(scores)
    result: dict[str, Any] = {
        "field_of_view_mm": round(view, 3),
        "stereo_angle_deg": round(cameras.rig.angle, 2),
        "stereo_sigma_calibration": round(float(standard.std()), 3),
        "stereo_coverage_95": round(float(np.mean(np.abs(standard) < 1.96)), 3),
    }
    for name, errors in found.items():
        rms = np.sqrt((np.concatenate(errors) ** 2).mean(axis=0))
        result[f"{name}_rms_um"] = [round(float(1e3 * value), 4) for value in rms]
        result[f"{name}_view_over_rms"] = [round(float(view / value)) for value in rms]
    return result


def end_to_end(runs: Path, n: int = 20) -> dict[str, Any]:
    """Truths inside the region of 95 % of posteriors from photographs."""
    found = over_seeds(SLIDING, range(n), runs)
    return {"end_to_end_covered": sum(one.is_covered for one in found), "end_to_end_seeds": n}
