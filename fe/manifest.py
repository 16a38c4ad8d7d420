"""Table of contents of a campaign's folder: for readers, programs among them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fe.atomic_file import write_text
from fe.campaign_parameters import Parameter, as_json
from fe.campaign_result import good_steps, is_reached
from fe.run_files import RUN_FORMAT, KeptRun, software_versions

Array = npt.NDArray[np.float64]

MANIFEST = "manifest.json"


def write_manifest(
    store: Path,
    theta: Array,
    parameters: Sequence[Parameter],
    fingerprint: Mapping[str, object],
    design: Mapping[str, object],
    runs: Sequence[tuple[Path, KeptRun] | None],
    unused: Sequence[Path],
) -> None:
    """Write `manifest.json`, atomically; campaigns are resumed from their runs, never from it.

    `theta` (n, d) in the units of the parameters; `runs` n files with what they hold, None where
    there is none yet; `design` how theta was made; `unused` other run files in the folder.
    """
    content = {
        "format": RUN_FORMAT,
        "software": dict(software_versions()),
        "design": dict(design),
        "parameters": as_json(parameters),
        "fingerprint": dict(fingerprint),
        "runs": [
            {"index": index, "theta": row.tolist()} | _entry(run)
            for index, (row, run) in enumerate(zip(theta, runs, strict=True))
        ],
        "unused": [path.name for path in unused],
    }
    write_text(store / MANIFEST, json.dumps(content, indent=1))


def _entry(run: tuple[Path, KeptRun] | None) -> dict[str, object]:
    if run is None:
        return {"file": None, "status": "missing", "reached": False, "reached_mm": None}
    path, kept = run
    response = kept.response
    return {
        "file": path.name,
        "status": str(response.status),
        "message": response.message,
        "reached": is_reached(response),
        "reached_mm": response.reached,
        "n_good_steps": int(good_steps(response).sum()),
        "seconds": response.seconds,
        "softcal": kept.software.get("softcal"),
    }
