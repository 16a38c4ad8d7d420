"""Files of calibrations: written and read without loss, and those of other programs."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from calib.dic.calibration import Calibration
from calib.dic.calibration_files import read_calibration, write_calibration
from calib.dic.camera import Camera, Intrinsics, StereoRig
from calib.dic.distortion import Distortion

DATA = Path(os.environ.get("SOFTCAL_DATA", "../shared/data"))
INNER = "600.5 400.25 2400.0 2401.0 -0.17 0.064 0.01 0.0"
POSE = "0.09 -18.03 -0.0877 130.75 -0.61 17.133"

VIC = f"""<?xml version="1.0" encoding="ISO-8859-1"?>
<!DOCTYPE vpml>
<project><calibration>
<camera id="0">{INNER}<orientation>0 0 0 0 0 0</orientation></camera>
<camera id="1">{INNER}<orientation>{POSE}</orientation></camera>
</calibration></project>
"""


def dice_xml(model="K1R3_K2R5_K3R7", extra=""):
    names = ("CX", "CY", "FX", "FY", "FS", "K1", "K2", "K3")
    inner = "\n".join(
        f'<Parameter name="{n}" type="double" value="{v}" />'
        for n, v in zip(names, INNER.split(), strict=True)
    )
    pose = "\n".join(
        f'<Parameter name="{n}" type="double" value="{v}" />'
        for n, v in zip(("ALPHA", "BETA", "GAMMA", "TX", "TY", "TZ"), POSE.split(), strict=True)
    )
    lens = f'<Parameter name="LENS_DISTORTION_MODEL" type="string" value="{model}" />'
    size = '<Parameter name="IMAGE_HEIGHT_WIDTH" type="string" value="{ 800, 1280 }" />'
    return (
        f'<ParameterList><ParameterList name="CAMERA 0">{inner}{lens}{size}{extra}</ParameterList>'
        f'<ParameterList name="CAMERA 1">{inner}{lens}{size}{pose}</ParameterList></ParameterList>'
    )


def text(rotation=("0.09", "-18.03", "-0.0877")):
    numbers = [*INNER.split(), *INNER.split(), *rotation, *POSE.split()[3:]]
    return "\n".join(f"{number} # of the file" for number in numbers) + "\n"


def read(tmp_path, content):
    path = tmp_path / "file"
    path.write_text(content)
    return read_calibration(path)


def test_our_file_gives_the_same_bits_back(tmp_path):
    turn = read(tmp_path, text()).rig.right.rotation
    right = Camera(Intrinsics(2000.1, 2000.2, 5.3, 4.7), turn, np.array([1.1, 2.2, 3.3]))
    rig = StereoRig(
        Camera(Intrinsics(1.0 / 3.0, 2.0, 3.0, 4.0, 0.1, Distortion((0.1, 0.2, 0.3)))), right
    )
    made = Calibration(
        rig, (640, 480), {"left.fx": 0.1}, (0.1, 0.2), (("a", 0.1, 0.2),), 0.3, 0.4, 8, 9, 1,
        covariance=np.random.default_rng(0).random((26, 26)) / 3.0,
    )  # fmt: skip
    write_calibration(tmp_path / "c.json", made)
    found = read_calibration(tmp_path / "c.json")
    assert found.rig.left.intrinsics == rig.left.intrinsics
    assert np.array_equal(found.rig.right.rotation, turn)
    assert (found.size, found.sigma, found.per_pose) == (made.size, made.sigma, made.per_pose)
    np.testing.assert_array_equal(found.covariance, made.covariance)


def test_one_calibration_in_four_forms_is_the_same(tmp_path):
    turn = read(tmp_path, VIC).rig.right.rotation
    forms = [
        read(tmp_path, content)
        for content in (VIC, dice_xml(), text(), text([str(v) for v in turn.ravel()]))
    ]
    for found in forms:
        assert found.rig.right.rotation == pytest.approx(turn, abs=1e-12)
        assert found.rig.right.translation == pytest.approx([130.75, -0.61, 17.133])
        inner = found.rig.left.intrinsics
        assert (inner.fx, inner.fy, inner.cx, inner.cy) == (2400.0, 2401.0, 600.5, 400.25)
        assert inner.distortion.radial == (0.064, 0.01, 0.0)
    assert forms[1].size == (1280, 800)


def test_dices_other_powers_of_the_radius_are_kept(tmp_path):
    found = read(tmp_path, dice_xml("K1R1_K2R2_K3R3"))
    assert found.rig.left.intrinsics.distortion.powers == (0, 1, 2)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "not a calibration"),
        ("{}", "format"),
        ('{"format": "softcal stereo calibration 1"}', 'expected the entry "left", found none'),
        ('{"format"', "begins like one, but cannot be read on"),
        ("hello\n", "expected one number a line, found 'hello'"),
        ("1\n2\n3\n", "found 3"),
        ("<project></project>", "camera 0"),
        ("<project>", "not a calibration"),
        (VIC.replace("<!DOCTYPE vpml>", '<!DOCTYPE a [<!ENTITY b "c">]>'), "entities"),
        (dice_xml("FISHEYE"), "LENS_DISTORTION_MODEL"),
        (dice_xml(extra='<Parameter name="K4" type="double" value="1" />'), "K4"),
        (text().replace("2400.0", "-1.0"), "above 0"),
    ],
)
def test_files_that_are_none_are_refused_in_one_sentence(tmp_path, content, words):
    with pytest.raises(ValueError, match=words) as caught:
        read(tmp_path, content)
    said = str(caught.value)
    assert "\n" not in said and "file" in said and "Error" not in said
    with pytest.raises(ValueError, match="expected a file of a calibration, found a folder"):
        read_calibration(tmp_path)
    with pytest.raises(ValueError, match="found no such file"):
        read_calibration(tmp_path / "none")


@pytest.mark.parametrize(
    ("entry", "value", "words"),
    [
        (
            "quality.reprojection",
            ["a", "b"],
            "quality.reprojection: expected two numbers, found .'a', 'b'.",
        ),
        ("quality.reprojection", [0.1], "quality.reprojection: expected two numbers, found"),
        ("covariance", [[1.0, 0.0], [0.0, 1.0]], "covariance: expected 26 x 26 finite numbers"),
        ("covariance", np.full((26, 26), np.nan).tolist(), "covariance: expected 26 x 26 finite"),
        ("size", [640, -480], "size: expected columns and rows above 0, found 640 and -480"),
        ("relative.translation", [0.0, 0.0, 0.0], "expected two cameras apart"),
        ("relative.translation", [np.nan, 0.0, 0.0], "translation: expected finite lengths"),
    ],
)
def test_numbers_of_our_file_that_are_none_are_refused(tmp_path, entry, value, words):
    right = Camera(Intrinsics(2000.0, 2000.0, 5.0, 4.0), np.eye(3), np.array([-9.0, 0.0, 0.0]))
    rig = StereoRig(Camera(Intrinsics(2000.0, 2000.0, 3.0, 4.0)), right)
    write_calibration(tmp_path / "c.json", Calibration(rig, (640, 480), reprojection=(0.1, 0.2)))
    content = json.loads((tmp_path / "c.json").read_text())
    *above, last = entry.split(".")
    (content[above[0]] if above else content)[last] = value
    with pytest.raises(ValueError, match=words) as caught:
        read(tmp_path, json.dumps(content))
    assert "not a calibration of softcal" in str(caught.value)


@pytest.mark.skipif(not (DATA / "dic_exports").exists(), reason="no real files; set SOFTCAL_DATA")
def test_real_files_of_one_rig_agree():
    folder = DATA / "dic_exports" / "dice"
    names = ("cal_a.txt", "cal_a_with_R.txt", "cal_a_vic3d.xml", "DICe_cal_a.xml")
    rigs = [read_calibration(folder / name).rig for name in names]
    for rig in rigs:
        assert rig.angle == pytest.approx(18.0304, abs=5e-4)
        assert rig.baseline == pytest.approx(131.87, abs=0.01)
        assert rig.left.intrinsics.fx == pytest.approx(2468.53, abs=0.01)
