"""A TOML document, its dataclass, and refusals `FILE:LINE: key: found X, expected Y`."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, time
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from calib.toml_file.lines import Path as KeyPath
from calib.toml_file.lines import key_lines, nearest_line
from calib.toml_file.refusal import Refusal, refusals

LONGEST_FILE = 1_000_000  # bytes; these files are a page of text, anything longer is another file

_Checked = TypeVar("_Checked")


class FileRefused(ValueError):  # noqa: N818 - says what it is
    """A file that is missing, unreadable or wrong, with a one-sentence reason for its author."""


@dataclass(frozen=True)
class Document:
    """What one TOML file holds, and where."""

    file: str
    """name of the file as its author knows it"""
    values: Mapping[str, Any]
    lines: Mapping[KeyPath, int]
    """line of every key, table and array element"""

    def refuse(self, refusal: Refusal) -> FileRefused:
        """The error that says on which line of the file a rule is broken."""
        line = nearest_line(self.lines, refusal.path)
        return FileRefused(f"{self.file}:{line}: {refusal.key}: {refusal.reason}")

    def checked(self, section_type: type[_Checked]) -> _Checked:
        """The values as the pydantic dataclass `section_type`. Raises FileRefused."""
        for path, value in _dates(self.values):
            reason = f"found the date or time {value}, expected a number or a text in quotes"
            raise self.refuse(Refusal(path, reason))
        try:
            # strict pydantic takes arrays for tuples and tables for dataclasses from JSON only
            content = json.dumps(self.values)
            return TypeAdapter(section_type).validate_json(content)
        except ValidationError as error:
            found = _innermost(refusals(error, section_type))
            # a key that is absent may only be misspelt: the misspelling is what to say first
            first = min(found, key=lambda r: (r.is_absent, nearest_line(self.lines, r.path)))
            raise self.refuse(first) from error


def _dates(value: object, path: KeyPath = ()) -> Iterator[tuple[KeyPath, date | time]]:
    """Values that are dates or times in TOML, of which no key knows what to make."""
    if isinstance(value, (date, time)):
        yield path, value
    elif isinstance(value, Mapping):
        for key, below in value.items():
            yield from _dates(below, (*path, key))
    elif isinstance(value, list):
        for index, below in enumerate(value):
            yield from _dates(below, (*path, index))


def _innermost(found: Sequence[Refusal]) -> list[Refusal]:
    """Without what is refused only for something within it, as an array with no good item."""

    def holds(outer: KeyPath, inner: KeyPath) -> bool:
        return len(inner) > len(outer) and inner[: len(outer)] == outer

    return [one for one in found if not any(holds(one.path, other.path) for other in found)]


def read_file(path: Path, kind: str) -> bytes:
    """Bytes of the `kind` of file at `path`, one byte more than allowed at most.

    Raises FileRefused when it cannot be read.
    """
    if path.is_dir():
        raise FileRefused(f"{path}: found a folder, expected a {kind}")
    try:
        with path.open("rb") as stream:
            return stream.read(LONGEST_FILE + 1)
    except OSError as error:
        raise FileRefused(
            f"{path}: cannot be read ({error.strerror}), expected a {kind}"
        ) from error


def read_document(content: bytes, file: str, kind: str) -> Document:
    """Parse the bytes of the file called `file`, which should be of this `kind`.

    Raises FileRefused when they are too many, not UTF-8 or not TOML.
    """
    if len(content) > LONGEST_FILE:
        raise FileRefused(f"{file}: found more than {LONGEST_FILE} bytes, expected a {kind}")
    try:
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        raise FileRefused(
            f"{file}:{line}: found the byte 0x{byte:02x}, expected text saved as UTF-8"
        ) from error
    try:
        return Document(file, tomllib.loads(text), key_lines(text))
    except tomllib.TOMLDecodeError as error:
        place = re.search(r" \(at line (\d+), column \d+\)", str(error))
        line = int(place[1]) if place else text.count("\n") + 1
        reason = str(error).replace(place[0] if place else " (at end of document)", "")
        if reason == "Cannot overwrite a value":
            reason = "a key or section that is there already; one of several has double brackets"
        raise FileRefused(
            f"{file}:{line}: found no valid TOML ({reason}), expected key = value"
        ) from error
    except (RecursionError, ValueError) as error:  # arrays too deep, numbers too long for Python
        raise FileRefused(f"{file}: found TOML beyond what can be read ({error})") from error
