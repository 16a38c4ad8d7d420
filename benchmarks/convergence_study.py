"""How often the block reaches 1.4 mm over random parameters: Sobol draws for each contact.

The draws cover r, s, bulk/mu (log), height and fillet over the ranges that the model is built for.
`CASES` lists what `fe` can do; a new pin or contact is one line there.
"""

from __future__ import annotations

import functools
import multiprocessing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from fe import BlockPin, BlockPinModel, Contact, Response, load_response, save_response

Array = npt.NDArray[np.float64]

SAMPLING_CELLS = (12, 4, 2)
TRAVEL = (0.6, 0.8, 1.0, 1.2, 1.4, 1.8)
REACHED = (1.4, 1.8)
"""mm: travels of which the fractions are reported"""
SEED = 20261121


class Draw(NamedTuple):
    """One point of the parameter space."""

    r: float
    s: float
    bulk_ratio: float
    height: float
    """mm"""
    fillet: float
    """mm"""


LOW = Draw(0.0, 0.0, np.log(5.0), 2.5, 0.2)
HIGH = Draw(1.0, 0.5, np.log(2000.0), 2.7, 0.5)
"""of bulk/mu the logarithm"""

CASES: dict[str, Contact] = {
    "bar, stick": Contact("stick", "stick"),
    "bar, frictionless": Contact("slide", "slide"),
}
"""pin and contact, as they are named in the figures"""


def draws(n: int) -> list[Draw]:
    """The first n points of a scrambled Sobol sequence: more draws keep the first ones."""
    power = int(np.ceil(np.log2(max(n, 2))))
    points = qmc.Sobol(len(LOW), seed=SEED).random_base2(power)[:n]
    values = qmc.scale(points, LOW, HIGH)
    values[:, 2] = np.exp(values[:, 2])
    return [Draw(*map(float, row)) for row in values]


def simulate(
    case: str, draw: Draw, cells: tuple[int, int, int], travel: tuple[float, ...]
) -> Response:
    """One draw."""
    specimen = BlockPin(height=draw.height, pin_fillet=draw.fillet)
    model = BlockPinModel(
        specimen, CASES[case], cells, travel, bulk_ratio=draw.bulk_ratio, field_grid=(7, 5)
    )
    return model(np.array([draw.r, draw.s]))


def figures(
    folder: Path,
    n: int,
    workers: int,
    cases: tuple[str, ...],
    *,
    cells: tuple[int, int, int] = SAMPLING_CELLS,
    travel: tuple[float, ...] = TRAVEL,
    reached: tuple[float, ...] = REACHED,
) -> dict[str, Any]:
    """`converged_fraction` by pin and contact, and what stopped the others."""
    fraction: dict[str, Any] = {}
    stopped: dict[str, Any] = {}
    for case in cases:
        one = functools.partial(_stored, folder, case, cells, travel)
        jobs = list(enumerate(draws(n)))
        if workers > 1:
            with multiprocessing.get_context("spawn").Pool(workers) as pool:
                results = pool.starmap(one, jobs, chunksize=1)
        else:
            results = [one(*job) for job in jobs]
        fraction[case] = {
            f"{d:g} mm": float(np.mean([r.reached >= d - 1e-9 for r in results])) for d in reached
        }
        fraction[case] |= {
            "draws": n,
            "unstable": float(np.mean([(r.negative_pivots > 0).any() for r in results])),
            "median_seconds": float(np.median([r.seconds for r in results])),
        }
        stopped[case] = [
            draw._asdict() | {"reached": r.reached, "message": r.message}
            for (_, draw), r in zip(jobs, results, strict=True)
            if r.reached < reached[0] - 1e-9
        ]
    return {"converged_fraction": fraction, "not_converged": stopped}


def _stored(
    folder: Path,
    case: str,
    cells: tuple[int, int, int],
    travel: tuple[float, ...],
    number: int,
    draw: Draw,
) -> Response:
    """The draw's response, from the folder if it is there (delete that when the model changes)."""
    name = "-".join(case.replace(",", "").split())
    path = folder / name / f"{'x'.join(map(str, cells))}-{number:04d}.npz"
    if path.exists():
        return load_response(path)
    response = simulate(case, draw, cells, travel)
    path.parent.mkdir(parents=True, exist_ok=True)
    save_response(path, response, draw=np.array(draw))
    print(f"  {case} {number}: {response.reached:g} mm, {response.seconds:.0f} s", flush=True)
    return response
