"""What `calib dic` reads for two cameras: a study of images with a section [stereo]."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from calib.dic.bundle import LensModel
from calib.dic.calibration import CalibrationSettings
from calib.dic.chessboard import Chessboard
from calib.dic.stereo import StereoSettings
from calib.dic_study.config import Images, Name, Options, Positive, Region
from calib.toml_file import Contradiction, Document
from calib.toml_file.strict import STRICT

Count = Annotated[int, Field(ge=1, le=1000)]
Names = Annotated[tuple[Name, ...], Field(min_length=1)]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Stereo:
    """[stereo] The right camera; [images] holds those of the left one."""

    right_reference: Name
    """file of the right image before loading"""
    right_deformed: Names
    """one or more files of the right camera, in the order of images.deformed; a name may hold *"""
    calibration: Name | None = None
    """file of a calibration of softcal, VIC-3D or DICe; without it a section [calibration]"""
    refine_pose: bool = False
    """true: find the pose of the cameras again from the reference images"""
    max_epipolar_px: Positive = 0.5
    """distance from its epipolar line beyond which a point is lost, px"""
    axes: Literal["surface", "camera"] = "surface"
    """surface: x right, y up, z out of the plane of the points; camera: that of the left camera"""
    strain_radius_mm: Positive | None = None
    """radius of the circle on the surface for strains; none are written without it, mm"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Plates:
    """[calibration] Images of a plate, the same pose at the same place of both lists."""

    plate: Literal["dots", "chessboard"]
    """dots (three of them with a bright centre) or chessboard"""
    left: Names
    """files of the left camera; a name may hold *"""
    right: Names
    """files of the right camera, in the same order"""
    spacing_mm: Positive
    """distance of dots, or side of a square, mm"""
    to_x_marker: Count = 5
    """steps from the origin dot to the marker on the x axis"""
    to_y_marker: Count = 3
    """steps from the origin dot to the marker on the y axis"""
    columns: Count = 9
    """inner corners of a chessboard along a row"""
    rows: Count = 6
    """inner corners of a chessboard along a column"""
    least_poses: Annotated[int, Field(ge=3, le=1000)] = 8
    """fewest poses that are accepted, 3 or more"""
    plate_error_mm: Annotated[float, Field(ge=0, lt=10)] = 0.0
    """SD of a point of the plate about its place, mm; 0 for an exact plate"""
    radial: Annotated[int, Field(ge=0, le=3)] = 2
    """number of radial coefficients of the lens, 0 to 3"""
    tangential: bool = False
    """true: two tangential coefficients too"""

    def __post_init__(self) -> None:
        if self.plate != "chessboard":
            return
        try:
            Chessboard(self.columns, self.rows, self.spacing_mm)
        except ValueError as error:
            found, expected = [self.columns, self.rows], str(error).split("expected ", 1)[1]
            raise Contradiction("columns", found, f"{expected} (columns, rows)") from error

    @property
    def settings(self) -> CalibrationSettings:
        """As the calibration takes them."""
        lens = LensModel(self.radial, self.tangential)
        return CalibrationSettings(lens, self.least_poses, self.plate_error_mm)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class StereoStudy:
    """One series of images of two cameras."""

    images: Images
    """a section [images]"""
    stereo: Stereo
    """a section [stereo]"""
    calibration: Plates | None = None
    """a section [calibration]"""
    region: Region = Region()
    """a section [region]"""
    correlation: Options = Options()
    """a section [correlation]"""

    def __post_init__(self) -> None:
        if (self.calibration is None) == (self.stereo.calibration is None):
            found = "none" if self.calibration is None else "both"
            raise Contradiction(
                "stereo.calibration", found, "either a file here or a section [calibration]"
            )

    @property
    def settings(self) -> StereoSettings:
        """As the stereo correlation takes them."""
        return StereoSettings(
            self.correlation.settings,
            max_epipolar=self.stereo.max_epipolar_px,
            refine_pose=self.stereo.refine_pose,
        )


def has_stereo(document: Document) -> bool:
    """Whether a study of images is one of two cameras."""
    return "stereo" in document.values
