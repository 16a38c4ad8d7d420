"""Results of frames kept in px, so that an interrupted series goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
import zipfile
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np

from calib.dic import Correlation, GreyImage
from calib.dic.prepared import BoolArray
from calib.dic.settings import CorrelationSettings
from fe.atomic_file import replacing
from fe.response import Array

VERSION = 1


def first_key(
    reference: GreyImage, mask: BoolArray, points: Array, settings: CorrelationSettings
) -> str:
    """Hash of what all frames follow from. Threads are left out: results do not depend on them."""
    content = asdict(settings)
    del content["threads"]
    digest = hashlib.sha256(json.dumps([VERSION, content], sort_keys=True).encode())
    for array in (reference.grey, mask.astype(np.float64), points):
        digest.update(repr(array.shape).encode() + array.tobytes())
    return digest.hexdigest()


def next_key(previous: str, image: GreyImage) -> str:
    """Hash of a frame: a frame starts from the one before, so its key holds that one's."""
    digest = hashlib.sha256(previous.encode())
    digest.update(repr(image.grey.shape).encode() + image.grey.tobytes())
    return digest.hexdigest()


def save(path: Path, key: str, base: int, found: Correlation) -> None:
    """Write a frame's result. base: number of the renewed reference, 0 for none."""
    arrays = {field.name: getattr(found, field.name) for field in fields(found)}
    with replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, key=np.array(key), base=np.array(base), **arrays)


def load(path: Path, key: str) -> tuple[Correlation, int] | None:
    """The result with this key, and its base; None where there is no such whole file."""
    try:
        with np.load(path) as stored:
            if str(stored["key"]) != key:
                return None
            arrays = {field.name: stored[field.name] for field in fields(Correlation)}
            return Correlation(**arrays), int(stored["base"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
