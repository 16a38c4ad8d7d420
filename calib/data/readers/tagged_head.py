"""The head of softcal's own csv files: a mark, then lines `# key: value`."""

from __future__ import annotations

import re
from collections.abc import Mapping

from calib.data.readers.source import Source
from calib.data.readers.wrong_file import WrongFile, shown

MAX_HEAD_LINES = 200
_LINE = re.compile(r"# ([^:]+): ?(.*)")

Head = dict[str, tuple[str, int]]
"""value and line, from 1, of each key"""


def head_lines(mark: str, values: Mapping[str, str | None]) -> list[str]:
    """Lines of a head; None values are left out.

    Raises ValueError for a key or value that would not come back as it is.
    """
    lines = [mark]
    for key, value in values.items():
        if value is None:
            continue
        line = f"# {key}: {value}"
        match = _LINE.fullmatch(line)
        if match is None or match.groups() != (key, value) or value != value.strip():
            raise ValueError(
                f"{key}: expected one line without a colon in the key, found {value!r}"
            )
        if len(line.splitlines()) > 1:
            raise ValueError(f"{key}: expected one line, found {value!r}")
        lines.append(line)
    return lines


def read_head(source: Source, mark: str, known: set[str] | None) -> tuple[Head, int]:
    """Values by key, and the index of the line after the head.

    Raises WrongFile for another first line, for a key that is not known (None: any) or comes
    twice, and for a file that ends with the head.
    """
    path = source.path
    first = source.first(1)
    if not first or first[0].strip() != mark:
        raise WrongFile(path, 1, shown(mark), shown(first[0] if first else ""))
    head: Head = {}
    for index, line in enumerate(source.lines[1 : MAX_HEAD_LINES + 1], start=1):
        if not line.startswith("#"):
            return head, index
        match = _LINE.fullmatch(line)
        key = match.group(1) if match else ""
        if match is None or key in head or (known is not None and key not in known):
            names = "" if known is None else f" with one of {', '.join(sorted(known))}, each once"
            raise WrongFile(path, index + 1, f"'# key: value'{names}", shown(line))
        head[key] = (match.group(2).strip(), index + 1)
    found = "the end of the file" if len(source.lines) <= MAX_HEAD_LINES else "more of the head"
    raise WrongFile(path, len(source.lines), "a line of column names", found)


def whole_number(source: Source, head: Head, key: str) -> int:
    """A count in the head; raises WrongFile where it is missing or none."""
    text, line = head.get(key, ("", 1))
    if not re.fullmatch(r"\d{1,9}", text, re.ASCII):
        raise WrongFile(source.path, line, f"a whole number after '# {key}:'", shown(text))
    return int(text)
