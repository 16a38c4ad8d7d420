"""Stereo correlation on rendered pairs, whose truth is known to the last digit."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, shift
from skimage import io
from stereo_scenes import CAMERAS, STEREO, face, points_on, shoot, still, turned

from calib.cli import main
from calib.data.readers import read_dic
from calib.dic import GreyImage
from calib.dic.calibration import Calibration
from calib.dic.calibration_files import read_calibration, write_calibration
from calib.dic.camera import Camera, Intrinsics, StereoRig, epipolar_distance, project
from calib.dic.pose_check import check_sides
from calib.dic.stereo import (
    StereoReason,
    StereoSettings,
    follow_pair,
    frame_of,
    place_reference,
)
from calib.dic.surface_frame import surface_frame
from calib.dic.surface_strain import surface_strain
from calib.dic.triangulate import triangulate
from calib.dic_study import camera_files

MOVED = {"move": (0.011, -0.017, 0.043), "stretch": (0.008, -0.012)}


def measured(seed, settings=STEREO, **moved):
    rest = still(seed)
    pixels, material = points_on(rest)
    later = shoot(face(**moved), None if seed is None else seed + 50)
    reference = place_reference(CAMERAS.rig, rest.left, rest.right, pixels, settings)
    found, _ = follow_pair(reference, later.left, later.right, settings)
    truth = face(**moved).at(material) - face().at(material)
    return reference, found, truth, material


@pytest.mark.lasting
def test_without_noise_points_and_displacements_are_exact():
    reference, found, truth, material = measured(None, **MOVED)
    assert found.valid.all()
    # shares of the field of view of some 5 mm
    view = CAMERAS.field_of_view
    assert np.abs(reference.space.points - face().at(material)).max() < view / 20_000
    off = found.displacement - truth
    assert np.sqrt((off[:, :2] ** 2).mean()) < view / 1_000_000
    assert np.sqrt((off[:, 2] ** 2).mean()) < view / 200_000


@pytest.mark.lasting
def test_errors_are_as_large_as_stated():
    scores = []
    for seed in (0, 1):
        _, found, truth, _ = measured(seed, **MOVED)
        assert found.valid.mean() > 0.98
        scores.append(((found.displacement - truth) / found.sigma)[found.valid])
    # neighbours overlap: some 2 x 100 independent points, 3 components
    scores = np.concatenate(scores)
    assert 0.85 < np.sqrt(np.mean(scores**2)) < 1.2
    assert 0.91 < np.mean(np.abs(scores) < 1.96) < 0.98


@pytest.mark.lasting
def test_a_face_at_rest_moves_by_its_stated_noise():
    _, found, _, _ = measured(2)
    z = (found.displacement / found.sigma)[found.valid]
    assert 0.8 < z.std() < 1.2
    assert np.abs(z.mean(axis=0)).max() < 0.4


def test_strain_of_the_surface_is_that_of_the_stretch():
    _, found, _, _ = measured(None, **MOVED)
    strain = surface_strain(found.position, found.displacement, 0.4)
    assert strain.xx == pytest.approx(0.008 + 0.008**2 / 2, abs=2e-5)
    assert strain.yy == pytest.approx(-0.012 + 0.012**2 / 2, abs=2e-5)
    assert strain.xy == pytest.approx(0.0, abs=2e-5)


def test_strain_of_a_turned_and_bent_surface_does_not_see_the_turn():
    rng = np.random.default_rng(0)
    flat = np.column_stack([rng.uniform(-1, 1, (400, 2)), np.zeros(400)])
    angle = 0.3
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    moved = flat @ np.diag([1.05, 0.97, 1.0]) @ turn.T - flat
    strain = surface_strain(flat, moved, 0.3)
    assert strain.xx == pytest.approx((1.05**2 - 1) / 2, abs=1e-12)
    assert strain.yy == pytest.approx((0.97**2 - 1) / 2, abs=1e-12)
    alone = surface_strain(flat[:3], moved[:3], 0.3)
    assert np.isnan(alone.xx).all()
    with pytest.raises(ValueError, match="radius"):
        surface_strain(flat, moved, 0.0)


@pytest.mark.lasting
def test_swapped_cameras_and_a_strange_calibration_are_told_apart():
    rest = still(0)
    rig = CAMERAS.rig
    points = points_on(rest)[0]
    with pytest.raises(ValueError, match="are swapped"):
        place_reference(StereoRig(rig.right, rig.left), rest.left, rest.right, points, STEREO)
    with pytest.raises(ValueError, match="another set-up, or the cameras have moved"):
        place_reference(turned(rig, 1.0), rest.left, rest.right, points, STEREO)
    again = StereoSettings(STEREO.correlation, refine_pose=True)
    with pytest.raises(ValueError, match="are swapped; with the pose found again"):
        place_reference(StereoRig(rig.right, rig.left), rest.left, rest.right, points, again)
    narrow = StereoSettings(STEREO.correlation, max_epipolar=1e-12)
    with pytest.raises(ValueError, match="no matched point within 1e-12 px"):
        place_reference(rig, rest.left, rest.right, points, narrow)


@pytest.mark.lasting
def test_a_knocked_camera_is_found_again():
    rest = still(0)
    knocked = turned(CAMERAS.rig, 0.3)
    settings = StereoSettings(STEREO.correlation, refine_pose=True)
    points = points_on(rest)[0]
    found = place_reference(knocked, rest.left, rest.right, points, settings)
    assert np.sqrt(np.nanmean(found.epipolar**2)) < 0.05
    right = place_reference(CAMERAS.rig, rest.left, rest.right, points, STEREO)
    assert np.sqrt(np.nanmean(right.epipolar**2)) < 0.05
    assert found.turned == pytest.approx(0.3, abs=0.4)
    later = shoot(face(**MOVED), 50)
    both = [follow_pair(one, later.left, later.right, STEREO)[0] for one in (found, right)]
    assert both[0].displacement == pytest.approx(both[1].displacement, abs=2.5e-3)


def test_points_seen_by_one_camera_alone_have_no_place():
    rest = still(0)
    hidden = rest.right.copy()
    hidden[:, : hidden.shape[1] // 2] = hidden.min()
    points = points_on(rest)[0]
    found = place_reference(CAMERAS.rig, rest.left, hidden, points, STEREO)
    lost = found.reason == StereoReason.NO_PARTNER
    assert 0.3 < lost.mean() < 0.7
    assert np.isnan(found.space.points[lost]).all()
    frame, _ = follow_pair(found, rest.left, rest.right, STEREO)
    assert not frame.valid[lost].any() and np.isnan(frame.displacement[lost]).all()


def test_a_camera_that_loses_a_point_says_so():
    rest = still(0)
    points = points_on(rest)[0]
    reference = place_reference(CAMERAS.rig, rest.left, rest.right, points, STEREO)
    for side, reason in ((0, StereoReason.LOST_LEFT), (1, StereoReason.LOST_RIGHT)):
        images = [rest.left.copy(), rest.right.copy()]
        images[side][:, :140] = 200.0
        found, _ = follow_pair(reference, *images, STEREO)
        assert np.mean(found.reason == reason) > 0.2
    with pytest.raises(ValueError, match="left: expected an image of"):
        follow_pair(reference, rest.left[:-1], rest.right, STEREO)


def test_a_region_goes_with_the_surface_into_the_right_image():
    rest = still(None)
    points = points_on(rest)[0]
    mask = np.isfinite(rest.material[..., 0])
    found = place_reference(CAMERAS.rig, rest.left, rest.right, points, STEREO, mask)
    near = np.zeros(rest.right.shape, dtype=bool)
    x, y = np.round(found.right).astype(int).T
    near[y, x] = True
    near = maximum_filter(near, STEREO.correlation.subset)
    face_there = rest.right > 0.05 * 4095
    there = found.right_ready.mask
    assert near.mean() > 0.5 and not there[~near].any()
    assert np.mean((there == face_there)[near]) > 0.985


def test_a_region_of_few_points_is_carried_too():
    rest = still(None)
    points = points_on(rest)[0][[40, 41]]
    mask = np.isfinite(rest.material[..., 0])
    found = place_reference(CAMERAS.rig, rest.left, rest.right, points, STEREO, mask)
    assert (found.reason == StereoReason.VALID).all()


@pytest.mark.lasting
def test_the_match_between_the_cameras_leaves_its_share_in_the_covariance():
    """Against differences of the triangulation, a point of the right camera moved by its SD."""
    rest, later = still(None), shoot(face(move=(0.3, -0.2, 0.9), stretch=(0.15, -0.2)), None)
    points = points_on(rest)[0][::7]
    reference = place_reference(CAMERAS.rig, rest.left, rest.right, points, STEREO)
    whole, tracked = follow_pair(reference, later.left, later.right, STEREO)
    sure = replace(reference, sigma=np.zeros_like(reference.sigma))
    good = whole.valid
    assert good.sum() > 5
    share = (whole.covariance - frame_of(sure, tracked, STEREO).covariance)[good]
    left, right = (camera.last.found for camera in tracked)
    expected = np.zeros_like(share)
    start, rig = np.flatnonzero(good), reference.rig
    placed = np.flatnonzero(reference.reason == StereoReason.VALID)
    kept = np.isin(placed, start)
    for axis in range(2):
        step = np.zeros((len(start), 2))
        step[:, axis] = 1e-4
        carried = step + np.einsum("nij,nj->ni", right.gradient[kept], step)
        now_left = reference.left[start] + left.displacement[kept]
        now_right = reference.right[start] + right.displacement[kept]
        after = triangulate(rig, now_left, now_right + carried).points
        after -= triangulate(rig, now_left, now_right).points
        before = triangulate(rig, reference.left[start], reference.right[start] + step).points
        before -= reference.space.points[start]
        slope = (after - before) / 1e-4 * reference.sigma[start, axis, None]
        expected += slope[:, :, None] * slope[:, None, :]
    size = np.abs(expected).max()
    assert size > 0
    np.testing.assert_allclose(share, expected, atol=1e-3 * size)


def test_the_frame_of_the_surface_has_z_towards_the_cameras():
    rng = np.random.default_rng(1)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    x, y, z = CAMERAS.rig.left.rotation[0], axes[1], axes[2]
    points = np.column_stack([rng.uniform(-2, 2, (300, 2)), 0.01 * rng.standard_normal(300)])
    points[:20, 2] += 1.0
    frame = surface_frame(CAMERAS.rig, np.vstack([points, np.full((2, 3), np.nan)]))
    assert frame.rotation == pytest.approx(np.eye(3), abs=0.01)
    assert np.linalg.det(frame.rotation) == pytest.approx(1.0)
    del x, y, z


STUDY = """
[images]
reference = "left0.tif"
deformed = ["left1.tif"]
times_s = [2.5]

[stereo]
right_reference = "{right}0.tif"
right_deformed = ["{right}1.tif"]
calibration = "rig.json"
axes = "camera"
strain_radius_mm = 0.4

[region]
rectangle_px = [60, 30, 240, 120]

[correlation]
subset_px = 25
step_px = 12
"""


BOARD = """
[calibration]
plate = "chessboard"
left = ["left0.tif"]
right = ["right0.tif"]
spacing_mm = 1.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("stereo")
    rest, later = still(0), shoot(face(**MOVED), 9)
    for number, shot in enumerate((rest, later)):
        io.imsave(place / f"left{number}.tif", shot.left.astype(np.uint16), check_contrast=False)
        io.imsave(place / f"right{number}.tif", shot.right.astype(np.uint16), check_contrast=False)
    write_calibration(place / "rig.json", Calibration(CAMERAS.rig, CAMERAS.size))
    return place


def test_the_command_writes_points_that_the_readers_read(folder, capsys):
    (folder / "s.toml").write_text(STUDY.format(right="right"))
    assert main(["dic", str(folder / "s.toml")]) == 0
    out = folder / "s-dic"
    first, second = read_dic(out / "points").frames
    assert second.time == 2.5 and second.sigma is not None
    assert np.all(first.displacement[first.valid] == 0.0)
    # the left camera's frame: turn the truth into it
    rig = CAMERAS.rig
    places = (second.position[second.valid] - rig.left.translation) @ rig.left.rotation
    expected = (face(**MOVED).at(places[:, :2]) - face().at(places[:, :2])) @ rig.left.rotation.T
    assert second.displacement[second.valid] == pytest.approx(expected, abs=0.004)
    rows = np.diff(first.position.reshape(*first.grid_shape, 3), axis=1)
    spacing = np.nanmedian(np.linalg.norm(rows, axis=2))
    length = 25 / np.sqrt(2 * np.pi) * spacing / 12  # of subsets of 25 px at points 12 px apart
    assert second.correlation_length == pytest.approx(length, rel=0.05)
    assert first.correlation_length == second.correlation_length
    assert first.scale_sd == second.scale_sd
    report = json.loads((out / "dic.json").read_text())
    assert report["frames"][0]["valid"] > 0.9 * report["frames"][0]["points"]
    assert (out / "pictures" / "left1.png").stat().st_size > 1000
    strain = np.genfromtxt(out / "left1-strain.csv", delimiter=",", skip_header=1)
    assert np.nanmedian(strain[:, 3]) == pytest.approx(0.008, abs=5e-4)
    assert "stereo angle 34.00 degrees" in capsys.readouterr().out


def test_a_pose_found_again_is_that_of_the_calibration_file(folder, capsys):
    knocked = Calibration(
        turned(CAMERAS.rig, 0.3),
        CAMERAS.size,
        reprojection=(0.1, 0.1),
        covariance=np.zeros((26, 26)),
    )
    write_calibration(folder / "knocked.json", knocked)
    text = STUDY.format(right="right").replace("= 12", "= 24").replace("rig.json", "knocked.json")
    text = text.replace("axes =", "refine_pose = true\naxes =")
    text = text.replace("[images]", '[images]\nrepeat = "left0.tif"')
    (folder / "again.toml").write_text(text)
    assert main(["dic", str(folder / "again.toml")]) == 0
    report = json.loads((folder / "again-dic" / "dic.json").read_text())
    written = read_calibration(folder / "again-dic" / "calibration.json")
    assert written.rig.angle == pytest.approx(report["stereo_angle_deg"], abs=1e-9)
    assert np.isnan(written.rms)
    # exact plates say nothing of a pose that was found by matched points
    assert 1e-4 < report["scale_sd"] < 0.05
    assert {"left", "right"} == set(report["quality"])
    assert report["quality"]["right"]["speckle"] > 2.5
    text = text.replace("knocked.json", "again-dic/calibration.json").replace(
        "refine_pose = true", ""
    )
    (folder / "third.toml").write_text(text)
    assert main(["dic", str(folder / "third.toml")]) == 0
    third = json.loads((folder / "third-dic" / "dic.json").read_text())
    assert third["scale_sd"] == pytest.approx(report["scale_sd"], rel=1e-6)
    capsys.readouterr()


@pytest.mark.lasting
def test_a_stopped_series_goes_on_with_the_same_bits(folder, capsys, monkeypatch):
    text = STUDY.format(right="right").replace("= 12", "= 24")
    for side in ("left", "right"):
        text = text.replace(f'["{side}1.tif"]', f'["{side}1.tif", "{side}2.tif"]')
        (folder / f"{side}2.tif").write_bytes((folder / f"{side}1.tif").read_bytes())
    (folder / "long.toml").write_text(text.replace("[2.5]", "[2.5, 3.5]"))
    assert main(["dic", str(folder / "long.toml"), "--out", str(folder / "whole")]) == 0

    def stopped_at_the_second(reference, left, right, settings, before, bar):
        if before.left.last is not None:
            raise KeyboardInterrupt
        return follow_pair(reference, left, right, settings, before, bar)

    with monkeypatch.context() as patch:
        patch.setattr("calib.dic_study.stereo_run.follow_pair", stopped_at_the_second)
        assert main(["dic", str(folder / "long.toml")]) != 0
    capsys.readouterr()
    assert main(["dic", str(folder / "long.toml")]) == 0
    said = capsys.readouterr().out
    assert said.count("(kept)") == 1 and said.count("(measured)") == 1
    for name in ("points/left1.csv", "points/left2.csv", "left2-strain.csv", "dic.json"):
        assert (folder / "long-dic" / name).read_bytes() == (folder / "whole" / name).read_bytes()


def test_pairs_after_one_whose_image_changed_are_gone_when_the_run_is_stopped(
    folder, tmp_path, monkeypatch
):
    """Of the right camera, whose name the results do not bear."""
    for name in ("left0", "right0", "left1", "right1"):
        shutil.copy(folder / f"{name}.tif", tmp_path)
    for side in ("left", "right"):
        shutil.copy(folder / f"{side}1.tif", tmp_path / f"{side}2.tif")
    shutil.copy(folder / "rig.json", tmp_path)
    text = STUDY.format(right="right").replace("= 12", "= 24").replace("[2.5]", "[2.5, 5.0]")
    for side in ("left", "right"):
        text = text.replace(f'["{side}1.tif"]', f'["{side}1.tif", "{side}2.tif"]')
    (tmp_path / "s.toml").write_text(text)
    assert main(["dic", str(tmp_path / "s.toml")]) == 0
    points = tmp_path / "s-dic" / "points"
    assert {path.stem for path in points.iterdir()} == {"left0", "left1", "left2"}
    image = io.imread(tmp_path / "right1.tif")
    io.imsave(tmp_path / "right1.tif", image + (image < 100), check_contrast=False)

    def stopped(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr("calib.dic_study.stereo_run.follow_pair", stopped)
    assert main(["dic", str(tmp_path / "s.toml")]) != 0
    assert [path.stem for path in points.iterdir()] == ["left0"]


@pytest.mark.parametrize("all_white", [False, True])
def test_a_white_background_is_no_fault_of_the_right_image_and_a_white_one_is(
    folder, tmp_path, capsys, all_white
):
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    x, y = np.meshgrid(np.arange(90.0, 211, 10), np.arange(45.0, 106, 10))
    points = np.column_stack([x.ravel(), y.ravel()])
    rest = still(0)
    there = place_reference(CAMERAS.rig, rest.left, rest.right, points, STEREO).right
    (left, top), (right, bottom) = np.nanmin(there, axis=0) - 20, np.nanmax(there, axis=0) + 20
    row, column = np.mgrid[:150, :300]
    around = (column < left) | (column > right) | (row < top) | (row > bottom)
    assert around.mean() > 0.55
    for number in (0, 1):
        path = tmp_path / f"right{number}.tif"
        shown = np.asarray(io.imread(path))
        covered = shown > np.quantile(shown, 0.35) if all_white else around
        io.imsave(path, np.where(covered, 4095, shown).astype(np.uint16), check_contrast=False)
    text = STUDY.format(right="right").replace("[60, 30, 240, 120]", "[90, 45, 210, 105]")
    (tmp_path / "s.toml").write_text(text)
    assert main(["dic", str(tmp_path / "s.toml")]) == (2 if all_white else 0)
    refused = "right0.tif: expected an exposed image, found more than 50% of the image saturated"
    assert (refused in capsys.readouterr().err) == all_white


def _stage(folder, name, text):
    (folder / f"{name}.toml").write_text(text)
    return main(["dic", str(folder / f"{name}.toml")])


@pytest.mark.lasting
def test_a_dark_pair_is_told_and_the_series_goes_on(folder, capsys):
    text = STUDY.format(right="right").replace("= 12", "= 24").replace("[2.5]", "[2.5, 3.5]")
    for side in ("left", "right"):
        io.imsave(folder / f"{side}3.tif", np.zeros((150, 300), np.uint16), check_contrast=False)
        text = text.replace(f'["{side}1.tif"]', f'["{side}3.tif", "{side}1.tif"]')
    assert _stage(folder, "dark", text) == 0
    out = capsys.readouterr().out
    assert "warning: no point was found in left3.tif" in out and "2/2 left1.tif: 32 of 32" in out


def test_pairs_that_numbers_of_images_contradict_are_told_before_anything_is_measured(
    folder, capsys, monkeypatch
):
    def stopped(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr("calib.dic_study.stereo_run.calibration_of", stopped)
    for name in ("left2", "right3"):
        (folder / f"{name}.tif").write_bytes((folder / "left1.tif").read_bytes())
    text = STUDY.format(right="right").replace("[2.5]", "[2.5, 3.5]")
    text = text.replace('["left1.tif"]', '["left1.tif", "left2.tif"]')
    assert _stage(folder, "lacking", text.replace('["right1.tif"]', '["right1.tif", "right3.tif"]'))
    told = "warning: left2.tif is paired with right3.tif, other than left1.tif with right1.tif"
    assert told in capsys.readouterr().out
    (folder / "right2.tif").write_bytes((folder / "right1.tif").read_bytes())
    assert _stage(folder, "lacking", text.replace('["right1.tif"]', '["right2.tif", "right3.tif"]'))
    told = "warning: left1.tif is paired with right2.tif, other than left0.tif with right0.tif"
    assert told in capsys.readouterr().out


@pytest.mark.lasting
def test_cameras_that_have_moved_since_the_reference_are_told(folder, capsys):
    """The right image 2 px lower than it was: no point is on its line, and a warning says why.

    Sampson's distance shares the 2 px between both images.
    """
    text = STUDY.format(right="right").replace("= 12", "= 24")
    text = text.replace('["left1.tif"]', '["left1.tif", "left4.tif"]')
    text = text.replace('["right1.tif"]', '["right1.tif", "right4.tif"]')
    (folder / "left4.tif").write_bytes((folder / "left1.tif").read_bytes())
    lower = np.roll(io.imread(folder / "right1.tif"), 2, axis=0)
    io.imsave(folder / "right4.tif", lower, check_contrast=False)
    assert _stage(folder, "moved", text.replace("[2.5]", "[2.5, 3.5]")) == 0
    out = capsys.readouterr().out
    assert "warning: left4.tif, right4.tif: points lie 1.4 px from" in out
    assert "or the cameras have moved since the reference images" in out
    assert out.count("from their epipolar lines") == 1
    assert "warning: left4.tif is pixel for pixel left1.tif, expected" in out


def test_pairs_much_farther_from_their_lines_than_the_references_are_told(folder, capsys):
    """0.3 px, which no point is lost by: as of a frame that one camera has written twice."""
    higher = shift(io.imread(folder / "right1.tif").astype(float), (-0.3, 0.0), mode="nearest")
    image = np.round(higher).astype(np.uint16)
    io.imsave(folder / "right6.tif", image, check_contrast=False)
    text = STUDY.format(right="right").replace("= 12", "= 24")
    assert _stage(folder, "late", text.replace('["right1.tif"]', '["right6.tif"]')) == 0
    out = capsys.readouterr().out
    assert "warning: left1.tif, right6.tif: points lie 0.2" in out and "below 0.1;" in out
    assert " 0 of " not in out


def test_how_far_points_may_be_from_their_lines_goes_with_the_references(monkeypatch):
    """Five times as far as in these, 0.1 px at least and the limit at most."""
    image = GreyImage("a.tif", np.ones((2, 2)), 255.0)
    monkeypatch.setattr(camera_files, "median_distance", lambda *_: 0.4)
    for usual, limit, expected in (
        (0.01, 1.0, "below 0.1;"), (0.07, 1.0, "below 0.35;"), (0.5, 0.3, "below 0.3;"),
        (0.081, 1.0, None),
    ):  # fmt: skip
        monkeypatch.setattr(camera_files, "usual_distance", lambda _, usual=usual: usual)
        said = camera_files.view_doubt(None, None, limit, image, image)
        assert said is None if expected is None else expected in said


def test_a_camera_that_drifts_is_not_taken_for_the_other_one():
    """Nearly parallel cameras: 0.45 px bring points nearer to the wrong line than to their own."""
    lens = Intrinsics(2000.0, 2000.0, 150.0, 75.0)
    right = Camera(replace(lens, cy=75.3), np.eye(3), np.array([-20.0, 0.0, 0.0]))
    rig = StereoRig(Camera(lens), right)
    rng = np.random.default_rng(3)
    x = np.column_stack([rng.uniform(-4, 4, (60, 2)), rng.uniform(98, 102, 60)])
    left, seen = (
        project(camera, x)[0] + 0.01 * rng.standard_normal((60, 2))
        for camera in (rig.left, rig.right)
    )
    usual = float(np.median(np.abs(epipolar_distance(rig, left, seen))))
    drifted = seen + np.array([0.0, -0.45])
    distance = check_sides(rig, left, drifted, usual, "images")
    exchanged = np.abs(epipolar_distance(StereoRig(rig.right, rig.left), left, drifted))
    assert np.median(exchanged) < 0.5 * distance
    with pytest.raises(ValueError, match="images are swapped"):
        check_sides(rig, seen, left, usual, "images")
    check_sides(rig, seen[:5], left[:5], usual, "images")  # by so few points nothing is said


@pytest.mark.lasting
def test_points_of_another_reference_do_not_stay(folder, capsys):
    text = STUDY.format(right="right").replace("= 12", "= 24")
    for side in ("left", "right"):
        (folder / f"{side}2.tif").write_bytes((folder / f"{side}1.tif").read_bytes())
    (folder / "other.toml").write_text(text)
    assert main(["dic", str(folder / "other.toml")]) == 0
    later = text.replace('1.tif"]', '2.tif"]').replace('0.tif"', '1.tif"')
    (folder / "other.toml").write_text(later)
    assert main(["dic", str(folder / "other.toml")]) == 0
    names = {path.name for path in (folder / "other-dic" / "points").iterdir()}
    assert names == {"left1.csv", "left2.csv"}
    assert "removed the results of left0" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            (
                ("left0", "#0"),
                ("left1", "#1"),
                ("right0", "left0"),
                ("right1", "left1"),
                ("#0", "right0"),
                ("#1", "right1"),
            ),
            "swapped",
        ),
        ((('calibration = "rig.json"\n', ""),), "either a file here or a section"),
        (
            (('["left1.tif"]', '["left1.tif", "left0.tif"]'), ("[2.5]", "[1.0, 2.0]")),
            'stereo.right_deformed: found ["right1.tif"], expected 2 files',
        ),
        ((("rig.json", "left0.tif"),), "not a calibration"),
        (
            (('["right1.tif"]', '["left1.tif"]'),),
            'stereo.right_deformed: found "left1.tif", expected an image of the right camera alone',
        ),
        (
            (('right_reference = "right0.tif"', 'right_reference = "./left0.tif"'),),
            'stereo.right_reference: found "left0.tif", expected an image of the right camera',
        ),
        (
            (('["right1.tif"]', '["copy.tif"]'),),
            "copy.tif: found the very picture of left1.tif, expected one of each camera",
        ),
        (
            (('["left1.tif"]', '["#"]'), ('["right1.tif"]', '["left1.tif"]'), ("#", "right1.tif")),
            "right1.tif, left1.tif: the images are swapped; points lie 0.0",
        ),
        (
            (('reference = "left0', 'repeat = "no.tif"\nreference = "left0'),),
            "no.tif: found no such",
        ),
        (
            (("left1.tif", "more/left0.tif"), ("right1.tif", "more/right0.tif")),
            'images.deformed: found "left0", expected other names than the reference',
        ),
        ((("[60, 30, 240, 120]", "[60, 30, 240, 151]"),), ":15: region.rectangle_px: found [60.0"),
        (
            (
                ('calibration = "rig.json"\n', ""),
                ("[region]", BOARD + "columns = 8\nrows = 6\n[region]"),
            ),
            "calibration.columns: found [8, 6], expected one odd and one even",
        ),
        (
            (('calibration = "rig.json"\n', ""), ("[region]", BOARD + "[region]")),
            "calibration: found 0 poses in 1 pairs of images in which both cameras see the plate",
        ),
    ],
)
def test_wrong_studies_of_two_cameras_get_one_sentence(folder, capsys, change, words):
    text = STUDY.format(right="right")
    for old, new in change:
        assert old in text
        text = text.replace(old, new)
    (folder / "wrong.toml").write_text(text)
    (folder / "copy.tif").write_bytes((folder / "left1.tif").read_bytes())
    assert main(["dic", str(folder / "wrong.toml")]) == 2
    said = capsys.readouterr().err.strip()
    assert words in said and "\n" not in said
