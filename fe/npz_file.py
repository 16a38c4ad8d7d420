"""Arrays of an npz file, or one sentence on why there are none."""

from __future__ import annotations

import errno
import struct
import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

MAGIC = b"PK\x03\x04"
"""of a zip file with content; NumPy would take anything else for a pickle, and say so"""


def read_npz(path: Path) -> dict[str, npt.NDArray[Any]]:
    """All arrays of a file by name; no pickle is loaded.

    Raises ValueError saying how the file is damaged, OSError where it cannot be opened or read,
    which says nothing of its content.
    """
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise ValueError("expected an npz file, found another or a part of one")
        stream.seek(0)
        try:
            with np.load(stream, allow_pickle=False) as stored:
                return {name: stored[name] for name in stored.files}
        except OSError as error:
            if error.errno not in (None, errno.EINVAL):  # a place that no file has: damage
                raise
            raise ValueError(str(error)) from error
        # RuntimeError: a damaged zip may claim to be encrypted or of an unknown compression.
        except (
            ValueError, TypeError, KeyError, EOFError, RuntimeError, MemoryError, BadZipFile,
            zlib.error, struct.error,
        ) as error:  # fmt: skip
            raise ValueError(str(error) or type(error).__name__) from error
