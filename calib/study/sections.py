"""The sections of a study file as frozen data, each value checked where it is declared.

Units are mm, N and MPa. The text under a field is also what a refusal says it expects.
"""

from __future__ import annotations

import sys
from typing import Annotated, Literal

from pydantic import Field, SkipValidation
from pydantic.dataclasses import dataclass

from calib.inference.discrepancy import COMMON, LENGTH, TRAVEL_LENGTH
from calib.inference.laws import RATIOS
from calib.study.block_cells import (
    MIN_REFINEMENT,
    BlockCells,
    Cells,
    Count,
    as_found,
    check_size,
    finer_than,
    shows_error,
)
from calib.study.data_sections import (
    EXPERIMENT,
    THESIS_TABLE,
    VIRTUAL,
    DataSource,
    Population,
)
from calib.study.prior_sections import ParameterPrior, Prior
from calib.toml_file.refusal import Contradiction
from calib.toml_file.strict import STRICT

__all__ = [
    "EXPERIMENT",
    "MIN_REFINEMENT",
    "THESIS_TABLE",
    "VIRTUAL",
    "Cells",
    "Count",
    "DataSource",
    "ParameterPrior",
    "Population",
    "Prior",
]

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=60)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, lt=1)]
Correlation = Annotated[float, Field(ge=0, lt=1)]
BulkRatio = Annotated[float, Field(gt=1, le=1e5)]
Stiffening = Annotated[float, Field(ge=1, le=64)]
LEAST_STIFFENING = 2.0
"""of a check, other than 1: a rigid pin is foretold from the difference that it makes"""
Interface = SkipValidation[Literal["stick", "slide"] | float]
"""checked by `Hypothesis` as a whole, whose message names all that is possible"""
PinShape = Literal["bar", "round"]

SMALLEST, LARGEST = 0.1, 1000.0
"""mm, of samples and pins: a study in micrometres or metres is told so"""
SHARPEST = 0.05  # mm; the strain at a sharp edge is singular, so that no mesh resolves it


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Virtual:
    """[virtual] A synthetic experiment with known constants; with data.source = "virtual"."""

    hypothesis: str
    """name of the [[hypothesis]] that holds in the virtual experiment"""
    C10: NotNegative
    """true C10, MPa"""
    C01: NotNegative
    """true C01, MPa"""
    C11: NotNegative
    """true C11, MPa"""
    cells: BlockCells
    """three numbers of elements (x, y, z), at least those of mesh.sampling, or rings as there"""
    stiffening: Stiffening = 8.0
    """how many times less the pin's surface gives way than in the runs that train the emulator"""
    n_samples: Annotated[int, Field(ge=2)]
    """number of samples tested"""
    force_sd_share: Positive
    """standard deviation of the force between samples as a share of the force"""
    field_noise_std: tuple[Positive, Positive, Positive]
    """noise of the displacement components x, y, z, mm"""
    field_correlation_length: Positive
    """length over which the noise of neighbouring points is correlated, mm"""
    field_reference_share: Correlation
    """share of the noise variance that the reference image gives to all increments"""

    def __post_init__(self) -> None:
        check_size("cells", self.cells)
        check_stiffness(self.C10, self.C01)


def check_stiffness(c10: float, c01: float) -> None:
    """Refuse true constants (MPa), 0 or more each, of a material without stiffness."""
    if not c10 + c01 > 0:
        raise Contradiction(
            "C10", c10, "more than 0 where C01 is 0: they are half the shear modulus"
        )


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Geometry:
    """[geometry] The block and the pin that is pressed into its top centre."""

    width: Positive
    """width of the sample (x), mm"""
    depth: Positive
    """depth of the sample (z, along a bar pin), mm"""
    height: Positive
    """height of the sample (y), mm"""
    pin_width: Positive
    """width of the pin, less than the width of the sample, mm"""
    pin_fillet: Positive
    """radius of the pin's edges, less than half its width, mm"""
    pin_shape: PinShape = "bar"
    """"bar" (through the whole depth) or "round" (pin_width is its diameter)"""
    pin_shift: float = 0.0
    """distance of the pin's axis from the sample's centre along x, mm"""

    def __post_init__(self) -> None:
        for name in ("width", "depth", "height", "pin_width"):
            if not SMALLEST <= getattr(self, name) <= LARGEST:
                expected = f"{SMALLEST:g} to {LARGEST:g}: lengths are in mm"
                raise Contradiction(name, getattr(self, name), expected)
        if self.pin_width >= self.width:
            expected = f"less than geometry.width ({self.width:g} mm)"
            raise Contradiction("pin_width", self.pin_width, expected)
        if self.pin_fillet < SHARPEST:
            expected = f"{SHARPEST:g} mm or more: the force under a sharp edge has no limit"
            raise Contradiction("pin_fillet", self.pin_fillet, expected)
        if self.pin_fillet >= self.pin_width / 2:
            expected = f"less than half of geometry.pin_width ({self.pin_width / 2:g} mm)"
            raise Contradiction("pin_fillet", self.pin_fillet, expected)
        room = (self.width - self.pin_width) / 2
        if abs(self.pin_shift) > room:
            expected = f"from -{room:g} to {room:g} mm, so that the pin stands on the sample"
            raise Contradiction("pin_shift", self.pin_shift, expected)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Material:
    """[material] What is fixed about the material."""

    law: str = "mooney-rivlin-3"
    """name of a law: neo-hookean, mooney-rivlin-2, mooney-rivlin-3, yeoh, ogden-1, -2 or -3"""
    bulk_ratio: BulkRatio = 200.0
    """bulk modulus over the small-strain shear modulus"""

    def __post_init__(self) -> None:
        check_law("law", self.law)


def check_law(key: str, law: str) -> None:
    """Refuse a law that there is not."""
    if law not in RATIOS:
        raise Contradiction(key, law, f"one of {', '.join(RATIOS)}")


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Mesh:
    """[mesh] Elements of the quarter model in x, y, z; or rings about a round pin."""

    sampling: BlockCells | None = None
    """three numbers of elements (x, y, z) for the runs that train the emulator, or of a mesh whose
    lines follow a round pin { rings, layers, sectors }; without it by the contact"""
    check: BlockCells | None = None
    """three numbers of elements (x, y, z) for the runs that measure the discretisation error, or
    { rings, layers, sectors } where sampling has these; without it by the contact"""
    check_stiffening: Stiffening = 4.0
    """how many times less the pin's surface gives way in the runs of check than in those that train
    the emulator, 2 or more: a rigid pin does not, and what that is worth is corrected for with the
    mesh; 1 is the same surface, whose compliance is neither corrected for nor stated"""

    def __post_init__(self) -> None:
        check_size("sampling", self.sampling)
        check_size("check", self.check)
        if self.check and self.sampling and not shows_error(self.check, self.sampling):
            raise Contradiction("check", as_found(self.check), finer_than(self.sampling))
        if self.check_stiffening != 1.0 and self.check_stiffening < LEAST_STIFFENING:
            expected = f"1, the same pin, or {LEAST_STIFFENING:g} or more"
            raise Contradiction("check_stiffening", self.check_stiffening, expected)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Hypothesis:
    """[[hypothesis]] One reading of the contact, calibrated on its own and then compared."""

    name: Name
    """a name of letters, digits, hyphens and underscores"""
    pin: Interface
    """contact between sample and pin: "stick", "slide" or a coefficient of friction"""
    base: Interface
    """contact between sample and base plate: "stick", "slide" or a coefficient of friction"""
    law: str | None = None
    """name of the law under this hypothesis; without it material.law"""
    prior: Prior | None = None
    """sections [hypothesis.prior.<parameter>], in place of or beside those of [prior]"""
    height: Positive | None = None
    """height of the sample under this hypothesis, mm; without it geometry.height"""
    bulk_ratio: BulkRatio | None = None
    """bulk modulus over shear modulus under this hypothesis; without it material.bulk_ratio"""
    pin_shape: PinShape | None = None
    """"bar" or "round" under this hypothesis; without it geometry.pin_shape"""
    sampling: BlockCells | None = None
    """numbers of elements (x, y, z), or { rings, layers, sectors }, for the runs that train the
    emulator under this hypothesis; without it mesh.sampling, else by the contact"""
    check: BlockCells | None = None
    """numbers of elements (x, y, z), or { rings, layers, sectors }, that measure the discretisation
    error under this hypothesis; without it mesh.check, else by the contact"""

    def __post_init__(self) -> None:
        check_size("sampling", self.sampling)
        check_size("check", self.check)
        for key in ("pin", "base"):
            if not _is_contact(getattr(self, key)):
                expected = "'stick', 'slide' or a coefficient of friction of 0 or more"
                raise Contradiction(key, getattr(self, key), expected)
        if self.law is not None:
            check_law("law", self.law)


def _is_contact(value: object) -> bool:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return 0.0 <= value <= sys.float_info.max  # whole numbers may be larger
    return value in ("stick", "slide")


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Noise:
    """[noise] What separates the measured mean force from that of the model."""

    load_cell_sd: Positive
    """standard deviation of the load cell's noise, N"""
    sample_correlation: Correlation
    """correlation of one sample's force errors at neighbouring increments"""
    correlation_study: tuple[Correlation, ...] = ()
    """correlations for which the posterior is computed for comparison"""
    travel_zero_sd: Annotated[float, Field(ge=0, le=10)]
    """standard deviation of the zero of the travel, mm (0 to 10)"""
    compliance_sd: Annotated[float, Field(ge=0, le=10)] = 0.0
    """standard deviation of the compliance of the machine that is left in the travel, mm/N (0 to
    10)"""
    face_travel_sd: Annotated[float, Field(ge=0, le=10)] = 0.0
    """standard deviation of the travel that the front face sees less that of the force, as of a
    tilted pin, mm (0 to 10)"""
    gain_sd: Share = 0.0
    """relative standard deviation of the load cell's calibration, below 1"""
    field_scale_sd: Share = 0.0
    """relative standard deviation of the scale of the measured field, below 1"""
    translation_sd: Annotated[float, Field(ge=0, le=10)] = 0.0
    """standard deviation of a rigid translation of the field at each increment, mm (0 to 10)"""
    rotation_sd: Annotated[float, Field(ge=0, le=10)] = 0.0
    """standard deviation of a small rotation of the field at each increment, degrees (0 to 10)"""
    force_freedom: Annotated[float, Field(ge=1)] | None = None
    """degrees of freedom, 1 or more, of a Student-t for the forces' errors; without it normal"""
    field_freedom: Annotated[float, Field(ge=1)] | None = None
    """degrees of freedom, 1 or more, of a Student-t for the field's noise; without it normal"""
    discrepancy: Annotated[float, Field(ge=0, le=10)] = 0.0
    """share (0 to 10) by which the model itself errs, where it is known; 0 is none"""
    discrepancy_of_force: Annotated[float, Field(ge=0, le=100)] | None = None
    """standard deviation of ln of the forces' common factor over that share, where it is known;
    without it 2, and known to a factor of two where the share has a prior"""
    discrepancy_length: Positive = LENGTH
    """distance over the front face over which a discrepancy is correlated, mm"""
    discrepancy_travel_length: Positive = TRAVEL_LENGTH
    """travel over which a discrepancy is correlated, mm"""

    @property
    def ratio(self) -> float:
        """That of the forces' common factor over the share, where no prior has it."""
        return COMMON if self.discrepancy_of_force is None else self.discrepancy_of_force

    def __post_init__(self) -> None:
        if self.discrepancy > 0 and self.force_freedom is not None:
            expected = "0 beside noise.force_freedom: both explain forces that are off"
            raise Contradiction("discrepancy", self.discrepancy, expected)
