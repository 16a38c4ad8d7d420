"""Why a file was refused: the key, what was found and what was expected, in one sentence."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import AliasChoices, ValidationError
from pydantic.fields import FieldInfo

from calib.toml_file.lines import Path

_LONGEST_VALUE = 60


class Contradiction(ValueError):  # noqa: N818 - says what it is
    """A value that its type allows but the rest of its section does not.

    `key` is the dotted key below the section that refuses; `found` is None when it is absent.
    """

    def __init__(self, key: str, found: object, expected: str) -> None:
        super().__init__(f"{key}: {sentence(found, expected)}")
        self.key = key
        self.found = found
        self.expected = expected

    def refusal(self, section: Path = ()) -> Refusal:
        """The same with the path from the top of the file, `section` being its start."""
        keys = (int(part) if part.isdigit() else part for part in self.key.split("."))
        return Refusal((*section, *keys), sentence(self.found, self.expected))


@dataclass(frozen=True)
class Refusal:
    """One broken rule of a file."""

    path: Path
    """keys and indices from the top of the file"""
    reason: str
    """found X, expected Y"""
    is_absent: bool = False
    """a key that has to be there is not"""

    @property
    def key(self) -> str:
        """The path as one writes it, e.g. `hypothesis[1].pin`."""
        text = ""
        for part in self.path:
            text += f"[{part}]" if isinstance(part, int) else f".{part}"
        return text.removeprefix(".")


def sentence(found: object, expected: str) -> str:
    """`found X, expected Y` with X written as in TOML and cut when long."""
    return f"found {_shown(found)}, expected {expected}"


def refusals(error: ValidationError, section_type: type) -> list[Refusal]:
    """The broken rules behind a pydantic `error` about data for the dataclass `section_type`."""
    return [_refusal(detail, section_type) for detail in error.errors(include_url=False)]


def _refusal(detail: Mapping[str, Any], section_type: type) -> Refusal:
    # <...> names an alternative of a union, which is no key of the file
    path: Path = tuple(part for part in detail["loc"] if not str(part).startswith("<"))
    kind = detail["type"]
    found = detail["input"]
    cause = detail.get("ctx", {}).get("error")
    if isinstance(cause, Contradiction):
        return cause.refusal(section=path)
    if kind == "unexpected_keyword_argument":
        keys = ", ".join(_fields_at(section_type, path[:-1]))
        return Refusal(path, f"found an unknown key, expected one of {keys}")
    meaning = _meaning(section_type, path)
    if kind == "missing" and isinstance(path[-1], str):
        return Refusal(path, f"found nothing, expected {meaning}", is_absent=True)
    if kind == "missing":  # of an array that is too short
        return Refusal(path[:-1], sentence(found, meaning))
    # [name] where [[name]] is meant is told by the meaning, which shows how it is written
    is_single = kind == "tuple_type" and isinstance(found, Mapping)
    if is_single or kind in _SAID_BY_MEANING:
        return Refusal(path, sentence(found, meaning))
    expected = _EXPECTED.get(kind) or str(detail["msg"]).removeprefix("Input should be ")
    return Refusal(path, sentence(found, f"{expected} ({meaning})"))


_SAID_BY_MEANING = {"string_pattern_mismatch", "string_too_long", "too_long", "too_short"}
_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text in quotes",
    "tuple_type": "an array",
    "dataclass_type": "a table",
}


def _shown(value: object) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, Mapping):
        return "a table"
    text = json.dumps(value, ensure_ascii=False, default=str)
    if len(text) <= _LONGEST_VALUE:
        return text
    # The end of a path says more than its beginning.
    half = _LONGEST_VALUE // 2
    return f"{text[:half]}...{text[-half:]}"


def _meaning(section_type: type, path: Path) -> str:
    """The docstring under the field that `path` leads to or into."""
    keys = [part for part in path if isinstance(part, str)]
    field = _fields_at(section_type, tuple(keys[:-1])).get(keys[-1]) if keys else None
    said = field.description if field else None
    return " ".join(said.split()) if said else "a value"  # on one line, however long


def _fields_at(section_type: type, path: Path) -> dict[str, FieldInfo]:
    """Fields of the section that `path` leads to, by their key in the file."""
    fields = _fields(section_type)
    for key in path:
        if isinstance(key, str):
            fields = _fields(_section_type(fields[key].annotation)) if key in fields else {}
    return fields


def _fields(section_type: object) -> dict[str, FieldInfo]:
    declared: dict[str, FieldInfo] = getattr(section_type, "__pydantic_fields__", {})
    return {_key(name, field): field for name, field in declared.items()}


def _key(name: str, field: FieldInfo) -> str:
    """The field's key in the file: its first alias if it has any."""
    alias = field.validation_alias
    return str(alias.choices[0]) if isinstance(alias, AliasChoices) else name


def _section_type(annotation: object) -> object:
    """The dataclass within `Section`, `Section | None`, `tuple[Section, ...]` or a union."""
    for part in get_args(annotation):
        inner = _section_type(part)
        if hasattr(inner, "__pydantic_fields__"):
            return inner
    return annotation
