"""Names and units of columns, as in `x [mm]`, `Force (kN)` or `x`."""

from __future__ import annotations

from dataclasses import dataclass

from calib.data.readers.number_table import cells
from calib.data.readers.source import Source
from calib.data.readers.wrong_file import WrongFile, shown

_BRACKETS = {"]": "[", ")": "("}


@dataclass(frozen=True)
class Column:
    """One column of a header."""

    index: int
    name: str
    """without its unit"""
    unit: str | None
    """None where the header has no brackets"""
    text: str
    """as it stands in the file"""


def columns_of(header: list[str]) -> list[Column]:
    """The columns of a header line."""
    return [_column(index, text) for index, text in enumerate(header)]


def _column(index: int, text: str) -> Column:
    """Name and what stands in the last brackets, if the text ends with them."""
    opening = _BRACKETS.get(text[-1:])
    start = text.rfind(opening) if opening else -1
    if start < 0:
        return Column(index, text, None, text)
    return Column(index, text[:start].rstrip(), text[start + 1 : -1].strip(), text)


class Names:
    """Columns by name; a name may be written in several ways."""

    def __init__(self, source: Source, line: int, header: list[str], fold: bool = True) -> None:
        self.source = source
        self.line = line
        self.fold = fold
        """whether X and x are one name"""
        self.columns = columns_of(header)

    def get(self, *names: str) -> Column | None:
        """The column with one of these names, or None.

        Raises WrongFile where two columns have the name.
        """
        wanted = {name.lower() for name in names} if self.fold else set(names)
        found = [c for c in self.columns if (c.name.lower() if self.fold else c.name) in wanted]
        if len(found) > 1:
            raise WrongFile(
                self.source.path, self.line, f"one column {shown(names[0])}", f"{len(found)}"
            )
        return found[0] if found else None

    def need(self, *names: str) -> Column:
        """The column with one of these names.

        Raises WrongFile where there is none, or more than one.
        """
        column = self.get(*names)
        if column is None:
            header = ", ".join(column.text for column in self.columns)
            raise WrongFile(
                self.source.path, self.line, f"a column {shown(names[0])}", shown(header)
            )
        return column


def names_in(line: str, separator: str | None, fold: bool = True) -> set[str]:
    """Names of a header line without units, for recognising a format."""
    names = (column.name for column in columns_of(cells(line, separator)))
    return {name.lower() for name in names} if fold else set(names)


def separator_of(line: str) -> str | None:
    """The mark that separates the cells of a header line: `;`, tab or `,`, else blanks."""
    for mark in (";", "\t", ","):
        if mark in line:
            return mark
    return None
