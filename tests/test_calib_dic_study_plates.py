"""Plates of a study: what is kept, which poses count, and what is said of few."""

from __future__ import annotations

import numpy as np
import pytest
from skimage import io
from test_calib_dic_calibration import RIG, SIZE, views

from calib.dic.calibration import Calibration
from calib.dic_study import plates
from calib.dic_study.config import Images
from calib.dic_study.stereo_config import Plates, Stereo, StereoStudy

N = 9


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A pair of files a pose, whose views are looked up by their names; the fit is that of the
    cameras, whose own tests are elsewhere."""
    left, right = views(N)
    known = {}
    for number in range(N):
        for side, view in (("l", left[number]), ("r", right[number])):
            name = f"{side}{number}.png"
            known[name] = view
            grey = np.full((20, 30), number + 10 * (side == "r"), np.uint8)
            io.imsave(tmp_path / name, grey, check_contrast=False)
    monkeypatch.setattr(plates, "_view", lambda image, _: known[image.name])

    def fitted(ours, theirs, size, settings):
        assert len(ours) == len(theirs) >= settings.least_poses
        assert size == (30, 20)
        error = np.eye(26) / 3.0
        return Calibration(RIG, SIZE, {"left.fx": 0.1}, n_poses=len(ours), covariance=error)

    monkeypatch.setattr(plates, "calibrate", fitted)
    return tmp_path


def calibrated(folder, poses=N, **settings):
    said = []
    left, right = (tuple(f"{side}{k}.png" for k in range(poses)) for side in "lr")
    board = Plates(plate="dots", left=left, right=right, spacing_mm=8.0, **settings)
    study = StereoStudy(
        images=Images(reference="a", deformed=("b",)),
        stereo=Stereo(right_reference="c", right_deformed=("d",)),
        calibration=board,
    )
    found = plates.calibration_of(study, folder, folder / "frames", said.append)
    return found, "\n".join(said)


def test_a_calibration_is_kept_to_the_bit_until_an_image_or_a_setting_changes(folder, monkeypatch):
    first, said = calibrated(folder)
    assert "9 poses" in said and "(measured)" in said
    with monkeypatch.context() as patch:
        patch.setattr(plates, "calibrate", None)
        again, said = calibrated(folder)
    assert "9 poses" in said and "(kept, the images and settings are those" in said
    for camera in ("left", "right"):
        one, other = (getattr(found.rig, camera) for found in (first, again))
        np.testing.assert_array_equal(one.intrinsics.matrix, other.intrinsics.matrix)
        np.testing.assert_array_equal(one.rotation, other.rotation)
        np.testing.assert_array_equal(one.translation, other.translation)
    np.testing.assert_array_equal(first.covariance, again.covariance)
    assert "(measured)" in calibrated(folder, radial=1)[1]
    assert "(measured)" in calibrated(folder)[1]
    io.imsave(folder / "l4.png", np.full((20, 30), 200, np.uint8), check_contrast=False)
    assert "(measured)" in calibrated(folder)[1]
    (kept,) = (folder / "frames").iterdir()
    kept.write_text(kept.read_text()[:-50])
    assert "(measured)" in calibrated(folder)[1]


def test_fewer_than_eight_poses_are_refused_unless_they_are_asked_for_and_then_told(folder):
    with pytest.raises(
        ValueError, match=r"found 7 poses in 7 pairs .* expected 8 or more \(.*poses = 7 takes"
    ):
        calibrated(folder, 7)
    found, said = calibrated(folder, 7, least_poses=7)
    assert found.n_poses == 7
    assert "warning: a calibration from 7 poses, expected 8 or more" in said
    assert "warning" not in calibrated(folder)[1]


def test_a_pose_that_is_there_twice_counts_once(folder, monkeypatch):
    left, right = views(N)
    seen = {f"{s}{k}.png": v[min(k, 2)] for s, v in (("l", left), ("r", right)) for k in range(N)}
    monkeypatch.setattr(plates, "_view", lambda image, _: seen[image.name])
    with pytest.raises(ValueError, match=r"found 3 poses in 9 pairs .* each pose counted once"):
        calibrated(folder)


def test_poses_whose_numbers_tell_of_other_pairs_are_told(folder):
    """The left camera lacks pose 4, the right one pose 6."""
    assert "paired" not in calibrated(folder)[1]
    said = []
    left, right = ([k for k in range(N) if k != lost] for lost in (4, 6))
    board = Plates(
        plate="dots",
        left=tuple(f"l{k}.png" for k in left),
        right=tuple(f"r{k}.png" for k in right),
        spacing_mm=8.0,
    )
    study = StereoStudy(
        images=Images(reference="a", deformed=("b",)),
        stereo=Stereo(right_reference="c", right_deformed=("d",)),
        calibration=board,
    )
    plates.calibration_of(study, folder, folder / "frames", said.append)
    assert "warning: l5.png is paired with r4.png, other than l0.png with r0.png" in said[0]
