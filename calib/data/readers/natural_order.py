"""Order of names with numbers in them: frame 10 comes after frame 9."""

from __future__ import annotations

import re


def natural_order(name: str) -> tuple[list[tuple[int, str]], str]:
    """What names are sorted by: the name with its numbers as numbers, then as it is.

    So that 1 and 01, as names of two files, have an order, too, wherever they are listed.
    """
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], name
