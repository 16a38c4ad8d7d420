"""Writing a study as the TOML file that gives it back."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path

from calib.study.artifacts import write_bytes
from calib.study.config import Study

STUDY_FILE = "study.toml"
"""in the folder of a run: the study that made it"""
OWN = "# Written by calib run"
"""how that file begins"""


def write_study(path: Path, study: Study) -> None:
    """Write `study` as TOML; `calib.study.load_study` reads the same study from it."""
    write_bytes(path, study_text(study).encode())


def name_in(path: Path) -> str | None:
    """The name in a study's file; None where it holds none that can be read."""
    try:
        name = tomllib.loads(path.read_text(encoding="utf-8")).get("name")
    except (OSError, ValueError):
        return None
    return name if isinstance(name, str) else None


def study_text(study: Study) -> str:
    """The study as TOML, without what is not set."""
    first = f"{OWN}: the study that made this folder. Units mm, N, MPa."
    document = asdict(study)
    document["hypothesis"] = document.pop("hypotheses")
    return "\n".join([first, *_table(document, ())]) + "\n"


def _table(table: Mapping[str, object], path: tuple[str, ...]) -> Iterator[str]:
    """Keys of one table, then the tables below it."""
    for key, value in table.items():
        if value is not None and not _is_table(value):
            yield f"{key} = {_value(value)}"
    for key, value in table.items():
        below = (*path, key)
        if isinstance(value, Mapping):
            yield from ("", f"[{'.'.join(below)}]", *_table(value, below))
        elif _is_table(value):
            assert isinstance(value, (list, tuple))
            for item in value:
                yield from ("", f"[[{'.'.join(below)}]]", *_table(item, below))


def _is_table(value: object) -> bool:
    if isinstance(value, (list, tuple)):
        return bool(value) and isinstance(value[0], Mapping)
    return isinstance(value, Mapping)


def _value(value: object) -> str:
    """A number, text, flag or array in TOML; JSON writes these the same way."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_value(item) for item in value)}]"
    return json.dumps(value, ensure_ascii=False)
