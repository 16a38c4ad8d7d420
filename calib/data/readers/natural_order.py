"""Order of names with numbers in them: frame 10 comes after frame 9."""

from __future__ import annotations

import re


def natural_order(name: str) -> list[tuple[int, str]]:
    """What names are sorted by: the name with its numbers as numbers."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]
