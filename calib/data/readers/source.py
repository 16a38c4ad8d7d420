"""A file on its way in: its bytes and lines, bounded before anything is parsed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from calib.data.readers.wrong_file import WrongFile

MAX_TEXT_BYTES = 128_000_000
MAX_LINES = 4_000_000
MAX_LINE_LENGTH = 100_000
MAX_CELLS = 40_000_000
"""values that one file may hold: 80 columns of 500,000 points"""
HEAD_BYTES = 1024


@dataclass(frozen=True)
class Source:
    """One file; read once, when its lines are asked for."""

    path: Path

    @cached_property
    def head(self) -> bytes:
        """The first bytes, enough to tell a binary format.

        Raises WrongFile where the file cannot be read.
        """
        try:
            with self.path.open("rb") as file:
                return file.read(HEAD_BYTES)
        except (OSError, ValueError) as error:
            raise _unreadable(self.path, error) from error

    @cached_property
    def lines(self) -> list[str]:
        """Lines without their ends; UTF-8 or UTF-16 with its mark, else Latin-1.

        Raises WrongFile for binary files and for files beyond the limits of this module.
        """
        data = self._bytes()
        _check_size(self.path, data)
        text = _decoded(self.path, data)
        lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        if lines[-1] == "":
            lines.pop()
        for number, line in enumerate(lines, start=1):
            if len(line) > MAX_LINE_LENGTH:
                expected = f"at most {MAX_LINE_LENGTH:,} characters in a line"
                raise WrongFile(self.path, number, expected, f"{len(line):,}")
        return lines

    @cached_property
    def is_binary(self) -> bool:
        """Whether this is no text: a NUL byte near the start, and no mark of UTF-16."""
        return b"\0" in self.head and not self.head.startswith((b"\xff\xfe", b"\xfe\xff"))

    def first(self, n: int) -> list[str]:
        """Up to n lines from the start; none of a binary file."""
        return [] if self.is_binary else self.lines[:n]

    def _bytes(self) -> bytes:
        try:
            with self.path.open("rb") as file:
                data = file.read(MAX_TEXT_BYTES + 1)
        except (OSError, ValueError) as error:
            raise _unreadable(self.path, error) from error
        if len(data) > MAX_TEXT_BYTES:
            raise WrongFile(self.path, None, f"at most {MAX_TEXT_BYTES:,} bytes of text", "more")
        return data


def _unreadable(path: Path, error: Exception) -> WrongFile:
    reason = error.strerror if isinstance(error, OSError) else str(error)
    return WrongFile(path, None, "a readable file", f"none ({reason})")


def _check_size(path: Path, data: bytes) -> None:
    """Before decoding: as many objects as lines and cells will be made."""
    n_lines = data.count(b"\n") + data.count(b"\r")
    if n_lines > 2 * MAX_LINES:
        raise WrongFile(path, None, f"at most {MAX_LINES:,} lines", f"{n_lines:,}")
    for mark in (b",", b";", b"\t", b" "):
        n_cells = data.count(mark)
        if n_cells > MAX_CELLS:
            raise WrongFile(path, None, f"at most {MAX_CELLS:,} values", f"{n_cells:,}")


def _decoded(path: Path, data: bytes) -> str:
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return data.decode("utf-16")
        except UnicodeDecodeError as error:
            raise WrongFile(path, None, "text in UTF-16 as its mark says", "other bytes") from error
    nul = data.find(b"\0")
    if nul >= 0:
        line = data.count(b"\n", 0, nul) + 1
        raise WrongFile(path, line, "text", "a NUL byte, as in a binary file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        # DaVis writes the degree sign in Latin-1; every byte has a meaning there
        return data.decode("latin-1")
