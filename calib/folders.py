"""What is asked of folders that a verb is given, before the work for them is done."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

LOCK = ".lock"
"""empty file of a run's folder, locked as long as a process works in it, however that ends"""


def check_folder(option: str, path: Path) -> None:
    """Raise ValueError where a file stands in place of the folder of an option, or of one above."""
    nearest = next((place for place in (path, *path.parents) if _exists(place)), None)
    if nearest is not None and not nearest.is_dir():
        raise ValueError(f"{option}: found the file {nearest}, expected a folder or a new name")


def _exists(path: Path) -> bool:
    """Whether there is something; where that cannot be asked, making it will say why."""
    try:
        return path.exists()
    except OSError:
        return False


def make_folder(option: str, path: Path) -> None:
    """Make the folder of an option. Raises ValueError of one sentence where that cannot be."""
    check_folder(option, path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f"{option}: {path} cannot be made ({error.strerror}), expected a folder or a new name"
        ) from error
    check_writable(option, path)


def check_writable(option: str, path: Path) -> None:
    """Raise ValueError where a folder cannot be written to, before the work for it is done."""
    if path.is_dir() and not os.access(path, os.W_OK | os.X_OK):
        raise ValueError(f"{option}: found {path}, expected a folder that can be written to")


@contextmanager
def held_alone(option: str, path: Path) -> Iterator[None]:
    """Keep other runs out of a folder meanwhile. Raises ValueError where one is at work in it."""
    with ExitStack() as stack:
        try:
            file = stack.enter_context((path / LOCK).open("ab"))
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if isinstance(error, BlockingIOError):
                raise ValueError(
                    f"{option}: found {path}, in which another `calib` is at work, expected "
                    "another folder, or this one once that has ended"
                ) from None
            # Of a file system without locks, or a folder about which results will say it.
        yield
