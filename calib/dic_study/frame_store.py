"""Results of frames kept in px, so that an interrupted series goes on where it stopped.

A frame of one camera or of two: what each camera's series has come to is stored, and the next
frame starts from it with the same bits as if there had been no interruption.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from calib.dic import Correlation, GreyImage, State
from calib.dic.follow import Base
from calib.dic.settings import CorrelationSettings
from fe.atomic_file import replacing

Anything = npt.NDArray[Any]
VERSION = 4


def first_key(settings: CorrelationSettings, arrays: Sequence[Anything]) -> str:
    """Hash of what all frames follow from: reference images, masks, points and the like.

    Threads are left out: results do not depend on them.
    """
    content = asdict(settings)
    del content["threads"]
    return _key(json.dumps([VERSION, content], sort_keys=True), arrays)


def next_key(previous: str, images: Sequence[GreyImage]) -> str:
    """Hash of a frame: a frame starts from the one before, so its key holds that one's."""
    return _key(previous, [image.grey for image in images])


def _key(start: str, arrays: Sequence[Anything]) -> str:
    digest = hashlib.sha256(start.encode())
    for array in arrays:
        digest.update(repr((array.shape, array.dtype.str)).encode() + array.tobytes())
    return digest.hexdigest()


def save(path: Path, key: str, states: Sequence[State]) -> None:
    """Write what every camera's series has come to with a frame."""
    arrays = {}
    for camera, state in enumerate(states):
        assert state.last is not None
        for field in fields(Correlation):
            arrays[f"{field.name}_{camera}"] = getattr(state.last.found, field.name)
        # number of the renewed reference, 0 for none
        arrays[f"base_{camera}"] = np.array(0 if state.base is None else state.base.number)
    with replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, key=np.array(key), **arrays)


def load(
    path: Path, key: str, before: Sequence[State], images: Sequence[GreyImage]
) -> tuple[State, ...] | None:
    """The states after the frame with this key; None where there is no such whole file.

    `before` and `images`: states before it and its images, one a camera.
    """
    try:
        with np.load(path) as stored:
            if str(stored["key"]) != key:
                return None
            kept = {name: stored[name] for name in stored.files}
            return tuple(
                _state(kept, camera, state, image)
                for camera, (state, image) in enumerate(zip(before, images, strict=True))
            )
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _state(kept: dict[str, Anything], camera: int, before: State, image: GreyImage) -> State:
    number = 1 if before.last is None else before.last.number + 1
    found = Correlation(**{one.name: kept[f"{one.name}_{camera}"] for one in fields(Correlation)})
    last, base = Base(number, image.grey, found), int(kept[f"base_{camera}"])
    if base == 0:
        return State(last)
    # a renewed reference is that of the frame before, or that frame itself
    for known in (before.base, before.last):
        if known is not None and known.number == base:
            return State(last, known)
    raise ValueError(f"base_{camera}: expected a frame that is known, found number {base}")
