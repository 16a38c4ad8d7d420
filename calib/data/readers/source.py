"""A file on its way in: its bytes and lines, bounded before anything is parsed."""

from __future__ import annotations

import codecs
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from calib.data.readers.wrong_file import WrongFile

MAX_TEXT_BYTES = 128_000_000
MAX_LINES = 4_000_000
MAX_LINE_LENGTH = 100_000
MAX_CELLS = 40_000_000
"""values that one file may hold: 80 columns of 500,000 points"""
HEAD_BYTES = 200_000
"""what a format is recognised by"""
_BINARY_BYTES = 1024


@dataclass(frozen=True)
class Source:
    """One file; its head is read for recognition, all of it once its lines are asked for."""

    path: Path

    @cached_property
    def head(self) -> bytes:
        """The first bytes, enough to tell its format.

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
        lines = _split(_decoded(self.path, data))
        lengths = list(map(len, lines))
        longest = max(lengths, default=0)
        if longest > MAX_LINE_LENGTH:
            expected = f"at most {MAX_LINE_LENGTH:,} characters in a line"
            raise WrongFile(self.path, lengths.index(longest) + 1, expected, f"{longest:,}")
        return lines

    @cached_property
    def is_binary(self) -> bool:
        """Whether this is no text: a NUL byte near the start, and no mark of UTF-16."""
        return b"\0" in self.head[:_BINARY_BYTES] and not self.head.startswith(
            (b"\xff\xfe", b"\xfe\xff")
        )

    def first(self, n: int) -> list[str]:
        """Up to n lines from the head; none of a binary file."""
        return [] if self.is_binary else self._head_lines[:n]

    @cached_property
    def _head_lines(self) -> list[str]:
        """Lines of the head alone; the last may be cut."""
        is_utf_16 = self.head.startswith((b"\xff\xfe", b"\xfe\xff"))
        # incremental, as the head may end within a character
        decoder = codecs.getincrementaldecoder("utf-16" if is_utf_16 else "utf-8-sig")()
        try:
            return _split(decoder.decode(self.head))
        except UnicodeDecodeError:
            return _split(self.head.decode("latin-1"))

    def _bytes(self) -> bytes:
        try:
            with self.path.open("rb") as file:
                data = file.read(MAX_TEXT_BYTES + 1)
        except (OSError, ValueError) as error:
            raise _unreadable(self.path, error) from error
        if len(data) > MAX_TEXT_BYTES:
            raise WrongFile(self.path, None, f"at most {MAX_TEXT_BYTES:,} bytes of text", "more")
        return data


def _split(text: str) -> list[str]:
    """Lines of a text with any of the three ends of line."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if lines[-1] == "":
        lines.pop()
    return lines


def _unreadable(path: Path, error: Exception) -> WrongFile:
    reason = error.strerror if isinstance(error, OSError) else str(error)
    return WrongFile(path, None, "a readable file", f"none ({reason})")


def _check_size(path: Path, data: bytes) -> None:
    """Before decoding: as many objects as lines and cells will be made.

    A line or value takes a byte at least, so that small files need no count.
    """
    if len(data) <= MAX_LINES:
        return
    n_lines = max(data.count(b"\n"), data.count(b"\r"))
    if n_lines > MAX_LINES:
        raise WrongFile(path, None, f"at most {MAX_LINES:,} lines", f"{n_lines:,}")
    for mark in (b",", b";", b"\t", b" ") if len(data) > MAX_CELLS else ():
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
