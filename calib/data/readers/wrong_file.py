"""Why a file was refused: path, line, expected, found, in one sentence."""

from __future__ import annotations

from pathlib import Path

_LONGEST_FOUND = 80


class WrongFile(ValueError):  # noqa: N818 - says what it is
    """A file that does not hold what its format promises; the only exception readers raise.

    `line` counts from 1; None where a line has no meaning (binary files, whole folders).
    """

    def __init__(self, path: Path, line: int | None, expected: str, found: str) -> None:
        place = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{place}: expected {expected}, found {found}")
        self.path = path
        self.line = line
        self.expected = expected
        self.found = found

    def __reduce__(self) -> tuple[type[WrongFile], tuple[Path, int | None, str, str]]:
        return WrongFile, (self.path, self.line, self.expected, self.found)


def shown(text: object) -> str:
    """Text of a file as it goes into a sentence: quoted, on one line, cut when long."""
    whole = str(text)
    if len(whole) <= _LONGEST_FOUND:
        return repr(whole)
    return f"{whole[:_LONGEST_FOUND]!r}..."


def check_link(path: Path, expected: str) -> None:
    """Raise WrongFile for a link to what is not there, which would pass for nothing."""
    if path.is_symlink() and not path.exists():
        raise WrongFile(path, None, expected, f"a link to nothing ({path.readlink()})")
