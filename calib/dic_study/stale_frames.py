"""Results of frames that a study no longer names, which a reader of the folder would take."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calib.dic import Quality
from fe.atomic_file import write_text

ENDS = ("points/{}.csv", "pictures/{}.png", "pictures/{}-lost.png", "{}-strain.csv")
NAMED = "frames/named.json"
"""frames of the last run, whether it came to its end or not"""


def remove_stale(out: Path, stems: set[str], say: Callable[[str], None]) -> None:
    """Take away results of the last run's frames that `stems` does not name, and keep `stems`.

    What is needed to go on stays, so that a frame which comes back is not measured again.
    """
    for stem in sorted(_named_before(out) - stems):
        paths = [out / end.format(stem) for end in ENDS]
        if not any(path.exists() for path in paths):
            continue
        for path in paths:
            path.unlink(missing_ok=True)
        say(f"removed the results of {stem}, which the study no longer names")
    write_text(out / NAMED, json.dumps(sorted(stems)) + "\n")


def _named_before(out: Path) -> set[str]:
    """Frames of the last run; where it was of an older version, by its `dic.json`."""
    try:
        return set(json.loads((out / NAMED).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        pass
    try:
        before = json.loads((out / "dic.json").read_text(encoding="utf-8"))["frames"]
        return {Path(frame["image"]).stem for frame in before}
    except (OSError, ValueError, KeyError, TypeError):
        return set()


def finite(judged: Quality) -> dict[str, Any]:
    """A quality for a json file: None where a number is not finite."""
    found = asdict(judged)
    for name, value in found.items():
        if isinstance(value, float) and not np.isfinite(value):
            found[name] = None
    return found
