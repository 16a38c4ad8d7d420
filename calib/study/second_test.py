"""The file of a second test, on which a calibration is validated. Units mm, N, MPa."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from calib.study.block_cells import check_size, finer_than, is_finer, shows_error
from calib.study.sections import (
    LARGEST,
    SMALLEST,
    VIRTUAL,
    Cells,
    Correlation,
    Count,
    Name,
    NotNegative,
    Positive,
    check_stiffness,
)
from calib.toml_file import Contradiction, FileRefused, read_document, read_file
from calib.toml_file.strict import STRICT
from fe.specimens.tensile import NotchedPlate

KIND = "file of a second test"
FIELD_GRID = (12, 18)
"""numbers of field points of a synthetic test that states none"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class SecondSource:
    """[data] What was measured on the second specimen."""

    source: str
    """"virtual", or a data set (.npz, as `calib qc` writes) beside the file"""

    def __post_init__(self) -> None:
        if self.source != VIRTUAL and not self.source.endswith(".npz"):
            raise Contradiction("source", self.source, f'"{VIRTUAL}" or the path of a .npz file')


@dataclass(frozen=True, kw_only=True, config=STRICT)
class SecondTruth:
    """[virtual] A synthetic second test; with data.source = "virtual"."""

    C10: NotNegative
    """true C10, MPa"""
    C01: NotNegative
    """true C01, MPa"""
    C11: NotNegative
    """true C11, MPa"""
    cells: Cells
    """three numbers of elements (x, y, z), finer than mesh.check"""
    n_samples: Annotated[int, Field(ge=2)]
    """number of samples pulled"""
    force_sd_share: Positive
    """standard deviation of the stiffness between samples as a share of it"""
    field_noise_std: tuple[Positive, Positive, Positive]
    """noise of the displacement components x, y, z, mm"""
    field_correlation_length: Positive
    """length over which the noise of neighbouring points is correlated, mm"""
    field_reference_share: Correlation
    """share of the noise variance that the reference image gives to all increments"""

    def __post_init__(self) -> None:
        check_stiffness(self.C10, self.C01)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class PlateSection:
    """[plate] The notched plate between its clamps."""

    width: Positive = 20.0
    """width (x), mm"""
    length: Positive = 30.0
    """length between the clamps (y), mm"""
    thickness: Positive = 2.5
    """thickness (z, towards the camera), mm"""
    notch_radius: Positive = 5.0
    """radius of the notches, mm"""
    notch_depth: Positive = 4.0
    """depth of the notches, less than their radius and half the width, mm"""

    def __post_init__(self) -> None:
        for name in ("width", "length", "thickness", "notch_radius"):
            least = SMALLEST if name in ("width", "length") else 0.0
            if not least <= getattr(self, name) <= LARGEST:
                expected = f"{least:g} to {LARGEST:g}: lengths are in mm"
                raise Contradiction(name, getattr(self, name), expected)
        try:
            self.specimen()
        except ValueError as error:
            key = str(error).partition(":")[0]
            raise Contradiction(key, getattr(self, key), "notches that leave a plate") from error

    def specimen(self) -> NotchedPlate:
        """As the forward model takes it."""
        return NotchedPlate(
            self.width, self.length, self.thickness, self.notch_radius, self.notch_depth
        )


@dataclass(frozen=True, kw_only=True, config=STRICT)
class SecondMesh:
    """[mesh] Elements of an eighth of the plate in x, y, z."""

    sampling: Cells = (4, 8, 1)
    """three numbers of elements (x, y, z) for the posterior draws"""
    check: Cells = (6, 12, 2)
    """three numbers of elements (x, y, z) of the one run that measures the error of the mesh"""

    def __post_init__(self) -> None:
        for key in ("sampling", "check"):
            check_size(key, getattr(self, key))
        if not shows_error(self.check, self.sampling):
            raise Contradiction("check", self.check, finer_than(self.sampling))


@dataclass(frozen=True, kw_only=True, config=STRICT)
class NamedConstants:
    """[[constants]] A point to compare with, without uncertainty."""

    name: str
    """what it is called in tables"""
    C10: float
    """MPa"""
    C01: float
    """MPa"""
    C11: float
    """MPa"""

    def __post_init__(self) -> None:
        if not self.C10 + self.C01 > 0.0:
            raise Contradiction("C10", self.C10, "more than -C01: the stiffness is positive")


@dataclass(frozen=True, kw_only=True, config=STRICT)
class SecondTest:
    """A test of another geometry and loading, and how a posterior is held against it."""

    name: Name
    """a name of letters, digits, hyphens and underscores"""
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    """seed from which every random draw follows"""
    control: Literal["force", "travel"] = "force"
    """what is set: "force" (N, and the travel is read) or "travel" (mm, and the force is read)"""
    levels: tuple[Positive, ...] = ()
    """forces (N) or travels (mm) that are set, increasing; with data.source = "virtual" only"""
    hypothesis: Name | None = None
    """whose posterior predicts; without it all hypotheses of the study, one after the other"""
    draws: Annotated[int, Field(ge=4)] = 24
    """number of posterior draws, one FE solve each"""
    judged: tuple[Literal["x", "y", "z"], ...] = ("x", "y")
    """components of the field that must meet the requirement, as in thesis 5.6"""
    max_error: Positive = 0.10
    """largest relative error that passes (requirement 8)"""
    min_r2: Annotated[float, Field(gt=0, lt=1)] = 0.95
    """smallest coefficient of determination that passes (requirement 8)"""
    data: SecondSource
    """a section [data]"""
    virtual: SecondTruth | None = None
    """a section [virtual], with data.source = "virtual" only"""
    plate: PlateSection = PlateSection()
    """a section [plate]"""
    mesh: SecondMesh = SecondMesh()
    """a section [mesh]"""
    field_grid: tuple[Count, Count] | None = None
    """numbers of field points across half the width and along half the length, 12 and 18 without
    it; with data.source = "virtual" only"""
    constants: tuple[NamedConstants, ...] = ()
    """any number of sections [[constants]]"""

    def __post_init__(self) -> None:
        is_virtual = self.data.source == VIRTUAL
        if is_virtual != (self.virtual is not None):
            expected = "a section [virtual] with data.source = 'virtual', and none without"
            raise Contradiction("virtual", self.virtual, expected)
        if is_virtual != bool(self.levels):
            expected = "levels with data.source = 'virtual'; those of a file are in it"
            raise Contradiction("levels", list(self.levels), expected)
        if self.field_grid is not None and not is_virtual:
            expected = "none: the model's field is at the points of the data"
            raise Contradiction("field_grid", list(self.field_grid), expected)
        if any(b <= a for a, b in zip(self.levels, self.levels[1:], strict=False)):
            raise Contradiction("levels", list(self.levels), "increasing numbers")
        if len(self.levels) == 1:
            raise Contradiction("levels", list(self.levels), "two or more")
        if self.virtual is not None:
            check_size("virtual.cells", self.virtual.cells)
            if not is_finer(self.virtual.cells, self.mesh.check):
                expected = f"a mesh finer than mesh.check {list(self.mesh.check)}"
                raise Contradiction("virtual.cells", self.virtual.cells, expected)
        names = [given.name for given in self.constants]
        for index, name in enumerate(names):
            if name in names[:index]:
                raise Contradiction(f"constants.{index}.name", name, "a name of its own")

    @property
    def grid(self) -> tuple[int, int]:
        """Numbers of field points of a synthetic test."""
        return FIELD_GRID if self.field_grid is None else self.field_grid


def embedded_tests() -> tuple[str, ...]:
    """Names of the second tests that come with the package."""
    folder = resources.files("calib.study") / "second_tests"
    names = (entry.name for entry in folder.iterdir() if entry.name.endswith(".toml"))
    return tuple(sorted(name.removesuffix(".toml") for name in names))


def load_second_test(test: str | Path) -> tuple[SecondTest, Path]:
    """Read and check a second test by the path of its file or the name of an embedded one.

    Returns it and the folder in which its data are looked for. Raises FileRefused, with the line,
    when it is missing, unreadable or wrong.
    """
    if str(test) in embedded_tests():
        resource = resources.files("calib.study") / "second_tests" / f"{test}.toml"
        content, file, folder = resource.read_bytes(), f"{test}.toml", Path()
    else:
        path = Path(test)
        if not path.exists():
            known = ", ".join(embedded_tests())
            raise FileRefused(f"{path}: found no such file, expected a {KIND} or one of {known}")
        content, file, folder = read_file(path, KIND), str(path), path.absolute().parent
    return read_document(content, file, KIND).checked(SecondTest), folder
