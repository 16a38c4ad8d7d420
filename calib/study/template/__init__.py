"""What `calib init` writes: a commented study and example data that run as they are."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path

FILES = ("study.toml", "forces.csv")
_NAME_IN_TEMPLATE = 'name = "my-study"'


def write_template(folder: Path) -> list[Path]:
    """Write the template's files into `folder`, made if need be; the study is named after it.

    Raises:
        ValueError: `folder` is a file, or one of its files is already there; nothing is written
            then.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder}: found a file, expected a folder or a new name")
    targets = [folder / name for name in FILES]
    for target in targets:
        if target.exists():
            raise ValueError(f"{target}: found a file, expected a folder without one of that name")
    folder.mkdir(parents=True, exist_ok=True)
    for target in targets:
        text = (resources.files(__package__) / target.name).read_text(encoding="utf-8")
        text = text.replace(_NAME_IN_TEMPLATE, f'name = "{_study_name(folder)}"')
        with target.open("x", encoding="utf-8") as stream:
            stream.write(text)
    return targets


def _study_name(folder: Path) -> str:
    """The folder's name with what a study's name may not hold replaced by hyphens."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", folder.resolve().name).strip("-_")
    return name[:60] or "my-study"
