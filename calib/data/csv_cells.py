"""Text of a csv file and the cells of its lines."""

from __future__ import annotations

import csv
import re
from pathlib import Path


def csv_cells(path: Path, number: int, line: str) -> list[str]:
    """Stripped cells; raises ValueError naming path and line for a cell of endless length."""
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:
        longest = csv.field_size_limit()
        raise ValueError(
            f"{path}:{number}: found a cell of more than {longest} characters, expected numbers"
        ) from error


def csv_text(path: Path) -> str:
    """All of a file; raises ValueError naming it where it is no text that can be read."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        found = error.strerror or "none"
    except UnicodeDecodeError:
        found = "bytes that are no UTF-8"
    raise ValueError(f"{path}: expected a text file that can be read, found {found}")


def positive_number(cell: str) -> str:
    """What is expected of a cell that holds none."""
    has_comma = re.fullmatch(r"\s*[-+]?\d+,\d+\s*", cell, re.ASCII)
    return "a positive number with a decimal point" if has_comma else "a positive number"
