"""What a study leaves on disk: atomic writes, hashes, and the record that lets a stage be skipped.

Each finished stage leaves `stages/<stage>.json`: the hash of each of its inputs by name, and the
SHA-256 of every file it wrote. A stage is up to date when its inputs hash to the same values and
its files are still those it wrote; otherwise the reason is said in words.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from fe import npz_file
from fe.atomic_file import replacing

RECORD_FOLDER = "stages"
_AGAIN = "delete it and `calib run` the study again"
NEEDED = "stage "
"""before the name of an earlier stage among the inputs of a record"""
CONTENT = "content"
"""among the inputs of a record: what files of data hold"""
_DIGITS = 16
"""hexadecimal digits kept of a SHA-256: 64 bits, ample for telling files of one study apart"""


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically: readers see the old content or the new, never a part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def plain(value: object) -> Any:
    """Turn dataclasses, arrays, paths and NumPy scalars into what JSON can hold.

    NaN and infinities, which JSON cannot express, become null. Raises TypeError naming the type
    of anything else.
    """
    if value is None or isinstance(value, (bool, str)):
        return str(value) if isinstance(value, str) else value
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"value: expected data that JSON can hold, found {type(value).__name__}")


def write_json(path: Path, value: object) -> None:
    """Write readable JSON atomically; non-finite numbers become null."""
    text = json.dumps(plain(value), indent=2, allow_nan=False)
    write_bytes(path, (text + "\n").encode())


def write_npz(path: Path, arrays: Mapping[str, npt.NDArray[np.generic]]) -> None:
    """Write arrays as one npz file, atomically; the same arrays give the same bytes."""
    stream = io.BytesIO()
    np.savez(stream, **cast("dict[str, Any]", dict(arrays)))
    write_bytes(path, stream.getvalue())


def read_json(path: Path, expected: Sequence[str] = ()) -> Any:
    """Read a JSON file, an object with the `expected` keys.

    Raises ValueError naming the file, and the line when it is damaged.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise not_made(path) from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not a readable JSON file ({error}); {_AGAIN}") from error
    lacking = [key for key in expected if not (isinstance(found, dict) and key in found)]
    if lacking:
        raise ValueError(f"{path}: found no {', '.join(lacking)} in it; {_AGAIN}")
    return found


def read_npz(path: Path, expected: Sequence[str] = ()) -> dict[str, npt.NDArray[Any]]:
    """Read the arrays of an npz file, `expected` among them.

    Raises ValueError naming the file when it is not there or damaged, OSError when it cannot be
    opened or read.
    """
    try:
        arrays = npz_file.read_npz(path)
    except FileNotFoundError as error:
        raise not_made(path) from error
    except ValueError as error:
        raise ValueError(f"{path}: not a readable npz file; {_AGAIN}") from error
    lacking = [name for name in expected if name not in arrays]
    if lacking:
        raise ValueError(f"{path}: found no array {', '.join(lacking)}; {_AGAIN}")
    return arrays


def not_made(path: Path) -> ValueError:
    """What to raise for a file that a stage has yet to make."""
    return ValueError(
        f"{path}: found no such file, the study is not finished: run `calib run` on it"
    )


def hash_of(value: object) -> str:
    """Hash of plain data that does not depend on the order of keys."""
    text = json.dumps(plain(value), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def hash_of_file(path: Path) -> str:
    """Hash of a file's bytes."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()[:_DIGITS]


@dataclass(frozen=True)
class StageRecord:
    """What a finished stage was made from and what it wrote."""

    stage: str
    version: str
    """version of softcal that ran the stage"""
    seed: int
    inputs: dict[str, str]
    """hash of each input by name"""
    outputs: dict[str, str]
    """hash of each file written, by its path below the study's folder"""
    seconds: float

    def digest(self) -> str:
        """Hash of all outputs: the input that later stages see."""
        return hash_of(self.outputs)


def record_path(out: Path, stage: str) -> Path:
    """Where the record of a stage is kept."""
    return out / RECORD_FOLDER / f"{stage}.json"


def read_record(out: Path, stage: str) -> StageRecord | None:
    """The record of a finished stage, or None when there is none that can be read."""
    try:
        stored = json.loads(record_path(out, stage).read_text(encoding="utf-8"))
        return StageRecord(**stored)
    except (OSError, ValueError, TypeError):
        return None


def write_record(out: Path, record: StageRecord) -> None:
    """Keep the record of a finished stage."""
    write_json(record_path(out, record.stage), record)
    _begun_path(out, record.stage).unlink(missing_ok=True)


def mark_begun(out: Path, stage: str) -> None:
    """Say that a stage has begun; what it keeps meanwhile is not lost if it is stopped."""
    write_bytes(_begun_path(out, stage), b"")


def clear_begun(out: Path, stage: str) -> None:
    """Say that what a finished stage wrote is up to date, though it had begun again since."""
    _begun_path(out, stage).unlink(missing_ok=True)


def _begun_path(out: Path, stage: str) -> Path:
    return record_path(out, stage).with_suffix(".begun")


def outdated(out: Path, stage: str) -> str:
    """Which earlier stage has made other files since a stage was finished; empty where none has.

    As after a run that was stopped between the two. The stage itself where it has begun again.
    """
    record = read_record(out, stage)
    if record is None:
        return ""
    if _begun_path(out, stage).exists():
        return stage
    for name, digest in record.inputs.items():
        earlier = name.removeprefix(NEEDED)
        if earlier != name:
            now = read_record(out, earlier)
            if now is None or now.digest() != digest:
                return earlier
    return ""


def of_another_run(out: Path, stage: str, beside: str) -> str:
    """Why what a stage made is of another run than what the stage `beside` it made, or empty."""
    record, other = read_record(out, stage), read_record(out, beside)
    if record is None or other is None:
        return ""
    if _begun_path(out, stage).exists():
        return "it was begun again and not finished"
    both = [name for name in record.inputs if name.startswith(NEEDED) and name in other.inputs]
    apart = [name for name in both if record.inputs[name] != other.inputs[name]]
    return f"it is of another {apart[0]}" if apart else ""


def why_stale(
    out: Path, stage: str, inputs: Mapping[str, str], version: str
) -> tuple[StageRecord | None, str]:
    """Say why a stage must run; the reason is empty when its artifacts are up to date.

    Returns the stored record (None when there is none) and the reason in words, which names the
    inputs that changed or the first file that is missing or differs from what the stage wrote.
    """
    record = read_record(out, stage)
    if record is None:
        if _begun_path(out, stage).exists():
            return None, "stopped before its end"
        damaged = record_path(out, stage).exists()
        return None, "its record cannot be read" if damaged else "not run yet"
    if record.version != version:
        return record, f"made by version {record.version}, this is {version}"
    if record.inputs != dict(inputs):
        names = sorted(set(record.inputs) | set(inputs))
        changed = [name for name in names if record.inputs.get(name) != inputs.get(name)]
        return record, f"changed: {', '.join(changed)}"
    for name, expected in record.outputs.items():
        path = out / name
        if not path.is_file():
            return record, f"{name} is missing"
        if hash_of_file(path) != expected:
            return record, f"{name} is not what the stage wrote"
    return record, ""
