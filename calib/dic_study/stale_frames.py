"""Results of frames that a study no longer names, which a reader of the folder would take."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calib.dic import Quality
from fe.atomic_file import write_text

ENDS = ("points/{}.csv", "pictures/{}.png", "pictures/{}-lost.png", "{}-strain.csv")
NAMED = "frames/named.json"
"""key and frames of the last run, whether it came to its end or not"""


def remove_stale(out: Path, key: str, stems: set[str], say: Callable[[str], None]) -> None:
    """Take away results of the last run's frames that `stems` does not name, and keep `stems`.

    Of all of its frames where `key`, of all that frames follow from, was another: a run that is
    stopped would leave some of them. What is needed to go on stays, so that a frame which comes
    back is not measured again.
    """
    last_key, before = _last(out)
    gone = before if last_key not in (None, key) else before - stems
    for stem in sorted(gone):
        if not _remove(out, stem):
            continue
        why = "are of other settings" if stem in stems else "the study no longer names"
        say(f"removed the results of {stem}, which {why}")
    write_text(out / NAMED, json.dumps({"key": key, "frames": sorted(stems)}) + "\n")


def remove_following(out: Path, stems: Iterable[str]) -> None:
    """Take away results of frames that follow one which is measured again.

    They are followed from it, so that those of an earlier run would be of other images.
    """
    for stem in stems:
        _remove(out, stem)


def _remove(out: Path, stem: str) -> bool:
    """Take away all results of a frame; whether there were any."""
    paths = [path for end in ENDS if (path := out / end.format(stem)).exists()]
    for path in paths:
        path.unlink()
    return bool(paths)


def _last(out: Path) -> tuple[str | None, set[str]]:
    """Key and frames of the last run; of an older version the frames alone, by its `dic.json`."""
    try:
        last = json.loads((out / NAMED).read_text(encoding="utf-8"))
        return str(last["key"]), set(last["frames"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    try:
        report = json.loads((out / "dic.json").read_text(encoding="utf-8"))
        images = [*(frame["image"] for frame in report["frames"]), report["reference"]]
        return None, {Path(image).stem for image in images}
    except (OSError, ValueError, KeyError, TypeError):
        return None, set()


def finite(judged: Quality) -> dict[str, Any]:
    """A quality for a json file: None where a number is not finite."""
    found = asdict(judged)
    for name, value in found.items():
        if isinstance(value, float) and not np.isfinite(value):
            found[name] = None
    return found
