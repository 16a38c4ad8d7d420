"""Cameras: projection, distortion, epipolar geometry and triangulation."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calib.dic.camera import (
    Camera,
    Intrinsics,
    StereoRig,
    epipolar_distance,
    fundamental_matrix,
    ideal_pixels,
    project,
    project_in_camera,
)
from calib.dic.distortion import Distortion, distort, undistort
from calib.dic.triangulate import triangulate

LENS = Distortion((-0.25, 0.12, -0.03), (0.002, -0.001))
LEFT = Intrinsics(2100.0, 2090.0, 510.0, 390.0, 0.4, LENS)
RIGHT = Intrinsics(2050.0, 2060.0, 495.0, 405.0, 0.0, Distortion((0.1, 0.0, 0.0)))


def rig() -> StereoRig:
    turn = cv2.Rodrigues(np.array([0.02, -0.4, 0.05]))[0]
    return StereoRig(Camera(LEFT), Camera(RIGHT, turn, np.array([120.0, 3.0, 25.0])))


def cloud(n=200, seed=0):
    rng = np.random.default_rng(seed)
    return np.array([0.0, 0.0, 300.0]) + rng.uniform(-1, 1, (n, 3)) * (40.0, 30.0, 20.0)


def test_pixels_are_those_of_opencv():
    points = cloud()
    turn, move = np.array([0.1, -0.2, 0.05]), np.array([3.0, -2.0, 10.0])
    lens = Intrinsics(2100.0, 2090.0, 510.0, 390.0, 0.0, LENS)
    k1, k2, k3, p1, p2 = LENS.coefficients
    expected = cv2.projectPoints(points, turn, move, lens.matrix, np.array([k1, k2, p1, p2, k3]))[0]
    camera = Camera(lens, cv2.Rodrigues(turn)[0], move)
    assert np.abs(project(camera, points)[0] - expected[:, 0]).max() < 1e-9


@pytest.mark.parametrize("powers", [(2, 4, 6), (1, 2, 3), (0, 1, 2)])
def test_derivatives_of_distortion_are_differences(powers):
    lens = Distortion((-0.2, 0.1, 0.05), (0.003, -0.002), powers)
    points = np.random.default_rng(1).uniform(-0.3, 0.3, (50, 2))
    found, step = distort(lens, points), 1e-6
    for k in range(2):
        by = np.eye(2)[k] * step
        difference = distort(lens, points + by).points - distort(lens, points - by).points
        assert np.abs(found.by_point[..., k] - difference / (2 * step)).max() < 1e-8
    for k in range(5):
        more, less = ((lens.coefficients + sign * step * np.eye(5)[k]) for sign in (1, -1))
        ends = [
            distort(Distortion(tuple(c[:3]), tuple(c[3:]), powers), points).points
            for c in (more, less)
        ]
        assert np.abs(found.by_coefficient[..., k] - (ends[0] - ends[1]) / (2 * step)).max() < 1e-8


def test_undistortion_is_the_inverse_and_says_where_there_is_none():
    points = np.random.default_rng(2).uniform(-0.3, 0.3, (200, 2))
    assert np.abs(undistort(LENS, distort(LENS, points).points) - points).max() < 1e-13
    # 0.7 r^3 turns the image inside out beyond r = 0.69: nothing is shown at a radius of 1
    folding = Distortion((-0.7, 0.0, 0.0))
    assert np.isnan(undistort(folding, np.array([[1.0, 0.0]]))).all()


def test_derivatives_of_projection_are_differences():
    points, step = cloud(20), 1e-5
    found = project_in_camera(LEFT, points)
    for k in range(3):
        by = np.eye(3)[k] * step
        ends = [project_in_camera(LEFT, points + sign * by).pixels for sign in (1, -1)]
        assert np.abs(found.by_point[..., k] - (ends[0] - ends[1]) / (2 * step)).max() < 1e-6


def test_pairs_of_one_point_lie_on_their_epipolar_lines():
    pair, points = rig(), cloud()
    left, right = project(pair.left, points)[0], project(pair.right, points)[0]
    matrix = fundamental_matrix(pair)
    one = np.ones((len(points), 1))
    a = np.hstack([ideal_pixels(LEFT, left), one])
    b = np.hstack([ideal_pixels(RIGHT, right), one])
    assert np.abs(np.einsum("ni,ij,nj->n", b, matrix, a)).max() < 1e-8 * np.abs(matrix).max() * 1e6
    assert np.abs(epipolar_distance(pair, left, right)).max() < 1e-8


def test_epipolar_distance_is_the_shift_across_the_line_shared_by_both_images():
    # a shift d of one image across its line can be undone by d / root 2 in both together
    pair, points = rig(), cloud()
    left, right = project(pair.left, points)[0], project(pair.right, points)[0]
    off = epipolar_distance(pair, left, right + np.array([0.0, 0.1]))
    assert np.abs(off).mean() == pytest.approx(0.1 / np.sqrt(2), rel=0.1)


def test_triangulation_finds_the_points_and_its_derivative_is_a_difference():
    pair, points = rig(), cloud()
    left, right = project(pair.left, points)[0], project(pair.right, points)[0]
    found = triangulate(pair, left, right)
    assert np.abs(found.points - points).max() < 1e-9
    step = 1e-3
    for k in range(4):
        by = np.eye(4)[k] * step
        ends = [
            triangulate(pair, left + sign * by[:2], right + sign * by[2:]).points
            for sign in (1, -1)
        ]
        difference = (ends[0] - ends[1]) / (2 * step)
        assert np.abs(found.by_pixels[..., k] - difference).max() < 1e-4 * np.abs(difference).max()


def test_stated_covariance_is_that_of_repeats():
    pair = rig()
    point = np.array([[10.0, -5.0, 310.0]])
    n, sigma = 20_000, np.array([0.02, 0.03, 0.05, 0.01])
    noise = np.random.default_rng(5).standard_normal((n, 4)) * sigma
    left, right = project(pair.left, point)[0], project(pair.right, point)[0]
    found = triangulate(pair, left + noise[:, :2], right + noise[:, 2:]).points
    stated = triangulate(pair, left, right).covariance(np.diag(sigma**2)[None])[0]
    sample = np.cov(found.T)
    scale = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
    # the SD of an entry of a sample covariance is 1 / sqrt(n) or a little more
    assert np.abs((sample - stated) / scale).max() < 5 * np.sqrt(2 / n)


def test_points_behind_the_cameras_are_no_points():
    pair = rig()
    left, right = project(pair.left, cloud(5))[0], project(pair.right, cloud(5))[0]
    assert np.isnan(triangulate(pair, left, right - np.array([1500.0, 0.0])).points).all()
    assert np.isnan(project(pair.left, np.array([[0.0, 0.0, -10.0]]))[0]).all()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Camera(LEFT, 2 * np.eye(3)), "orthogonal"),
        (lambda: Camera(LEFT, np.diag([1.0, 1.0, -1.0])), "orthogonal"),
        (lambda: Intrinsics(-1.0, 1.0, 0.0, 0.0), "above 0"),
        (lambda: Distortion((np.nan, 0.0, 0.0)), "finite"),
        (lambda: triangulate(rig(), np.zeros((2, 2)), np.zeros((3, 2))), "equal shapes"),
    ],
)
def test_impossible_input_is_refused_in_one_sentence(make, words):
    with pytest.raises(ValueError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)
