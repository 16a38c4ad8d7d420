"""Images of two cameras go together by the numbers in their names."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.dic_study.named_files import number_doubt


def named(side: str, numbers: list[int]) -> list[Path]:
    return [Path(f"{side}_{number:04d}.tif") for number in numbers]


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ([1, 2, 3], [1, 2, 3]),
        ([1, 3, 5], [2, 4, 6]),  # one counter for both
        ([0, 1, 2], [1, 2, 3]),  # one camera counts from 1
        ([1001, 2003, 3004], [1002, 2002, 3006]),  # times
    ],
)
def test_numbers_that_go_together_or_say_nothing_are_taken(
    left: list[int], right: list[int]
) -> None:
    assert number_doubt(named("left", left), named("right", right)) is None
    assert number_doubt([Path("a.tif")] * 3, named("right", right)) is None


@pytest.mark.parametrize("end", ["", "_0"])  # some programs name the camera last
def test_frames_that_each_camera_lacks_are_told(end: str) -> None:
    left, right = (
        [path.with_stem(path.stem + end) for path in named(side, numbers)]
        for side, numbers in (("left", [1, 2, 4, 5]), ("right", [1, 2, 3, 5]))
    )
    found = number_doubt(left, right)
    assert found is not None
    assert found.startswith(f"left_0004{end}.tif is paired with right_0003{end}.tif")


def test_a_reference_with_a_name_of_its_own_tells_nothing() -> None:
    left, right = named("cam1", [1, 2]), named("cam2", [1, 2])
    assert number_doubt([Path("ref_1.tif"), *left], [Path("ref_2.tif"), *right]) is None
    assert number_doubt(named("cam1", [0, 1, 2]), named("cam2", [0, 2, 3])) is not None
