"""Calibration of two cameras from plates: synthetic views with known cameras."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.dic.bundle import LensModel
from calib.dic.bundle_residual import (
    Pair,
    circle_shift,
    circle_shifts,
    flat_residual,
    gather,
    jacobian_of,
    pack,
    residual_of,
    rotate,
)
from calib.dic.calibration import CalibrationSettings, calibrate, first_guess, shared
from calib.dic.camera import Camera, Intrinsics, StereoRig, project, project_in_camera
from calib.dic.distortion import Distortion
from calib.dic.plate_view import PlateView, fit_homography, map_plane
from calib.dic.scale_error import scale_sd
from calib.dic.triangulate import triangulate

SIZE = (1000, 800)
RIG = StereoRig(
    Camera(Intrinsics(2100.0, 2110.0, 520.0, 395.0, 0.0, Distortion((-0.15, 0.3, 0.0)))),
    Camera(
        Intrinsics(2080.0, 2075.0, 490.0, 410.0, 0.0, Distortion((-0.12, 0.2, 0.0))),
        Rotation.from_euler("xyz", [1.0, -25.0, 0.5], degrees=True).as_matrix(),
        np.array([130.0, 2.0, 30.0]),
    ),
)


def poses(n, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(n):
        turn = Rotation.from_euler("xyz", rng.uniform((-25, -37, -25), (25, 13, 25)), degrees=True)
        yield turn.as_matrix(), np.array([-32.0, -22.0, 300.0]) + rng.uniform(-4, 4, 3)


def views(n, noise=0.02, seed=0, radius=0.0, plate_error=0.0, missing=0.0):
    """Two lists of views of a plate of 9 x 7 points, 8 mm apart."""
    rng = np.random.default_rng(seed + 100)
    x, y = np.meshgrid(np.arange(9) * 8.0, np.arange(7) * 8.0)
    places = np.column_stack([x.ravel(), y.ravel()])
    true = np.column_stack([places, np.zeros(len(places))])
    true = true + plate_error * rng.standard_normal(true.shape)
    lists = [], []
    for number, (turn, move) in enumerate(poses(n, seed)):
        for side, camera in enumerate((RIG.left, RIG.right)):
            own = camera.rotation @ turn, camera.rotation @ move + camera.translation
            pixels = project(camera, true @ turn.T + move)[0]
            view = PlateView(f"{side}{number}", places, pixels, radius)
            pixels = pixels + circle_shift(camera.intrinsics, *own, view)
            pixels = pixels + noise * rng.standard_normal(pixels.shape)
            kept = rng.random(len(pixels)) >= missing
            lists[side].append(PlateView(view.name, places[kept], pixels[kept], radius))
    return lists


def test_rotation_and_its_derivative():
    points = np.random.default_rng(0).standard_normal((6, 3))
    for vector in (np.array([0.3, -1.2, 0.7]), np.array([1e-6, 2e-6, -1e-6]), np.zeros(3)):
        found, by = rotate(vector, points)
        assert np.abs(found - Rotation.from_rotvec(vector).apply(points)).max() < 1e-14
        for k in range(3):
            step = 1e-6 * np.eye(3)[k]
            ends = rotate(vector + step, points)[0] - rotate(vector - step, points)[0]
            assert np.abs(by[..., k] - ends / 2e-6).max() < 1e-8


@pytest.mark.parametrize("plate_error", [0.0, 0.01])
def test_the_jacobian_of_the_bundle_is_a_difference(plate_error):
    pairs = tuple(Pair(*two) for two in zip(*views(3, missing=0.1), strict=True))
    plate = gather(pairs, plate_error)
    full = pack(first_guess(pairs, SIZE))
    full[[5, 6, 8, 9, 15]] = -0.1, 0.2, 1e-3, -2e-3, 0.05
    if plate_error:
        full = np.append(full, 0.01 * np.random.default_rng(1).standard_normal(plate.places.size))
    shifts = circle_shifts(full, pairs)
    exact = jacobian_of(full, pairs, plate)
    rng = np.random.default_rng(2)
    for _ in range(6):
        direction = rng.standard_normal(full.size) * np.maximum(np.abs(full), 1e-3) * 1e-6
        ends = [
            flat_residual(residual_of(full + sign * direction, pairs, plate, shifts))
            for sign in (1, -1)
        ]
        assert exact @ direction == pytest.approx((ends[0] - ends[1]) / 2, rel=1e-5, abs=1e-9)


def test_the_centre_of_a_dots_image_is_where_its_outline_says():
    turn = Rotation.from_euler("xyz", [20, 40, 5], degrees=True).as_matrix()
    move = np.array([0.0, 0.0, 60.0])
    lens = Intrinsics(2000.0, 2000.0, 500.0, 400.0)
    view = PlateView("", np.random.default_rng(1).uniform(-8, 8, (9, 2)), np.zeros((9, 2)), 1.0)
    shift = circle_shift(lens, turn, move, view)
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    for place, found in zip(view.places, shift, strict=True):
        rim = place + np.column_stack([np.cos(angle), np.sin(angle)])
        rim = np.column_stack([rim, np.zeros(len(rim))]) @ turn.T + move
        outline = project_in_camera(lens, rim).pixels
        middle = project_in_camera(lens, (np.append(place, 0.0) @ turn.T + move)[None]).pixels[0]
        a, b = outline, np.roll(outline, -1, axis=0)
        cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
        centroid = ((a + b) * cross[:, None]).sum(axis=0) / (3 * cross.sum())
        assert found == pytest.approx(centroid - middle, abs=2e-4)
    assert np.abs(shift).max() > 0.1


def test_exact_views_give_the_cameras_back():
    found = calibrate(*views(8, noise=0.0, radius=1.5), SIZE)
    left, right = found.rig.left.intrinsics, found.rig.right.intrinsics
    assert found.rms < 1e-6 and found.epipolar < 1e-6
    for side, true in ((left, RIG.left.intrinsics), (right, RIG.right.intrinsics)):
        assert (side.fx, side.fy, side.cx, side.cy) == pytest.approx(
            (true.fx, true.fy, true.cx, true.cy), rel=1e-7
        )
        assert side.distortion.radial == pytest.approx(true.distortion.radial, abs=1e-4)
    assert found.rig.right.translation == pytest.approx(RIG.right.translation, abs=1e-4)


def test_ignoring_the_shape_of_dots_shifts_the_calibration():
    left, right = views(4, noise=0.0, radius=3.0)
    few = CalibrationSettings(least_poses=4)
    dots = calibrate(left, right, SIZE, few)
    plain = [[PlateView(v.name, v.places, v.pixels) for v in side] for side in (left, right)]
    assert dots.rms < 1e-5 < 1e-3 < calibrate(*plain, SIZE, few).rms


@pytest.mark.slow  # many fits
def test_stated_uncertainty_of_the_parameters_is_that_of_repeats():
    # (found - true) / stated over 6 calibrations and 11 parameters
    scores = []
    for seed in range(6):
        found = calibrate(*views(8, noise=0.05, seed=seed, missing=0.05), SIZE)
        for side, camera in (("left", found.rig.left), ("right", found.rig.right)):
            true = getattr(RIG, side).intrinsics
            for name in ("fx", "fy", "cx", "cy"):
                off = getattr(camera.intrinsics, name) - getattr(true, name)
                scores.append(off / found.sigma[f"{side}.{name}"])
        shift = found.rig.right.translation - RIG.right.translation
        scores += [shift[k] / found.sigma[f"relative.t{axis}"] for k, axis in enumerate("xyz")]
        assert found.noise == pytest.approx(0.05, rel=0.1)
        assert found.rms == pytest.approx(0.05 * np.sqrt(2), rel=0.1)
    # 66 scores, correlated within a calibration: the SD of their RMS is about 0.15
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5


def seen_points():
    """Points in the view of both cameras, mm, and their pixels."""
    x, y = np.meshgrid(np.linspace(-20, 20, 7), np.linspace(-15, 15, 5))
    points = np.column_stack([x.ravel(), y.ravel(), 300.0 + 0.2 * x.ravel()])
    return points, project(RIG.left, points)[0], project(RIG.right, points)[0]


def test_an_error_of_the_baseline_scales_all_lengths_by_its_share():
    covariance = np.zeros((26, 26))
    shift = RIG.relative[1]
    covariance[23:, 23:] = 0.003**2 * np.outer(shift, shift)
    _, left, right = seen_points()
    left[3] = np.nan
    assert scale_sd(RIG, covariance, left, right) == pytest.approx(0.003, rel=1e-4)
    with pytest.raises(ValueError, match="found 2 points in both cameras, expected 3 or more"):
        scale_sd(RIG, covariance, left[:2], right[:2])


@pytest.mark.slow  # many fits
def test_the_stated_error_of_the_scale_is_that_of_repeats():
    points, left, right = seen_points()
    size = np.linalg.norm(points - points.mean(axis=0))
    off, stated = [], []
    for seed in range(16):
        found = calibrate(*views(8, noise=0.05, seed=seed), SIZE)
        places = triangulate(found.rig, left, right).points
        off.append(np.log(np.linalg.norm(places - places.mean(axis=0)) / size))
        stated.append(scale_sd(found.rig, found.covariance, left, right))
    # an SD of 16 repeats is known to 18 %
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(np.mean(stated), rel=0.45)


@pytest.mark.lasting
def test_a_badly_printed_plate_is_found_to_be_one():
    bad = views(8, noise=0.02, plate_error=0.02)
    exact = calibrate(*bad, SIZE)
    fitted = calibrate(*bad, SIZE, CalibrationSettings(plate_error_mm=0.02))
    assert exact.rms > 0.1 and fitted.rms < 0.035
    assert fitted.plate_error == pytest.approx(0.02, rel=0.25)
    true = RIG.left.intrinsics.fx
    assert abs(fitted.rig.left.intrinsics.fx - true) < 4 * fitted.sigma["left.fx"]


def test_wrong_points_count_less():
    left, right = views(8)
    for view in left[:4]:
        view.pixels[:3] += 5.0
    found = calibrate(left, right, SIZE)
    assert found.n_far >= 12
    assert abs(found.rig.left.intrinsics.fx - 2100.0) < 5 * found.sigma["left.fx"]


def test_too_few_poses_are_refused_unless_they_are_wanted():
    six = views(6)
    with pytest.raises(ValueError, match="found 6 poses, expected 8 or more"):
        calibrate(*six, SIZE)
    assert calibrate(*six, SIZE, CalibrationSettings(least_poses=6)).n_poses == 6


@pytest.mark.lasting
def test_images_of_other_poses_are_refused():
    left, right = views(4)
    with pytest.raises(ValueError, match="do not belong together"):
        calibrate(left, right[::-1], SIZE, CalibrationSettings(least_poses=4))
    with pytest.raises(ValueError, match="as many images"):
        calibrate(left, right[:-1], SIZE)


def test_plates_all_parallel_to_the_sensor_give_no_focal_length():
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    places = np.column_stack([x.ravel(), y.ravel()])
    flat = [PlateView("a", places, 90.0 * places + shift) for shift in range(8)]
    with pytest.raises(ValueError, match="no focal length"):
        calibrate(flat, flat, SIZE)


def test_a_homography_is_that_of_opencv_and_exact_for_exact_points():
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 60, (40, 2))
    matrix = np.array([[9.0, 0.3, 100.0], [-0.2, 8.5, 50.0], [1e-3, 2e-3, 1.0]])
    pixels = map_plane(matrix, places)
    assert fit_homography(places, pixels) == pytest.approx(matrix, rel=1e-9)
    noisy = pixels + 0.05 * rng.standard_normal(pixels.shape)
    peer = cv2.findHomography(places, noisy)[0]
    off = map_plane(fit_homography(places, noisy), places) - map_plane(peer, places)
    assert np.abs(off).max() < 0.02


def test_points_both_cameras_see_are_paired_by_their_place():
    left, right = views(3, noise=0.0, missing=0.3)
    pair = Pair(left[0], right[0])
    a, b = shared(pair)
    assert len(a) == len(b) < len(left[0].places)
    with pytest.raises(ValueError, match="expected 8 or more"):
        few = PlateView("r", pair.right.places[:8] + 1.0, pair.right.pixels[:8])
        shared(Pair(pair.left, few))


def test_impossible_settings_are_refused():
    with pytest.raises(ValueError, match="least_poses"):
        CalibrationSettings(least_poses=2)
    with pytest.raises(ValueError, match="plate_error_mm"):
        CalibrationSettings(plate_error_mm=-1.0)
    with pytest.raises(ValueError, match="radial"):
        LensModel(radial=4)
