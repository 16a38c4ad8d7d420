"""A study: everything that determines a calibration, read from one TOML file.

Every refusal is a `StudyError` of one sentence, `FILE:LINE: key: found X, expected Y`.
"""

from __future__ import annotations

import dataclasses
from importlib import resources
from pathlib import Path
from typing import Annotated

from pydantic import AliasChoices, Field
from pydantic.dataclasses import dataclass

from calib.study.block_cells import Cells, RingCells, refinement
from calib.study.data_checks import check_against_data
from calib.study.mesh_checks import check_meshes
from calib.study.population_checks import check_population
from calib.study.prior_sections import Prior
from calib.study.sections import (
    VIRTUAL,
    DataSource,
    Geometry,
    Hypothesis,
    Material,
    Mesh,
    Name,
    Noise,
    PinShape,
    Population,
    Positive,
    Virtual,
)
from calib.study.unknown_checks import check_unknowns
from calib.study.usual_meshes import UsualMeshes, usual_meshes
from calib.study.work_sections import Compute, Design, EmulatorLimits, Sampler, Verification
from calib.toml_file import (
    Contradiction,
    Document,
    FileRefused,
    Refusal,
    read_document,
    read_file,
    sentence,
)
from calib.toml_file.strict import STRICT

FILE = "experiment.toml"
FAR_HEIGHT = 3.0  # largest ratio of the heights that hypotheses give to one sample


class StudyError(ValueError):
    """A study that cannot be run, with a one-sentence reason for its author."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Study:
    """One calibration from data to posterior. Units mm, N, MPa."""

    name: Name
    """a name of letters, digits, hyphens and underscores"""
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    """seed from which every random draw follows"""
    increments: Annotated[tuple[Positive, ...], Field(min_length=2)]
    """two or more pin travels to compare at, increasing, mm"""
    data: DataSource
    """a section [data]"""
    virtual: Virtual | None = None
    """a section [virtual], with data.source = "virtual" only"""
    geometry: Geometry
    """a section [geometry]"""
    material: Material = Material()
    """a section [material]"""
    mesh: Mesh = Mesh()
    """a section [mesh]"""
    hypotheses: Annotated[tuple[Hypothesis, ...], Field(min_length=1)] = Field(
        validation_alias=AliasChoices("hypothesis", "hypotheses")
    )
    """one or more sections [[hypothesis]]"""
    noise: Noise
    """a section [noise]"""
    prior: Prior
    """sections [prior.kappa], [prior.r], [prior.s] and those of further unknowns"""
    design: Design = Design()
    """a section [design]"""
    emulator: EmulatorLimits = EmulatorLimits()
    """a section [emulator]"""
    population: Population | None = None
    """a section [population], with data.level = "samples" only"""
    sampler: Sampler = Sampler()
    """a section [sampler]"""
    verification: Verification = Verification()
    """a section [verification]"""
    compute: Compute = Compute()
    """a section [compute]"""

    def __post_init__(self) -> None:
        self._check_increments()
        self._check_hypotheses()
        self._check_virtual()
        check_meshes(self)
        check_unknowns(self)
        check_population(self)

    def sampling_cells(self, hypothesis: Hypothesis) -> Cells | RingCells:
        """Mesh of the runs that train the emulator under a hypothesis."""
        return hypothesis.sampling or self.mesh.sampling or self._usual(hypothesis).sampling

    def check_cells(self, hypothesis: Hypothesis) -> Cells | RingCells:
        """Mesh that measures the discretisation error under a hypothesis."""
        return hypothesis.check or self.mesh.check or self._usual(hypothesis).check

    def refinement(self, hypothesis: Hypothesis) -> float:
        """Edge of the sampling mesh's elements over that of the checking mesh's."""
        return refinement(self.check_cells(hypothesis), self.sampling_cells(hypothesis))

    def height(self, hypothesis: Hypothesis) -> float:
        """Height of the sample under a hypothesis, mm."""
        return self.geometry.height if hypothesis.height is None else hypothesis.height

    def bulk_ratio(self, hypothesis: Hypothesis) -> float:
        """Bulk modulus over shear modulus under a hypothesis."""
        own = hypothesis.bulk_ratio
        return self.material.bulk_ratio if own is None else own

    def pin_shape(self, hypothesis: Hypothesis) -> PinShape:
        """Shape of the pin under a hypothesis."""
        return hypothesis.pin_shape or self.geometry.pin_shape

    def _usual(self, hypothesis: Hypothesis) -> UsualMeshes:
        return usual_meshes(hypothesis, self.pin_shape(hypothesis))

    def _check_increments(self) -> None:
        previous = 0.0
        # The bounds of an unknown height are held against the increments by `check_unknowns`.
        lowest = min(self.height(hypothesis) for hypothesis in self.hypotheses)
        for index, travel in enumerate(self.increments):
            key = f"increments.{index}"
            if travel <= previous:
                raise Contradiction(key, travel, f"more than the increment before ({previous:g})")
            if travel >= lowest:
                raise Contradiction(key, travel, f"less than the sample's height ({lowest:g} mm)")
            previous = travel

    def _check_hypotheses(self) -> None:
        names: set[str] = set()
        for index, hypothesis in enumerate(self.hypotheses):
            if hypothesis.name in names:
                key = f"hypothesis.{index}.name"
                raise Contradiction(key, hypothesis.name, "a name that no other hypothesis has")
            names.add(hypothesis.name)
            ratio = self.height(hypothesis) / self.geometry.height
            if not 1 / FAR_HEIGHT <= ratio <= FAR_HEIGHT:
                key = f"hypothesis.{index}.height"
                expected = f"within a factor {FAR_HEIGHT:g} of geometry.height"
                expected += f" ({self.geometry.height:g} mm): hypotheses are about one sample"
                raise Contradiction(key, hypothesis.height, expected)

    def _check_virtual(self) -> None:
        virtual = self.virtual
        if virtual is None:
            if self.data.source == VIRTUAL:
                raise Contradiction("data.source", VIRTUAL, "a section [virtual] with it")
            return
        if self.data.source != VIRTUAL:
            raise Contradiction("virtual", {}, f"none with data.source = {self.data.source!r}")
        names = [hypothesis.name for hypothesis in self.hypotheses]
        if virtual.hypothesis not in names:
            expected = "one of the hypotheses " + ", ".join(names)
            raise Contradiction("virtual.hypothesis", virtual.hypothesis, expected)


def embedded_studies() -> dict[str, str]:
    """Names and first comment lines of the studies that come with the package."""
    folder = resources.files("calib.study") / "embedded"
    texts = {
        entry.name.removesuffix(".toml"): entry.read_text(encoding="utf-8")
        for entry in folder.iterdir()
        if entry.name.endswith(".toml")
    }
    return {name: texts[name].partition("\n")[0].lstrip("# ") for name in sorted(texts)}


def load_study(study: str | Path, *, with_data: bool = True) -> Study:
    """Read and check a study by the path of its file or the name of an embedded one.

    The path of a data file is made absolute, and the increments are looked up in it; not so without
    `with_data`, as of a finished study, which keeps its data; but for experiments with a field.

    Raises:
        StudyError: the study is missing, unreadable or wrong; the message says where.
    """
    content, file, folder = _content_of(study)
    return read_study(content, file=file, folder=folder, with_data=with_data)


def refused(study: str | Path, error: Contradiction) -> StudyError:
    """The error by file and line of a study, loaded before, that its synthetic data contradict.

    Raises:
        StudyError: the study is no longer there or no TOML.
    """
    content, file, _ = _content_of(study)
    try:
        document = read_document(content, file, "study file")
    except FileRefused as unreadable:
        raise StudyError(str(unreadable)) from unreadable
    return StudyError(str(document.refuse(error.refusal())))


def _content_of(study: str | Path) -> tuple[bytes, str, Path]:
    """Bytes of a study, the name of its file and the folder of its data. Raises StudyError."""
    if isinstance(study, str) and study in embedded_studies():
        resource = resources.files("calib.study") / "embedded" / f"{study}.toml"
        return resource.read_bytes(), f"{study}.toml", Path()
    path = Path(study)
    if not path.exists():
        known = ", ".join(embedded_studies())
        raise StudyError(f"{path}: found no such file, expected a study file or one of {known}")
    try:
        return read_file(path, "study file"), str(path), path.absolute().parent
    except FileRefused as error:
        raise StudyError(str(error)) from error


def read_study(content: bytes, *, file: str, folder: Path, with_data: bool = True) -> Study:
    """Check the bytes of a study file called `file`; data are looked for in `folder`, if at all.

    Raises:
        StudyError: see `load_study`.
    """
    try:
        return _read_study(read_document(content, file, "study file"), folder, with_data)
    except FileRefused as error:
        raise StudyError(str(error)) from error


def _read_study(document: Document, folder: Path, with_data: bool) -> Study:
    if "hypotheses" in document.values:  # the field's name in Python; a file has one way to say it
        reason = "found an unknown key, expected sections [[hypothesis]]"
        raise document.refuse(Refusal(("hypotheses",), reason))
    study = document.checked(Study)
    # the points of an experiment's field are read from its folder, whatever is asked
    if not with_data and not (study.data.is_experiment and study.data.has_field):
        return study
    if study.data.is_file:
        path = _existing(folder, study.data.source, "")
        if path is None:
            reason = sentence(study.data.source, f"a file in {folder}")
            raise document.refuse(Refusal(("data", "source"), reason))
        source = dataclasses.replace(study.data, source=str(path))
        study = dataclasses.replace(study, data=source)
    if study.data.folder is not None:
        path = _existing(folder, study.data.folder, FILE)
        if path is None:
            reason = sentence(study.data.folder, f"a folder in {folder} with {FILE}")
            raise document.refuse(Refusal(("data", "folder"), reason))
        source = dataclasses.replace(study.data, folder=str(path))
        study = dataclasses.replace(study, data=source)
    try:
        check_against_data(study)
    except Contradiction as error:
        raise document.refuse(error.refusal()) from error
    except ValueError as error:  # of the data file, which names its own line
        raise StudyError(str(error)) from error
    return study


def _existing(folder: Path, name: str, within: str) -> Path | None:
    """What a study calls `name`, absolute; None where there is no such file, or none `within`."""
    try:
        path = (folder / name).resolve()
        return path if (path / within).is_file() else None
    except (OSError, ValueError):  # a name too long, or with a character that no name has
        return None
