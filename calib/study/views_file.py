"""FE runs of planned blocks on disk, one npz file each, so that a question asked again has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.study.artifacts import hash_of, read_npz, write_npz
from calib.study.run_identity import run_identity
from calib.study.views import Face, Run, Seen
from fe.response import Array
from fe.specimens.block_pin import BlockPinModel

FACES: tuple[Face, ...] = ("front", "side")
OF_RUN = Run._fields[:-1]
"""arrays of the run itself, its faces left out"""


def kept_run(store: Path, model: BlockPinModel, ratios: Array) -> Run | None:
    """The run of a model at these ratios, solved by the code of today; None where it is not kept.

    Raises ValueError naming a damaged file.
    """
    path = _path(store, model, ratios)
    if not path.is_file():
        return None
    names = [*OF_RUN, *(f"{face}_{name}" for face in FACES for name in Seen._fields)]
    try:
        parts = read_npz(path, names)
    except ValueError as error:
        raise ValueError(
            f"{path}: found no whole FE run in it; delete it and ask `calib design-next` again"
        ) from error
    of_run = (parts[name] for name in OF_RUN)
    faces = {face: Seen(*(parts[f"{face}_{name}"] for name in Seen._fields)) for face in FACES}
    return Run._make([*of_run, faces])


def keep_run(store: Path, model: BlockPinModel, run: Run) -> None:
    """Keep what `kept_run` finds."""
    arrays = {name: getattr(run, name) for name in OF_RUN}
    for face, seen in run.faces.items():
        arrays |= {f"{face}_{name}": getattr(seen, name) for name in Seen._fields}
    store.mkdir(parents=True, exist_ok=True)
    write_npz(_path(store, model, run.ratios), arrays)


def _path(store: Path, model: BlockPinModel, ratios: Array) -> Path:
    name = hash_of([run_identity(model), np.asarray(ratios, dtype=np.float64).tolist()])
    return store / f"{name}.npz"
