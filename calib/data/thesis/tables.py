"""The thesis' tables as printed: every digit, with units, source and what is wrong with them.

The thesis is "An Inverse Finite Element Method for Material Characterization of Small Hyperelastic
Samples", M.Eng., Stellenbosch University. Values that contradict each other or the thesis' formulas
are kept as printed; the notes of the table say so.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources

import numpy as np
import numpy.typing as npt

THESIS = (
    "An Inverse Finite Element Method for Material Characterization of Small Hyperelastic Samples, "
    "M.Eng. thesis, Stellenbosch University"
)


@dataclass(frozen=True)
class PublishedTable:
    """One table of the thesis. A column's unit is the end of its name: `average_N`, `rmse_mm`."""

    label: str
    """name in the thesis, e.g. `Table 3.3`, `Appendix E, EMX`"""
    title: str
    """title as printed"""
    section: str
    """section or appendix it stands in"""
    notes: tuple[str, ...]
    """what one has to know before using the values: gaps, and where they are inconsistent"""
    columns: Mapping[str, tuple[str, ...]]
    """name with unit -> (n_row,) cells as printed"""

    @property
    def source(self) -> str:
        """Where it was printed, in one line."""
        return f"{THESIS}, section {self.section}, {self.label}"

    def numbers(self, column: str) -> npt.NDArray[np.float64]:
        """Cells (n_row,) of one column as numbers, NaN where none is printed.

        Raises ValueError for an unknown column and for one that holds text.
        """
        cells = self.cells(column)
        try:
            return np.array(cells, dtype=np.float64)
        except ValueError:
            raise ValueError(
                f"{self.label}: {column}: found text, expected a column of numbers"
            ) from None

    def cells(self, column: str) -> tuple[str, ...]:
        """Cells (n_row,) of one column as printed. Raises ValueError for an unknown column."""
        if column not in self.columns:
            names = ", ".join(self.columns)
            raise ValueError(f"{self.label}: found column {column}, expected one of {names}")
        return self.columns[column]

    def matrix(self) -> npt.NDArray[np.float64]:
        """All columns but the first as numbers (n_row, n_column - 1): the fields of D to F."""
        return np.column_stack([self.numbers(name) for name in list(self.columns)[1:]])


def thesis_table(label: str) -> PublishedTable:
    """The table of this label, e.g. `Table 3.3`; `thesis_labels` lists them.

    Raises ValueError when there is no such table.
    """
    file = resources.files("calib.data.thesis").joinpath(f"{_file_stem(label)}.csv")
    if not file.is_file():
        labels = "; ".join(thesis_labels())
        raise ValueError(f"label: found {label}, expected one of: {labels}")
    return _parse(file.read_text(encoding="utf-8"))


def thesis_labels() -> tuple[str, ...]:
    """Labels of all tables that are packaged, by name of file."""
    folder = resources.files("calib.data.thesis")
    files = sorted(file.name for file in folder.iterdir() if file.name.endswith(".csv"))
    return tuple(_parse(folder.joinpath(name).read_text(encoding="utf-8")).label for name in files)


def _file_stem(label: str) -> str:
    return re.sub(r"\W+", "_", label.lower())


def _parse(text: str) -> PublishedTable:
    """A csv with `# key: value` lines on top."""
    lines = text.splitlines()
    head = [line[2:].partition(": ") for line in lines if line.startswith("#")]
    rows = list(csv.reader(line for line in lines if not line.startswith("#")))
    once = {key: value for key, _, value in head if key != "note"}
    return PublishedTable(
        label=once["label"],
        title=once["title"],
        section=once["section"],
        notes=tuple(value for key, _, value in head if key == "note"),
        columns=dict(zip(rows[0], zip(*rows[1:], strict=True), strict=True)),
    )
