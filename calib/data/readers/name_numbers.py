"""Numbers in the names of a series of files, some of which count them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

SPARSE = 3
"""times the number of files that numbers which count them may span; times of day span more"""


def shape_of(name: str) -> str:
    """The name with each of its numbers as one sign, by which names of one series are alike."""
    return re.sub(r"\d+", "#", name, flags=re.ASCII)


def counters(names: Sequence[str]) -> list[list[int]]:
    """Numbers that count up with the names, place by place; none where these have other shapes.

    What is the same in all, as the number of a camera, and what goes up and down is left out.
    """
    if len({shape_of(name) for name in names}) != 1:
        return []
    rows = [[int(found) for found in re.findall(r"\d+", name, re.ASCII)] for name in names]
    columns = [list(column) for column in zip(*rows, strict=True)]
    return [column for column in columns if all(b > a for a, b in pairwise(column))]


def counts_files(numbers: Sequence[int]) -> bool:
    """Whether numbers that go up may count their files, some of which may lack."""
    return numbers[-1] - numbers[0] <= SPARSE * len(numbers)
