"""File of an emulator: one npz with a JSON header that says what it was trained on."""

from __future__ import annotations

import errno
import json
import os
import secrets
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

EMULATOR_VERSION = 5
_MAGIC = "softcal emulator"
_ZIP = b"PK\x03\x04"


@dataclass(frozen=True)
class Header:
    """Where an emulator comes from."""

    fingerprint: str
    """`TrainingSet.fingerprint` of its runs"""
    seed: int
    n_train: int
    n_excluded: int
    """runs that did not reach every travel: they teach up to where they are good, if at all"""


def write_arrays(path: Path, header: Header, arrays: dict[str, Array]) -> None:
    """Write header and arrays to `path`, through a temporary file in the same directory."""
    text = json.dumps({"format": _MAGIC, "version": EMULATOR_VERSION, **asdict(header)})
    # Not tempfile, which would keep everyone but the owner from reading.
    temporary = path.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        handle = os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
        with os.fdopen(handle, "wb") as stream:
            np.savez(stream, header=np.asarray(text), **cast("dict[str, Any]", arrays))
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno is not None:
            error.filename = str(path)  # a full disk names no file, a missing folder this one
        raise


def read_arrays(path: Path, fingerprint: str | None) -> tuple[Header, dict[str, Array]]:
    """Read header and arrays.

    Raises ValueError naming the file when it is damaged, of another version or of other runs, and
    OSError when it cannot be opened or read, which says nothing of its content.
    """
    try:
        arrays = _arrays(path)
        content = json.loads(str(arrays.pop("header")))
        if content.pop("format") != _MAGIC:
            raise ValueError("its header is of another program")
        version = content.pop("version")
    except OSError as error:
        if error.errno not in (None, errno.EINVAL):  # a place that no file has: damage
            raise
        raise ValueError(f"{path}: not a readable emulator ({error}); train again") from error
    except Exception as error:  # zip, zlib, struct and JSON errors: damage has many faces
        raise ValueError(f"{path}: not a readable emulator ({error}); train again") from error
    if version != EMULATOR_VERSION:
        raise ValueError(
            f"{path}: emulator of version {version}, this program reads version "
            f"{EMULATOR_VERSION}; train again"
        )
    try:
        header = Header(**content)
    except TypeError as error:
        raise ValueError(f"{path}: emulator with an unknown header ({error})") from error
    if fingerprint is not None and header.fingerprint != fingerprint:
        raise ValueError(
            f"{path}: emulator trained on other runs (fingerprint {header.fingerprint[:12]}, "
            f"expected {fingerprint[:12]}); train again"
        )
    return header, arrays


def _arrays(path: Path) -> dict[str, Array]:
    with path.open("rb") as stream:
        # NumPy would take anything but a zip file for a pickle, and say so.
        if stream.read(len(_ZIP)) != _ZIP:
            raise ValueError("expected an npz file, found another or a part of one")
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
