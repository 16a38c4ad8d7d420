"""Files of stereo calibrations: softcal's own, VIC-3D projects, DICe xml and text.

VIC-3D and DICe give cx cy fx fy skew k1 k2 k3 and three angles in degrees with the rotation
Rz(gamma) Ry(beta) Rx(alpha) from the world, or the first camera, to a camera; lengths are taken as
mm. The kappas of VIC-3D are read as Brown's: DICe's source itself says that it does not know.
"""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from calib.dic.calibration import Calibration
from calib.dic.camera import Camera, Intrinsics, StereoRig
from calib.dic.distortion import BROWN, Array, Distortion
from fe.atomic_file import write_text

MARK = "softcal stereo calibration 1"
LARGEST = 10_000_000
"""bytes: no calibration is larger"""
DICE_POWERS = {
    "NONE": BROWN,
    "OPENCV_DIS": BROWN,
    "VIC3D_DIS": BROWN,
    "K1R1_K2R2_K3R3": (0, 1, 2),
    "K1R2_K2R4_K3R6": (1, 3, 5),
    "K1R3_K2R5_K3R7": (2, 4, 6),
}
"""powers of the radius in the factor; DICe's names count those of the radius itself"""
QUALITY = {
    "epipolar": float, "noise": float, "plate_error": float,
    "n_poses": int, "n_points": int, "n_far": int,
}  # fmt: skip
"""entries of a calibration's quality that are one number"""
N_RIG = 26
"""parameters of a rig in its covariance: see `Bundle.covariance`"""
DICE_UNREAD = ("K4", "K5", "K6", "S1", "S2", "S3", "S4", "T1", "T2")


def write_calibration(path: Path | str, calibration: Calibration) -> None:
    """Write as json that `read_calibration` gives back to the last bit."""
    rig = calibration.rig
    content: dict[str, object] = {
        "format": MARK,
        "unit": "mm, px, degrees",
        "size": list(calibration.size),
        "left": asdict(rig.left.intrinsics),
        "right": asdict(rig.right.intrinsics),
    }
    turn, shift = rig.relative
    content["relative"] = {"rotation": turn.tolist(), "translation": shift.tolist()}
    content["quality"] = {
        name: getattr(calibration, name)
        for name in (
            "sigma", "reprojection", "per_pose", "epipolar", "noise", "n_poses", "n_points",
            "n_far", "plate_error",
        )
    }  # fmt: skip
    if calibration.covariance is not None:
        content["covariance"] = calibration.covariance.tolist()
    write_text(Path(path), json.dumps(content, indent=1) + "\n")


def read_calibration(path: Path | str) -> Calibration:
    """Read a calibration in any of the formats; the rig is in the left camera's frame.

    Raises ValueError naming the file when it is none of them or lacks a number.
    """
    path = Path(path)
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise ValueError(f"{path}: expected a file of a calibration, found {found}")
    if path.stat().st_size > LARGEST:
        raise ValueError(
            f"{path}: expected a file of a calibration, found {path.stat().st_size / 1e6:.0f} MB"
        )
    text = path.read_bytes().decode("utf-8", errors="replace")
    try:
        if text.lstrip().startswith("{"):
            return _softcal(json.loads(text))
        if text.lstrip().startswith("<"):
            return _xml(text)
        return _dice_text(text)
    except (
        ValueError, KeyError, TypeError, IndexError, OverflowError, RecursionError,
        ElementTree.ParseError,
    ) as error:  # fmt: skip
        raise ValueError(
            f"{path}: not a calibration of softcal, VIC-3D or DICe ({_told(error)})"
        ) from error


def _told(error: Exception) -> str:
    """What a reader found wrong, without the names of what Python raises."""
    if isinstance(error, KeyError):
        return f"expected the entry {json.dumps(error.args[0])}, found none"
    if isinstance(error, json.JSONDecodeError | ElementTree.ParseError):
        return f"it begins like one, but cannot be read on: {error}"
    if isinstance(error, ValueError):
        return str(error)
    return "expected numbers, each in its place, found others"


def _softcal(content: dict[str, Any]) -> Calibration:
    if content.get("format") != MARK:
        raise ValueError(f"expected format {MARK!r}")
    cameras = [_intrinsics_of(content[side]) for side in ("left", "right")]
    relative = content["relative"]
    right = Camera(
        cameras[1],
        np.array(relative["rotation"], dtype=np.float64),
        np.array(relative["translation"], dtype=np.float64),
    )
    quality = _quality(content["quality"])
    if "covariance" in content:
        covariance = np.array(content["covariance"], dtype=np.float64)
        if covariance.shape != (N_RIG, N_RIG) or not np.isfinite(covariance).all():
            found = "others" if covariance.shape == (N_RIG, N_RIG) else f"shape {covariance.shape}"
            raise ValueError(
                f"covariance: expected {N_RIG} x {N_RIG} finite numbers, found {found}"
            )
        quality["covariance"] = covariance
    return Calibration(
        StereoRig(Camera(cameras[0]), right),
        _size(content["size"]),
        **quality,
    )


def _size(values: Any) -> tuple[int, int]:
    """Columns and rows of the images; none of both where they are not known."""
    columns, rows = (int(value) for value in values)
    if (columns, rows) != (0, 0) and min(columns, rows) < 1:
        raise ValueError(f"size: expected columns and rows above 0, found {columns} and {rows}")
    return columns, rows


def _quality(values: dict[str, Any]) -> dict[str, Any]:
    """How well the rig fits, by the fields of `Calibration`."""
    try:
        left, right = (float(value) for value in values["reprojection"])
    except ValueError:
        found = values["reprojection"]
        raise ValueError(f"quality.reprojection: expected two numbers, found {found}") from None
    return {
        "sigma": {str(name): float(value) for name, value in values.get("sigma", {}).items()},
        "reprojection": (left, right),
        "per_pose": tuple((str(n), float(a), float(b)) for n, a, b in values["per_pose"]),
        **{name: kind(values[name]) for name, kind in QUALITY.items() if name in values},
    }


def _intrinsics_of(values: dict[str, Any]) -> Intrinsics:
    lens: dict[str, list[float]] = dict(values["distortion"])
    k, p, powers = lens["radial"], lens["tangential"], lens["powers"]
    numbers = {name: float(values[name]) for name in ("fx", "fy", "cx", "cy", "skew")}
    a, b, c = (int(power) for power in powers)
    return Intrinsics(**numbers, distortion=Distortion((k[0], k[1], k[2]), (p[0], p[1]), (a, b, c)))


def _from_first(first: Camera, second: Camera) -> StereoRig:
    turn, shift = StereoRig(first, second).relative
    return StereoRig(Camera(first.intrinsics), Camera(second.intrinsics, turn, shift))


def _lens(values: Array, powers: tuple[int, int, int] = BROWN) -> Intrinsics:
    """From cx cy fx fy skew k1 k2 k3."""
    cx, cy, fx, fy, skew, k1, k2, k3 = (float(value) for value in values)
    return Intrinsics(fx, fy, cx, cy, skew, Distortion((k1, k2, k3), powers=powers))


def _turn(angles: Array) -> Array:
    matrix: Array = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    return matrix


def _numbers(text: str | None) -> Array:
    return np.array([float(word) for word in (text or "").split()], dtype=np.float64)


def _xml(text: str) -> Calibration:
    if "<!ENTITY" in text:
        raise ValueError("expected an xml file without entities")
    # VIC-3D declares Latin-1; the text is decoded already
    root = ElementTree.fromstring(re.sub(r"<\?xml[^>]*\?>", "", text, count=1))
    if root.tag == "project":
        return _vic3d(root)
    return _dice_xml(root)


def _vic3d(root: ElementTree.Element) -> Calibration:
    cameras = []
    for number in ("0", "1"):
        node = root.find(f".//calibration/camera[@id='{number}']")
        if node is None:
            raise ValueError(f"expected a camera {number} in the calibration")
        pose = _numbers(node.findtext("orientation"))
        cameras.append(Camera(_lens(_numbers(node.text)), _turn(pose[:3]), pose[3:6]))
    mask = root.find(".//polygonmask")
    size = (0, 0) if mask is None else _size((mask.get("width", 0), mask.get("height", 0)))
    return Calibration(_from_first(*cameras), size)


def _dice_xml(root: ElementTree.Element) -> Calibration:
    cameras, size = [], (0, 0)
    for number in (0, 1):
        node = root.find(f".//ParameterList[@name='CAMERA {number}']")
        if node is None:
            raise ValueError(f"expected a CAMERA {number}")
        values = {p.get("name", ""): p.get("value", "") for p in node.iter("Parameter")}
        unread = [name for name in DICE_UNREAD if float(values.get(name, 0.0)) != 0.0]
        if unread:
            raise ValueError(f"found {', '.join(unread)}, expected k1 to k3, p1, p2 alone")
        cameras.append(_dice_camera(node, values))
        height, width = re.findall(r"\d+", values.get("IMAGE_HEIGHT_WIDTH", "0 0"))[:2]
        if number == 0:
            size = (int(width), int(height))
    is_relative = 'name="extrinsics_relative_camera_to_camera" type="bool" value="true"'
    if is_relative in ElementTree.tostring(root, encoding="unicode"):
        return Calibration(StereoRig(Camera(cameras[0].intrinsics), cameras[1]), size)
    return Calibration(_from_first(*cameras), size)


def _dice_camera(node: ElementTree.Element, values: dict[str, str]) -> Camera:
    def number(name: str) -> float:
        return float(values.get(name, 0.0))

    model = values.get("LENS_DISTORTION_MODEL", "NONE")
    if model not in DICE_POWERS:
        raise ValueError(f"LENS_DISTORTION_MODEL: found {model}, expected one DICe writes")
    has_lens = 0.0 if model == "NONE" else 1.0
    radial = (has_lens * number("K1"), has_lens * number("K2"), has_lens * number("K3"))
    lens = Distortion(radial, (number("P1"), number("P2")), DICE_POWERS[model])
    # DICe applies the skew with its model of VIC-3D alone
    skew = number("FS") if model == "VIC3D_DIS" else 0.0
    intrinsics = Intrinsics(number("FX"), number("FY"), number("CX"), number("CY"), skew, lens)
    shift = np.array([number("TX"), number("TY"), number("TZ")])
    matrix = node.find("ParameterList[@name='rotation_3x3_matrix']")
    if matrix is None:
        turn = _turn(np.array([number("ALPHA"), number("BETA"), number("GAMMA")]))
    else:
        rows = [re.findall(r"[-+.\deE]+", p.get("value", "")) for p in matrix.iter("Parameter")]
        turn = np.array(rows, dtype=np.float64)
    return Camera(intrinsics, turn, shift)


def _number(line: str) -> float:
    try:
        return float(line)
    except ValueError:
        raise ValueError(f"expected one number a line, found {line[:40]!r}") from None


def _dice_text(text: str) -> Calibration:
    """One number a line: 8 a camera, then 3 angles or 9 of a rotation, 3 of a translation."""
    lines = [line.split("#")[0].strip() for line in text.splitlines()]
    values = np.array([_number(line) for line in lines if line])
    if values.size in (22, 24):
        turn, rest = _turn(values[16:19]), values[19:]
    elif values.size in (28, 30):
        u, _, vt = np.linalg.svd(values[16:25].reshape(3, 3))
        turn, rest = u @ vt, values[25:]
    else:
        raise ValueError(f"expected 22 to 30 numbers, found {values.size}")
    right = Camera(_lens(values[8:16]), turn, rest[:3])
    return Calibration(StereoRig(Camera(_lens(values[:8])), right), (0, 0))
