"""The sections of a study file that say what data are used, and how samples differ.

The text under a field is also what a refusal says it expects.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from calib.data.qc.rules import Rules
from calib.toml_file.refusal import Contradiction
from calib.toml_file.strict import STRICT

THESIS_TABLE = "thesis-table-5.1"
VIRTUAL = "virtual"
EXPERIMENT = "experiment"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class DataSource:
    """[data] What was measured."""

    source: str
    """where the data come from: a data set of the package, "experiment" or a csv file beside the
    study file"""
    folder: str | None = None
    """folder of a laboratory's files, with the source "experiment" only"""
    level: Literal["mean", "summary", "samples"] = "mean"
    """the averaged sample, mean and SD of its forces alone, or every sample by itself"""
    quality: Rules | None = None
    """a section [data.quality] of rules that go before those of experiment.toml, with the source
    "experiment" only"""

    def __post_init__(self) -> None:
        if self.is_file and not self.source.endswith(".csv"):
            expected = f'"{THESIS_TABLE}", "{VIRTUAL}", "{EXPERIMENT}" or the path of a .csv file'
            raise Contradiction("source", self.source, expected)
        if self.is_experiment != (self.folder is not None):
            expected = f"a folder with source = {EXPERIMENT!r}, and none without"
            raise Contradiction("folder", self.folder, expected)
        if self.quality is not None and not self.is_experiment:
            raise Contradiction("quality", {}, f"none without source = {EXPERIMENT!r}")

    @property
    def is_file(self) -> bool:
        """True when the data are a file of the user's (`source` is then its path)."""
        return self.source not in {THESIS_TABLE, VIRTUAL, EXPERIMENT}

    @property
    def is_experiment(self) -> bool:
        """True when the data are made of a laboratory's files in `folder`."""
        return self.source == EXPERIMENT

    @property
    def has_field(self) -> bool:
        """True when there is a displacement field that is used."""
        return self.source in {VIRTUAL, EXPERIMENT} and self.level != "summary"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Population:
    """[population] What differs between samples; with data.level = "samples"."""

    scatter: Annotated[dict[str, Annotated[float, Field(gt=0)]], Field(min_length=1)]
    """one or more parameters with the sizes (above 0) of the priors of their SDs between samples"""
    freedom: Annotated[float, Field(gt=0)] | None = None
    """degrees of freedom (above 0) where these priors are halves of Student-t, not of normals"""
    travel_zero_sd: Annotated[float, Field(ge=0)] = 0.015
    """standard deviation of the zero of one sample's travel about that of all, mm"""
