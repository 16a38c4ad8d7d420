"""What a search for a stereo DIC set-up starts from, read from one small TOML file.

Lengths in mm, angles in degrees. The text under a field is also what a refusal says it expects.
"""

from __future__ import annotations

from importlib import resources
from math import hypot
from pathlib import Path
from typing import Annotated

from pydantic import AliasChoices, Field
from pydantic.dataclasses import dataclass

from calib.toml_file import Contradiction, FileRefused, Refusal, read_document, read_file
from calib.toml_file.strict import STRICT

# bounds that no lens reaches keep every result finite
Positive = Annotated[float, Field(gt=1e-6, lt=1e6)]
NotNegative = Annotated[float, Field(ge=0, lt=1e6)]
Count = Annotated[int, Field(ge=1, le=100_000)]
Angle = Annotated[float, Field(gt=0.01, lt=90)]
MOST_TRIED = 5_000_000  # combinations for one lens, some 1 GB of arrays


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Sample:
    """[sample] The face of the sample that both cameras look at."""

    width: Positive
    """width of the face in the plane of the two cameras, mm"""
    height: Positive
    """height of the face, mm"""
    out_of_plane: NotNegative
    """largest displacement of the face along its normal, mm"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Camera:
    """[camera] The sensor, the same in both cameras."""

    columns: Count
    """pixels along the width of the sensor"""
    rows: Count
    """pixels along the height of the sensor"""
    pixel: Positive
    """side of one pixel of the sensor, mm"""

    @property
    def width(self) -> float:
        """Width of the sensor, mm."""
        return self.columns * self.pixel

    @property
    def height(self) -> float:
        """Height of the sensor, mm."""
        return self.rows * self.pixel

    @property
    def diagonal(self) -> float:
        """Diagonal of the sensor, mm."""
        return hypot(self.width, self.height)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Lens:
    """[[lens]] One lens that may be used on both cameras."""

    name: Annotated[str, Field(min_length=1, max_length=40)]
    """name of 1 to 40 letters to show in tables"""
    focal_lengths: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=100)]
    """one or more focal lengths, mm; more than one for a zoom lens"""
    f_stops: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=100)]
    """one or more apertures to try, as f-stops"""
    image_circle: Positive
    """diameter of the image that the lens makes, or largest diagonal of a sensor, mm"""
    nearest_distance: Positive
    """shortest object distance from the lens without extension tube, more than 2 f, mm"""
    barrel_diameter: Positive
    """diameter of the front of the lens, mm"""

    def __post_init__(self) -> None:
        if self.nearest_distance <= 2 * max(self.focal_lengths):
            expected = f"more than twice the focal length ({2 * max(self.focal_lengths):g} mm)"
            raise Contradiction("nearest_distance", self.nearest_distance, expected)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Choices:
    """[search] What is tried with every lens, at every one of its apertures."""

    extension_tubes: Annotated[tuple[NotNegative, ...], Field(min_length=1, max_length=200)]
    """one or more lengths of extension tube to try, 0 for none, mm"""
    half_angles: Annotated[tuple[Angle, ...], Field(min_length=1, max_length=100)]
    """one or more half stereo angles to try, degrees"""
    distances: Annotated[int, Field(ge=2, le=10_000)] = 60
    """number of object distances to try within the reach of each tube, 2 or more"""
    farthest: Positive = 1000.0
    """longest object distance that there is room for, mm"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Limits:
    """[limits] What a usable set-up has to meet."""

    margin: Annotated[float, Field(ge=0, lt=1)] = 0.1
    """share of the frame's width and height that stays free, from 0 to less than 1"""
    smallest_distance: NotNegative = 0.0
    """room needed between lens and sample, for lamps and the machine, mm"""
    least_points: Count = 500
    """number of displacement points needed on the face (thesis, requirement 6)"""
    speckle_pixels: Positive = 3.0
    """smallest speckle in pixels that does not alias"""
    subset_speckles: Positive = 5.0
    """speckles along one side of a subset"""
    step_share: Annotated[float, Field(gt=0, le=1)] = 0.25
    """step between points as a share of the subset, up to 1"""
    matching_noise: Positive = 0.05
    """standard deviation of a match, pixels (thesis 2.6: 1/100 to 1/20)"""
    out_of_plane_noise: Positive | None = None
    """largest standard deviation of an out-of-plane displacement, mm; no limit when absent"""
    wavelength: Positive = 0.00055
    """wavelength of the light, mm"""
    circle_of_confusion: Positive | None = None
    """largest blur that counts as sharp, mm on the sensor; the diagonal / 1500 when absent"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Design:
    """One search: what is to be seen, with what, and what the result has to meet."""

    sample: Sample
    """a section [sample]"""
    camera: Camera
    """a section [camera]"""
    lenses: Annotated[tuple[Lens, ...], Field(min_length=1)] = Field(
        validation_alias=AliasChoices("lens", "lenses")
    )
    """one or more sections [[lens]]"""
    search: Choices
    """a section [search]"""
    limits: Limits = Limits()
    """a section [limits]"""

    def __post_init__(self) -> None:
        tubes, angles = len(self.search.extension_tubes), len(self.search.half_angles)
        for index, lens in enumerate(self.lenses):
            stops, lengths = len(lens.f_stops), len(lens.focal_lengths)
            n_tried = tubes * angles * self.search.distances * stops * lengths
            if n_tried > MOST_TRIED:
                expected = f"fewer values: lens {index + 1} has {n_tried} combinations, "
                expected += f"at most {MOST_TRIED} are tried"
                raise Contradiction("search.distances", self.search.distances, expected)


def embedded_designs() -> tuple[str, ...]:
    """Names of the designs that come with the package."""
    folder = resources.files("calib.optics") / "embedded"
    names = (entry.name for entry in folder.iterdir() if entry.name.endswith(".toml"))
    return tuple(sorted(name.removesuffix(".toml") for name in names))


def load_design(design: str | Path) -> Design:
    """Read and check a design by the path of its file or the name of an embedded one.

    Raises FileRefused, with the line, when it is missing, unreadable or wrong.
    """
    if design in embedded_designs():
        resource = resources.files("calib.optics") / "embedded" / f"{design}.toml"
        content, file = resource.read_bytes(), f"{design}.toml"
    else:
        path = Path(design)
        if not path.exists():
            known = ", ".join(embedded_designs())
            raise FileRefused(f"{path}: found no such file, expected a lens file or one of {known}")
        content, file = read_file(path, "lens file"), str(path)
    document = read_document(content, file, "lens file")
    if "lenses" in document.values:  # the field's name in Python; a file has one way to say it
        reason = "found an unknown key, expected sections [[lens]]"
        raise document.refuse(Refusal(("lenses",), reason))
    return document.checked(Design)
