"""Results of frames that a study no longer names, which a reader of the folder would take."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calib.dic import Quality

ENDS = ("points/{}.csv", "pictures/{}.png", "pictures/{}-lost.png", "{}-strain.csv")


def remove_stale(out: Path, stems: set[str], say: Callable[[str], None]) -> None:
    """Take away results of the last run's frames, by its `dic.json`, that `stems` does not name.

    What is needed to go on stays, so that a frame which comes back is not measured again.
    """
    try:
        before = json.loads((out / "dic.json").read_text(encoding="utf-8"))["frames"]
        names = [Path(frame["image"]).stem for frame in before]
    except (OSError, ValueError, KeyError, TypeError):
        return
    for stem in names:
        paths = [out / end.format(stem) for end in ENDS]
        if stem in stems or not any(path.exists() for path in paths):
            continue
        for path in paths:
            path.unlink(missing_ok=True)
        say(f"removed the results of {stem}, which the study no longer names")


def finite(judged: Quality) -> dict[str, Any]:
    """A quality for a json file: None where a number is not finite."""
    found = asdict(judged)
    for name, value in found.items():
        if isinstance(value, float) and not np.isfinite(value):
            found[name] = None
    return found
