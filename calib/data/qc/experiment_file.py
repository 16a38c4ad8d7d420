"""What no instrument's file tells of an experiment: `experiment.toml` in the folder of its files.

Units mm, N, s, degrees. The text under a field is also what a refusal says it expects.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from calib.simple_polygon import SIMPLE, encloses
from calib.toml_file import Contradiction, FileRefused, read_document, read_file
from calib.toml_file.strict import STRICT
from fe.response import Array

FILE = "experiment.toml"
MOST_POINTS = 10_000
"""of the data set: the correlation of their noise is a full matrix"""

SMALLEST, LARGEST = 0.1, 1000.0
"""of a specimen, mm, as in a study"""
Positive = Annotated[float, Field(gt=0, lt=1e6)]
NotNegative = Annotated[float, Field(ge=0, lt=1e6)]
Coordinate = Annotated[float, Field(gt=-1e6, lt=1e6)]
Count = Annotated[int, Field(ge=1, le=1000)]
Share = Annotated[float, Field(gt=0, le=1)]
Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
Mapping = Literal["shape", "linear", "cubic"]
RigidBody = Literal["symmetry", "base", "none"]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Specimen:
    """[specimen] The block."""

    width_mm: Positive = 10.0
    """width of the sample (x), mm"""
    depth_mm: Positive = 10.0
    """depth of the sample (z, along the bar pin), mm"""
    height_mm: Positive = 2.5
    """height of the sample (y), mm"""

    def __post_init__(self) -> None:
        for key in ("width_mm", "depth_mm", "height_mm"):
            if not SMALLEST <= getattr(self, key) <= LARGEST:
                expected = f"{SMALLEST:g} to {LARGEST:g}: lengths are in mm"
                raise Contradiction(key, getattr(self, key), expected)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Protocol:
    """[protocol] What the test machine was told to do."""

    increment_mm: Positive = 0.2
    """travel of one step, mm"""
    increments: Count = 9
    """number of steps, each followed by a hold"""
    hold_s: Positive = 20.0
    """duration of one hold, s"""
    hold_at_contact: bool | None = None
    """whether there is a hold where the pin touches, before the first step; without it the force
    says so, which noise may mislead in soft samples"""
    preconditioning_cycles: Annotated[int, Field(ge=0, le=1000)] = 5
    """number of cycles before the steps, 0 or more"""
    preconditioning_travel_mm: Positive = 1.0
    """travel of one preconditioning cycle, mm"""
    use: Annotated[tuple[Count, ...], Field(min_length=2)] = (3, 4, 5, 6, 7)
    """numbers of two or more increments that enter the data set, increasing, the first step is 1"""

    def __post_init__(self) -> None:
        for index, number in enumerate(self.use):
            if index and number <= self.use[index - 1]:
                expected = f"more than the number before ({self.use[index - 1]})"
                raise Contradiction(f"use.{index}", number, expected)
            if number > self.increments:
                expected = f"at most protocol.increments ({self.increments})"
                raise Contradiction(f"use.{index}", number, expected)

    @property
    def travel(self) -> Array:
        """(n_step,) nominal travels of the increments used, mm."""
        return np.round(self.increment_mm * np.array(self.use, dtype=np.float64), 9)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Machine:
    """[machine] The test machine."""

    compression_force_sign: Literal[-1, 1] = -1
    """sign of a compressive force in files that do not say it, -1 or 1"""
    compliance_mm_per_N: NotNegative = 0.0
    """travel that the machine itself takes, mm per N"""
    contact_sd_mm: NotNegative = 0.02
    """SD of the place where the steps begin about that where the pin touches, mm; 0 takes the one
    for the other"""
    force_window: Share = 0.25
    """share of the hold, at its end, over which the force is averaged"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Camera:
    """[camera] The clock of the DIC frames."""

    max_clock_offset_s: Positive = 5.0
    """largest difference between the clocks of camera and test machine, s"""
    margin_s: NotNegative = 0.0
    """time after the start and before the end of a hold at which no frame is taken, s"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Axes:
    """[axes] Which axis of the DIC files is our x (right), y (up), z (towards the camera)."""

    x: Axis = "+x"
    """axis of the DIC file, with its sign, that points to the right"""
    y: Axis = "+y"
    """axis of the DIC file, with its sign, that points up"""
    z: Axis = "+z"
    """axis of the DIC file, with its sign, that points towards the camera"""

    def __post_init__(self) -> None:
        if len({self.x[1], self.y[1], self.z[1]}) < 3:
            raise Contradiction("z", self.z, "each of x, y and z of the file once in [axes]")

    @property
    def matrix(self) -> Array:
        """(3, 3) rows are our axes in those of the file."""
        signed = [(1.0 if axis[0] == "+" else -1.0, "xyz".index(axis[1])) for axis in self._all]
        rows = np.zeros((3, 3))
        for row, (sign, column) in enumerate(signed):
            rows[row, column] = sign
        return rows

    @property
    def _all(self) -> tuple[Axis, Axis, Axis]:
        return self.x, self.y, self.z


Corner = tuple[Coordinate, Coordinate]
Box = tuple[Coordinate, Coordinate, Coordinate, Coordinate]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Mask:
    """[mask] What of the image is the sample, in x and y of [axes]."""

    rectangle_mm: Box | None = None
    """left, bottom, right, top of what is kept, mm"""
    polygon_mm: Annotated[tuple[Corner, ...], Field(min_length=3)] | None = None
    """three or more corners [x, y] around what is kept, mm"""
    pin_rectangle_mm: Box | None = None
    """left, bottom, right, top of points on the pin, whose travel is held against the machine's"""

    def __post_init__(self) -> None:
        for key in ("rectangle_mm", "pin_rectangle_mm"):
            box = getattr(self, key)
            if box is not None and not (box[0] < box[2] and box[1] < box[3]):
                raise Contradiction(key, box, "left < right and bottom < top")
        if self.polygon_mm is not None and not encloses(self.polygon_mm):
            raise Contradiction("polygon_mm", self.polygon_mm, SIMPLE)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class FieldOptions:
    """[field] From the points of a sample to the field of the data set."""

    mapping: Mapping = "shape"
    """"shape": at DIC points, where the FE field is evaluated; "linear", "cubic": DIC interpolated
    to the FE model's own points"""
    spacing_mm: Positive = 0.2
    """distance of the data set's points with mapping = "shape", mm"""
    rigid_body: RigidBody = "symmetry"
    """how rigid motion is found: "symmetry" about the pin, "base" where it sticks, or "none\""""
    base_mm: Coordinate | None = None
    """height of the base in y of [axes], mm; without it the lowest row less the edge's margin"""
    edge_mm: NotNegative | None = None
    """distance of the outermost points from the edge of the sample, mm; without it half of what
    the points seen lack of specimen.width_mm, 0.5 at most"""
    min_share: Share = 0.9
    """share of the kept samples that must have a point for it to be in the data set"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Quality:
    """[quality] Rules: a sample beyond one of them is rejected."""

    max_angle_deg: Positive = 1.0
    """largest angle of the face about the height (top view), degrees (thesis, section 4.3.2)"""
    max_x_shift_mm: Positive = 0.25
    """largest distance of pin and sample's centre along x, mm (thesis, section 4.3.2)"""
    max_tilt_deg: Positive | None = None
    """largest angle of the face about its width, degrees"""
    max_roll_deg: Positive | None = None
    """largest angle of the face about its normal, degrees"""
    max_slack_mm: Positive | None = None
    """largest travel before contact, mm"""
    max_force_deviation: Positive | None = None
    """largest deviation of a force from the median of the samples, in robust SDs"""
    max_cycle_change_percent: Positive | None = None
    """largest change of peak force over the last preconditioning cycle, percent"""
    max_outlier_share: Share = 0.05
    """largest share of points that are outliers"""
    min_points: Count = 100
    """smallest number of points with a displacement in every frame used"""
    min_points_share: Share = 0.7
    """smallest number of points of half the face, as a share of the median of the samples; used
    from three samples on"""
    outlier_mad: Positive = 5.0
    """a point is an outlier beyond this many local median deviations"""
    outlier_floor_mm: Positive = 0.005
    """added to the local median deviation, about the noise of one point, mm"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Experiment:
    """One laboratory's experiment. Units mm, N, s."""

    name: Annotated[str, Field(max_length=60)] = ""
    """a name; without it that of the folder"""
    synthetic: bool = False
    """whether the files were made by a model"""
    samples: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    """folders of the samples; without it all that hold a test-machine record"""
    specimen: Specimen = Specimen()
    """a section [specimen]"""
    protocol: Protocol = Protocol()
    """a section [protocol]"""
    machine: Machine = Machine()
    """a section [machine]"""
    camera: Camera = Camera()
    """a section [camera]"""
    axes: Axes = Axes()
    """a section [axes]"""
    mask: Mask = Mask()
    """a section [mask]"""
    field: FieldOptions = FieldOptions()
    """a section [field]"""
    quality: Quality = Quality()
    """a section [quality]"""

    def __post_init__(self) -> None:
        last = self.protocol.increment_mm * self.protocol.increments
        if last >= self.specimen.height_mm:
            expected = f"steps that end below specimen.height_mm ({self.specimen.height_mm:g} mm)"
            raise Contradiction("protocol.increments", self.protocol.increments, expected)
        area = 0.5 * self.specimen.width_mm * self.specimen.height_mm
        spacing = self.field.spacing_mm
        if self.field.mapping == "shape" and area > MOST_POINTS * spacing**2:
            expected = f"a distance of at most {MOST_POINTS} points on half the face"
            raise Contradiction("field.spacing_mm", spacing, expected)
        names = self.samples or ()
        for index, name in enumerate(names):
            if name in names[:index]:
                raise Contradiction(f"samples.{index}", name, "a folder that is not named before")


def refused(folder: Path, key: str, found: object, expected: str) -> FileRefused:
    """The error that names line and key of `experiment.toml` in `folder`, which has been read."""
    path = folder / FILE
    document = read_document(read_file(path, "experiment file"), str(path), "experiment file")
    return document.refuse(Contradiction(key, found, expected).refusal())


def read_experiment(folder: Path | str) -> Experiment:
    """Read and check `experiment.toml` in `folder`.

    Raises FileRefused, a ValueError of one sentence with file, line and key.
    """
    folder = Path(folder)
    path = folder / FILE
    if not folder.is_dir():
        found = "a file" if folder.exists() else "no such folder"
        raise FileRefused(f"{folder}: found {found}, expected a folder with {FILE}")
    if not path.is_file():
        found = "a folder" if path.exists() else "no such file"
        raise FileRefused(f"{path}: found {found}, expected what the instruments do not tell")
    document = read_document(read_file(path, "experiment file"), str(path), "experiment file")
    return document.checked(Experiment)
