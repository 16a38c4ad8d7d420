"""One self-contained file a run of a campaign: what was asked, of which model, what came out."""

from __future__ import annotations

import hashlib
import json
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fe.campaign_parameters import Parameter, as_json, from_json
from fe.fingerprint import canonical_json
from fe.npz_file import read_npz
from fe.response import Response, response_of, save_response

Array = npt.NDArray[np.float64]

RUN_FORMAT = 2
"""part of every run's key: files of another format are never taken for runs of this one"""
_RUN_NAME = re.compile(r"run_\d{4,}_([0-9a-f]{16})\.npz")
_PACKAGES = ("softcal", "numpy", "scipy", "numba", "scikit-fem", "pypardiso")


@dataclass(frozen=True)
class KeptRun:
    """The content of one run file."""

    parameters: tuple[Parameter, ...]
    theta: Array
    """(d,) in the units of the parameters"""
    fingerprint: str
    """all else that the result depends on, as canonical JSON"""
    software: dict[str, str]
    """versions that made the result"""
    response: Response

    @property
    def key(self) -> str:
        """The name that content like this has."""
        return _key(self.theta, self.parameters, self.fingerprint, self.software["softcal"])


def run_key(
    theta: Array, parameters: Sequence[Parameter], fingerprint: Mapping[str, object]
) -> str:
    """Name of one run: 16 hex digits of the SHA-256 of parameters, all bits of theta, fingerprint.

    A factor counts by the name of its level, so that a level more changes no key. The version of
    softcal counts too: another may solve the same model differently. Raises ValueError when the
    fingerprint does not consist of JSON values.
    """
    theta = np.asarray(theta, dtype=np.float64)
    return _key(theta, parameters, canonical_json(fingerprint), software_versions()["softcal"])


def _key(theta: Array, parameters: Sequence[Parameter], canonical: str, softcal: str) -> str:
    # + 0.0: -0.0 and 0.0 are one point
    exact = [
        [p.name, p.unit, p.level(value) if p.levels else float(value + 0.0).hex()]
        for p, value in zip(parameters, theta, strict=True)
    ]
    text = json.dumps([RUN_FORMAT, softcal, exact, canonical])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def keep_run(
    store: Path,
    index: int,
    theta: Array,
    parameters: Sequence[Parameter],
    fingerprint: Mapping[str, object],
    response: Response,
) -> tuple[Path, KeptRun]:
    """Write the run at theta (d,) where a campaign in `store` will find it, atomically."""
    canonical = canonical_json(fingerprint)
    run = KeptRun(tuple(parameters), theta, canonical, dict(software_versions()), response)
    path = store / f"run_{index:04d}_{run.key}.npz"
    extra: dict[str, npt.NDArray[Any]] = {
        "format": np.asarray(RUN_FORMAT),
        "theta": theta,
        "columns": np.asarray(json.dumps(as_json(parameters))),
        "fingerprint": np.asarray(canonical),
        "software": np.asarray(json.dumps(run.software)),
    }
    save_response(path, response, **extra)
    return path, run


def load_run(path: Path) -> KeptRun:
    """Read one run by its file alone.

    Raises ValueError naming the file when it is damaged, not a run, or not the run that its name
    says; OSError when it cannot be opened or read, which says nothing of the run.
    """
    match = _RUN_NAME.fullmatch(path.name)
    if match is None:
        raise ValueError(
            f"{path}: not a file of a campaign (expected run_<index>_<hash>.npz); move it away"
        )
    try:
        run = _read(path)
        key = run.key
    except OSError:
        raise
    except Exception as error:  # whatever is in the wrong place: a damaged file fails in many ways
        raise ValueError(
            f"{path}: damaged run of the campaign ({error}); delete it to run it again"
        ) from error
    if key != match[1]:
        raise ValueError(
            f"{path}: foreign run: its content belongs to {key}, not to {match[1]} as its name "
            "says; delete it to run it again"
        )
    return run


def _read(path: Path) -> KeptRun:
    stored = read_npz(path)
    response = response_of(stored)
    if "format" not in stored:
        raise ValueError(f"expected run format {RUN_FORMAT}, found 1, of an earlier version")
    if int(stored["format"]) != RUN_FORMAT:
        raise ValueError(f"expected run format {RUN_FORMAT}, found {stored['format']}")
    theta = stored["theta"]
    parameters = from_json(json.loads(str(stored["columns"])))
    fingerprint = str(stored["fingerprint"])
    software = {str(k): str(v) for k, v in json.loads(str(stored["software"])).items()}
    if theta.shape != (len(parameters),) or theta.dtype != np.float64:
        raise ValueError(f"expected theta of {len(parameters)} floats, found {theta!r}")
    return KeptRun(parameters, theta, fingerprint, software, response)


def run_files(store: Path) -> dict[str, Path]:
    """Run files of a folder by key, unread.

    Raises ValueError naming a file that is called as if it were a run and is none.
    """
    paths: dict[str, Path] = {}
    for path in sorted(store.glob("run_*.npz")):
        match = _RUN_NAME.fullmatch(path.name)
        if match is None:
            raise ValueError(
                f"{path}: not a file of a campaign (expected run_<index>_<hash>.npz); move it away"
            )
        paths.setdefault(match[1], path)
    return paths


@cache
def software_versions() -> Mapping[str, str]:
    """Versions of Python and of the packages that a result depends on."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found
