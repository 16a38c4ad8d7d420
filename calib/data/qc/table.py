"""A table of results, as aligned text and as csv."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

Cell = str | float | int


class QcTable(NamedTuple):
    """One table."""

    name: str
    """of its file"""
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


def table_text(table: QcTable) -> str:
    """Aligned text."""
    cells = [table.columns, *(tuple(_shown(c) for c in row) for row in table.rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(table.columns))]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    )
    return "\n".join([table.title, *lines])


def table_csv(table: QcTable) -> str:
    """Lines of a csv, numbers with all digits."""
    rows: Sequence[Sequence[Cell]] = [table.columns, *table.rows]
    return "".join(",".join(_csv(c) for c in row) + "\n" for row in rows)


def _shown(cell: Cell) -> str:
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def _csv(cell: Cell) -> str:
    if isinstance(cell, str):
        doubled = cell.replace('"', '""')
        return f'"{doubled}"' if any(mark in cell for mark in ',"\r\n') else cell
    return repr(float(cell)) if isinstance(cell, float) else str(cell)
