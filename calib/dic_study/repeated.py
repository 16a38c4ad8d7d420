"""Pictures that a series holds twice: files that were copied, frames that a camera wrote again."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from calib.dic import GreyImage

Seen = tuple[dict[bytes, str], ...]
"""names of the pictures so far by their hashes, of each camera"""


def repeats(seen: Seen, images: Sequence[GreyImage]) -> list[str]:
    """Why images, one of each camera, are doubtful: they are the very pictures of others before.

    They are added to `seen`.  Pictures that show nothing may be alike.
    """
    doubts = []
    for before, image in zip(seen, images, strict=True):
        if not np.ptp(image.grey) > 0.0:
            continue
        key = hashlib.sha256(image.grey.tobytes()).digest()
        if key in before:  # by its pixels: in two folders names may be the same
            doubts.append(
                f"{image.name} is pixel for pixel {before[key]}, expected a picture with noise of "
                "its own"
            )
        before.setdefault(key, image.name)
    return doubts
