"""Files that a study names, and what has to agree with their number."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from pathlib import Path

from calib.data.readers.name_numbers import counters, counts_files
from calib.data.readers.natural_order import natural_order
from calib.data.readers.wrong_file import check_link
from calib.dic import GreyImage, read_image
from calib.dic.images import check_sizes
from calib.toml_file import Contradiction


def named_files(
    names: tuple[str, ...], folder: Path, key: str, leave: set[str | None]
) -> tuple[Path, ...]:
    """Files in their order, * written out in the natural order of names, 9 before 10.

    Names in `leave` are left out of these.

    Raises Contradiction, at `key`, for a pattern that no file has, WrongFile for a link to nothing.
    """
    left_out = {(folder / one).resolve() for one in leave if one is not None}
    paths: list[Path] = []
    for name in names:
        if "*" not in name:
            paths.append(folder / name)
            continue
        # a name may be absolute, the folder's own name is not a pattern
        pattern = Path(name) if Path(name).is_absolute() else Path(glob.escape(str(folder))) / name
        matching = sorted(glob.glob(str(pattern), recursive=True), key=natural_order)
        for path in map(Path, matching):
            check_link(path, "an image")
        found = [p for p in map(Path, matching) if p.is_file() and p.resolve() not in left_out]
        if not found:
            but = " beside those of other keys" if left_out else ""
            raise Contradiction(key, name, f"the pattern of one or more files in {folder}{but}")
        paths += found
    return tuple(paths)


def check_series(key: str, paths: Sequence[Path], times: Sequence[float] | None) -> None:
    """Raises Contradiction when results of two images would have one name, and for times of
    another number than the images."""
    stems = [path.stem for path in paths]
    twice = next((stem for stem in stems if stems.count(stem) > 1), None)
    if twice is not None:
        raise Contradiction(key, twice, "each name once (without its ending): results bear it")
    if times is not None and len(times) != len(paths):
        raise Contradiction(
            "images.times_s", list(times), f"{len(paths)} times, one for each deformed image"
        )


def check_files(reference: GreyImage, paths: Sequence[Path]) -> None:
    """Sizes of all images before hours of work; raises ValueError for the first that differs."""
    for path in paths:
        check_sizes([reference, read_image(path)])


def number_doubt(left: Sequence[Path], right: Sequence[Path]) -> str | None:
    """Why numbers in the names tell of other pairs; None where they do not.

    As where each camera lacks a frame, another one: the numbers of a pair are no longer as far
    apart as those of others. Numbers that do not count images, as times, say nothing; nor do names
    that differ in more than their numbers, as those of a reference and of frames may.
    """
    ones, twos = (counters([path.stem for path in paths]) for paths in (left, right))
    if (
        not ones
        or len(ones) != len(twos)
        or not (counts_files(ones[-1]) and counts_files(twos[-1]))
    ):
        return None
    apart = [b - a for a, b in zip(ones[-1], twos[-1], strict=True)]
    for path, other, own in zip(left, right, apart, strict=True):
        if own != apart[0]:
            return (
                f"{path.name} is paired with {other.name}, other than {left[0].name} with "
                f"{right[0].name} by their numbers; does a camera lack a frame?"
            )
    return None
