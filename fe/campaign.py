"""A campaign: one simulation for every point of a design, kept in one file each and resumable."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fe.atomic_file import replacing
from fe.executors import MapFn, serial_map
from fe.response import Array, Response, Status, load_response, save_response

Simulate = Callable[[Array], Response]
Progress = Callable[[int, int], None]

RUN_FORMAT = 1
_RUN_NAME = re.compile(r"run_\d{4,}_([0-9a-f]{16})\.npz")


@dataclass(frozen=True)
class Campaign:
    """Results of all runs of a design, in the order of the design."""

    ratios: Array
    """(n, d) design points (r, s)"""
    responses: tuple[Response, ...]
    """n results, failed ones among them"""
    n_reused: int
    """runs that were found in the store"""

    def __post_init__(self) -> None:
        if self.ratios.ndim != 2 or len(self.ratios) != len(self.responses):
            raise ValueError(
                f"responses: expected one for each row of ratios {self.ratios.shape}, "
                f"got {len(self.responses)}"
            )

    @property
    def reached(self) -> npt.NDArray[np.bool_]:
        """(n,) whether the run converged up to its last travel."""
        return np.array([is_reached(response) for response in self.responses], dtype=bool)

    @property
    def n_failed(self) -> int:
        """Runs that ended before their last travel."""
        return int(np.count_nonzero(~self.reached))

    @property
    def force(self) -> Array:
        """(n, n_step) forces of the whole sample at kappa = 1 MPa, N; NaN where not reached."""
        return np.stack([response.force for response in self.responses])

    @property
    def displacement(self) -> Array:
        """(n, n_step, n_point, 3) displacements of the front face, mm; NaN where not reached."""
        return np.stack([response.displacement for response in self.responses])


class CampaignFailed(RuntimeError):  # noqa: N818 - says what happened
    """More runs failed than a surrogate may be built without."""

    def __init__(self, message: str, n_failed: int, n_done: int, n_total: int) -> None:
        super().__init__(message)
        self.n_failed = n_failed
        self.n_done = n_done
        self.n_total = n_total

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        return type(self), (str(self), self.n_failed, self.n_done, self.n_total)


def is_reached(response: Response) -> bool:
    """Whether a run converged and holds finite forces and displacements at every travel."""
    return response.status is Status.CONVERGED and bool(
        np.isfinite(response.force).all() and np.isfinite(response.displacement).all()
    )


def run_campaign(
    simulate: Simulate,
    ratios: Array,
    store: Path,
    *,
    fingerprint: dict[str, object],
    map_fn: MapFn | None = None,
    progress: Progress | None = None,
    max_failure_rate: float = 0.2,
) -> Campaign:
    """Run `simulate` for each row of `ratios` (n, d), reusing the runs that `store` holds.

    `fingerprint` (JSON values) must hold all that the result depends on besides the ratios. A run
    is known by the hash of both, so a changed design reuses the points it shares with the old one.
    Each result is written atomically as it arrives; a killed campaign goes on where it was.
    `progress(done, total)` is called at the start and after each run.

    Raises ValueError for ratios that are not finite or a file in `store` that is damaged or
    foreign (naming it), CampaignFailed once more than `max_failure_rate` of all runs have failed,
    and whatever `simulate` raises (numerical failure is a status, not an exception).
    """
    ratios = _checked_ratios(ratios)
    canonical = _canonical_json(fingerprint)
    keys = [run_key(row, fingerprint) for row in ratios]
    store.mkdir(parents=True, exist_ok=True)
    paths = _known_files(store)
    found = {key: _load_run(paths[key], key) for key in dict.fromkeys(keys) if key in paths}
    n_reused = sum(key in found for key in keys)
    missing = _first_rows(keys, found)
    results = (map_fn or serial_map)(simulate, [ratios[index] for index in missing])
    try:
        _report(keys, found, progress, max_failure_rate)
        for position, response in results:
            index = missing[position]
            paths[keys[index]] = keep_run(store, index, ratios[index], fingerprint, response)
            found[keys[index]] = response
            _report(keys, found, progress, max_failure_rate)
    finally:
        # The traceback of an interrupt would keep the iterator, and so its workers, alive.
        close = getattr(results, "close", None)
        if close is not None:
            close()
        _write_manifest(store, ratios, keys, canonical, found, paths)
    return Campaign(ratios, tuple(found[key] for key in keys), n_reused)


def keep_run(
    store: Path, index: int, ratios: Array, fingerprint: dict[str, object], response: Response
) -> Path:
    """Write the run at ratios (d,) where a campaign in `store` will find it; returns the file."""
    path = store / f"run_{index:04d}_{run_key(ratios, fingerprint)}.npz"
    canonical = np.asarray(_canonical_json(fingerprint))
    save_response(path, response, ratios=ratios, fingerprint=canonical)
    return path


def run_key(ratios: Array, fingerprint: dict[str, object]) -> str:
    """Name of one run: 16 hex digits of the SHA-256 of the ratios (all bits) and the fingerprint.

    Raises ValueError when the fingerprint does not consist of JSON values.
    """
    return _key(np.asarray(ratios, dtype=np.float64), _canonical_json(fingerprint))


def _key(ratios: Array, canonical: str) -> str:
    exact = [float(value + 0.0).hex() for value in ratios]  # + 0.0: -0.0 and 0.0 are one point
    text = json.dumps([RUN_FORMAT, exact, canonical])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _canonical_json(fingerprint: dict[str, object]) -> str:
    try:
        return json.dumps(fingerprint, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"fingerprint: must consist of finite JSON values ({error}); convert arrays to lists"
        ) from error


def _checked_ratios(ratios: Array) -> Array:
    ratios = np.array(ratios, dtype=np.float64)
    if ratios.ndim != 2 or ratios.size == 0:
        raise ValueError(f"ratios: must be a non-empty (n, d) array, got shape {ratios.shape}")
    if not np.isfinite(ratios).all():
        row = int(np.flatnonzero(~np.isfinite(ratios).all(axis=1))[0])
        raise ValueError(f"ratios: must be finite, got {ratios[row].tolist()} in row {row}")
    return ratios


def _known_files(store: Path) -> dict[str, Path]:
    """Run files of the store by key; those of another design stay where they are, unread."""
    paths: dict[str, Path] = {}
    for path in sorted(store.glob("run_*.npz")):
        match = _RUN_NAME.fullmatch(path.name)
        if match is None:
            raise ValueError(
                f"{path}: not a file of a campaign (expected run_<index>_<hash>.npz); move it away"
            )
        paths.setdefault(match[1], path)
    return paths


def _load_run(path: Path, key: str) -> Response:
    try:
        response = load_response(path)
        with np.load(path, allow_pickle=False) as stored:
            inside = _key(stored["ratios"], str(stored["fingerprint"]))
    except Exception as error:  # zip, zlib and struct errors: a damaged file fails in many ways
        raise ValueError(
            f"{path}: damaged run of the campaign ({error}); delete it to run it again"
        ) from error
    if inside != key:
        raise ValueError(
            f"{path}: foreign run: its content belongs to {inside}, not to {key} as its name says; "
            "delete it to run it again"
        )
    return response


def _first_rows(keys: list[str], found: dict[str, Response]) -> list[int]:
    """Rows to run: the first of each key that is not there (equal points are run once)."""
    first: dict[str, int] = {}
    for index, key in enumerate(keys):
        if key not in found:
            first.setdefault(key, index)
    return list(first.values())


def _report(
    keys: list[str],
    found: dict[str, Response],
    progress: Progress | None,
    max_failure_rate: float,
) -> None:
    """Tell the progress; stop as soon as too many have failed for the whole campaign.

    Failures are held against the number of all runs, not of those done: whether a campaign
    fails then does not depend on the order in which its runs end.
    """
    done = [key for key in keys if key in found]
    if progress is not None:
        progress(len(done), len(keys))
    failed = [found[key] for key in done if not is_reached(found[key])]
    if len(failed) > max_failure_rate * len(keys):
        raise CampaignFailed(
            f"{len(failed)} of {len(keys)} runs failed ({len(done)} done), more than the "
            f"{max_failure_rate:.0%} allowed; one stopped at {failed[0].reached:.3g} mm: "
            f"{failed[0].message}; narrow the range of the ratios, change the mesh or lower the "
            "largest travel",
            n_failed=len(failed),
            n_done=len(done),
            n_total=len(keys),
        )


def _write_manifest(
    store: Path,
    ratios: Array,
    keys: list[str],
    canonical: str,
    found: dict[str, Response],
    paths: dict[str, Path],
) -> None:
    """Table of contents for readers; written from the run files, never read back."""
    runs = [
        {
            "index": index,
            "ratios": [float(value) for value in ratios[index]],
            "file": paths[key].name if key in found else None,
            "status": str(found[key].status) if key in found else "missing",
            "reached_mm": found[key].reached if key in found else None,
        }
        for index, key in enumerate(keys)
    ]
    content = {"format": RUN_FORMAT, "fingerprint": json.loads(canonical), "runs": runs}
    with replacing(store / "manifest.json") as temporary:
        temporary.write_text(json.dumps(content, indent=1))
