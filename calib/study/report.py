"""The report of a study: one HTML file that needs nothing else, pictures included."""

from __future__ import annotations

import base64
import importlib.metadata
import platform
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import jinja2

from calib import __version__
from calib.study.tables import Table

PACKAGES = ("numpy", "scipy", "scikit-fem", "pypardiso", "scikit-learn", "emcee", "arviz")
"""packages whose version can change the numbers"""


@dataclass(frozen=True)
class Picture:
    """A PNG and what it shows."""

    path: Path
    caption: str

    @property
    def base64(self) -> str:
        """The file's bytes for a data URI."""
        return base64.b64encode(self.path.read_bytes()).decode("ascii")


@dataclass(frozen=True)
class Section:
    """One heading of the report."""

    title: str
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = field(default_factory=tuple)


def render(
    *,
    study: str,
    seed: int,
    synthetic: str,
    failures: Sequence[str],
    unverified: Sequence[str],
    verdict: Sequence[str],
    sections: Sequence[Section],
    study_text: str,
) -> str:
    """The report as HTML.

    `synthetic` is the sentence that names synthetic data, empty for measured ones; `failures` are
    the diagnostics outside their limits, `unverified` the maxima that direct FE does not confirm,
    each one sentence.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("calib.study", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(
        study=study,
        seed=seed,
        version=__version__,
        synthetic=synthetic,
        failures=list(failures),
        unverified=list(unverified),
        verdict=list(verdict),
        sections=list(sections),
        study_text=study_text,
    )


def _version(package: str) -> str:
    """Of an installed package; pypardiso is not for every platform."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def versions_table() -> Table:
    """What the numbers were computed with."""
    rows = [("softcal", __version__), ("Python", platform.python_version())]
    rows += [(name, _version(name)) for name in PACKAGES]
    rows.append(("machine", f"{platform.system()} {platform.machine()}"))
    return Table("Versions", ("what", "version"), tuple(rows))
