"""What `calib dic` reads: one small TOML file beside the images.

Lengths in px of the image, x to the right and y down, unless the key says mm. The text under a
field is also what a refusal says it expects.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from calib.dic import CorrelationSettings
from calib.dic.settings import MOST_BLUR
from calib.simple_polygon import SIMPLE, encloses
from calib.toml_file import Contradiction, Document, FileRefused, read_document, read_file
from calib.toml_file.strict import STRICT

Positive = Annotated[float, Field(gt=0, lt=1e6)]
Pixel = Annotated[float, Field(gt=-1e6, lt=1e6)]
Name = Annotated[str, Field(min_length=1, max_length=1000)]
Corner = tuple[Pixel, Pixel]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Images:
    """[images] Files, by their path from the study's folder."""

    reference: Name
    """file of the image before loading"""
    deformed: Annotated[tuple[Name, ...], Field(min_length=1)]
    """one or more files in the order in which they were taken; a name may hold * for many"""
    repeat: Name | None = None
    """file of a second image before loading, from which the noise is found"""
    times_s: tuple[Pixel, ...] | None = None
    """time of each deformed image, s"""

    def __post_init__(self) -> None:
        times = self.times_s or ()
        if any(later < time for time, later in pairwise(times)):
            raise Contradiction("times_s", times, "times that go on, as the images were taken")


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Region:
    """[region] What of the reference image is measured; all of it when nothing is given."""

    rectangle_px: tuple[Pixel, Pixel, Pixel, Pixel] | None = None
    """left, top, right, bottom, px"""
    polygon_px: Annotated[tuple[Corner, ...], Field(min_length=3)] | None = None
    """three or more corners [x, y], px"""
    mask: Name | None = None
    """file of an image of the same size, black where nothing is measured"""

    def __post_init__(self) -> None:
        box = self.rectangle_px
        if box is not None and not (box[0] < box[2] and box[1] < box[3]):
            raise Contradiction("rectangle_px", box, "left < right and top < bottom")
        if self.polygon_px is not None and not encloses(self.polygon_px):
            raise Contradiction("polygon_px", self.polygon_px, SIMPLE)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Options:
    """[correlation] Subsets and how they are matched."""

    subset_px: Annotated[int, Field(ge=7, le=255)] = 31
    """side of a subset, an odd number of px, 7 to 255"""
    step_px: Annotated[int, Field(ge=1, le=1000)] = 8
    """distance between points, px"""
    order: Literal[1, 2] = 1
    """shape functions: 1 affine, 2 quadratic"""
    interpolation: Literal["cubic", "quintic"] = "quintic"
    """B-spline between pixels, cubic or quintic"""
    blur_px: Annotated[float, Field(ge=0, le=MOST_BLUR)] = 0.0
    """SD of a Gaussian that the images are blurred by before, px, 0 to 3"""
    min_zncc: Annotated[float, Field(ge=0, lt=1)] = 0.7
    """correlation below which a point is lost, 0 to less than 1"""
    max_sigma_px: Positive = 0.3
    """standard deviation above which a point is lost, px"""

    def __post_init__(self) -> None:
        if self.subset_px % 2 == 0:
            raise Contradiction("subset_px", self.subset_px, "an odd number of px")

    @property
    def settings(self) -> CorrelationSettings:
        """As the correlation takes them."""
        return CorrelationSettings(
            subset=self.subset_px,
            order=self.order,
            degree=5 if self.interpolation == "quintic" else 3,
            blur=self.blur_px,
            min_zncc=self.min_zncc,
            max_sigma=self.max_sigma_px,
        )


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Scale:
    """[scale] From px to mm; x to the right and y up from the origin."""

    mm_per_px: Positive
    """length on the sample that one pixel sees, mm"""
    origin_px: Corner = (0.0, 0.0)
    """place in the reference image that becomes 0, 0, px"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Strains:
    """[strain] Written to a table beside the points."""

    radius_px: Positive
    """radius of the circle whose points a polynomial is fitted to, px"""
    order: Literal[1, 2] = 1
    """of the polynomial"""
    measure: Literal["green", "log", "engineering"] = "green"
    """green, log or engineering"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class DicStudy:
    """One series of images of one camera."""

    images: Images
    """a section [images]"""
    scale: Scale
    """a section [scale]"""
    region: Region = Region()
    """a section [region]"""
    correlation: Options = Options()
    """a section [correlation]"""
    strain: Strains | None = None
    """a section [strain]"""


def read_study(path: Path) -> Document:
    """Read a study of images, of one camera or two. Raises FileRefused."""
    if not path.exists():
        raise FileRefused(f"{path}: found no such file, expected a study of images (TOML)")
    return read_document(read_file(path, "study of images"), str(path), "study of images")


def load_study(path: Path) -> DicStudy:
    """Read and check a study of one camera. Raises FileRefused, with the line."""
    return read_study(path).checked(DicStudy)
