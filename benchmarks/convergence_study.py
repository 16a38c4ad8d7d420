"""How often the block reaches 1.4 and 1.8 mm over random parameters: one Sobol sequence over all.

A draw is a pin, a contact and numbers over the ranges that the model is built for; the first tenth
of the draws is solved on the fitting mesh too.  Pin and contact are dimensions of the sequence:
were they dealt out in turn, they would follow the other dimensions' binary digits.
"""

from __future__ import annotations

import functools
import multiprocessing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from benchmarks.meshes import FITTING_CELLS, SAMPLING_CELLS, Cells, Pin, name_of
from benchmarks.run_key import run_key
from fe import BlockPin, BlockPinModel, Contact, Response, Rings, load_response, save_response

Array = npt.NDArray[np.float64]
Touch = Literal["stick", "friction", "frictionless"]
Meshes = Literal["sampling", "fitting"]

TRAVEL = (0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8)
REACHED = (1.4, 1.8)
"""mm: travels of which the fractions are reported"""
FITTING_SHARE = 10
"""one of so many draws is solved on the fitting mesh too: the first ones"""
SEED = 20261121
PINS: tuple[Pin, ...] = ("bar", "round")
TOUCHES: tuple[Touch, ...] = ("stick", "friction", "frictionless")
CASES = tuple(f"{pin}, {touch}" for pin in PINS for touch in TOUCHES)
"""pin and contact, as they are named in the figures"""


class Draw(NamedTuple):
    """One point of the parameter space."""

    pin: Pin
    touch: Touch
    r: float
    s: float
    bulk_ratio: float
    height: float
    """mm"""
    fillet: float
    """mm"""
    pin_friction: float
    """coefficient, of a contact with friction"""
    base_friction: float

    @property
    def case(self) -> str:
        """Its row in the figures."""
        return f"{self.pin}, {self.touch}"

    @property
    def contact(self) -> Contact:
        """The same kind on pin and base, friction with a coefficient of each."""
        if self.touch == "friction":
            return Contact(self.pin_friction, self.base_friction)
        interface: Literal["stick", "slide"] = "stick" if self.touch == "stick" else "slide"
        return Contact(interface, interface)


LOW = (0.0, 0.0, np.log(5.0), 2.5, 0.2, 0.1, 0.1)
HIGH = (1.0, 0.5, np.log(2000.0), 2.7, 0.5, 1.0, 1.0)
"""r, s, log(bulk/mu), height, fillet and the two coefficients of friction"""


def draws(n: int) -> list[Draw]:
    """The first n points of a scrambled Sobol sequence: more draws keep the first ones."""
    power = int(np.ceil(np.log2(max(n, 2))))
    points = qmc.Sobol(2 + len(LOW), seed=SEED).random_base2(power)[:n]
    values = qmc.scale(points[:, 2:], LOW, HIGH)
    values[:, 2] = np.exp(values[:, 2])
    return [
        Draw(PINS[int(a * len(PINS))], TOUCHES[int(b * len(TOUCHES))], *map(float, row))
        for (a, b), row in zip(points[:, :2], values, strict=True)
    ]


def model_of(draw: Draw, cells: Cells | Rings, travel: tuple[float, ...]) -> BlockPinModel:
    """The model of one draw."""
    specimen = BlockPin(height=draw.height, pin_fillet=draw.fillet, pin=draw.pin)
    return BlockPinModel(
        specimen, draw.contact, cells, travel, bulk_ratio=draw.bulk_ratio, field_grid=(7, 5)
    )


def figures(
    folder: Path,
    n: int,
    workers: int,
    meshes: Meshes = "sampling",
    *,
    cells: Mapping[str, Cells | Rings] | None = None,
    travel: tuple[float, ...] = TRAVEL,
    reached: tuple[float, ...] = REACHED,
) -> dict[str, Any]:
    """`converged_fraction` by pin and contact on these meshes, and what stopped the others.

    Of n draws on the sampling meshes, or the first tenth of them on the fitting meshes; `cells`
    take the place of either.
    """
    fits = meshes == "fitting"
    part = draws(n)[: -(-n // FITTING_SHARE) if fits else n]
    used = cells or (FITTING_CELLS if fits else SAMPLING_CELLS)
    responses = run(folder, part, workers, used, travel)
    suffix = "_fitting" if fits else ""
    return {
        f"converged_fraction{suffix}": fractions(part, responses, reached),
        f"not_converged{suffix}": stopped(part, responses, reached[-1]),
        f"converged_cells{suffix}": {
            case: name_of(mesh) if isinstance(mesh, Rings) else list(mesh)
            for case, mesh in used.items()
        },
    }


def run(
    folder: Path,
    drawn: Sequence[Draw],
    workers: int,
    cells: Mapping[str, Cells | Rings],
    travel: tuple[float, ...],
) -> list[Response]:
    """The draws' responses; those of the same model and code are taken from the folder."""
    one = functools.partial(_stored, folder, cells, travel)
    jobs = list(enumerate(drawn))
    if workers > 1:
        with multiprocessing.get_context("spawn").Pool(workers) as pool:
            return pool.starmap(one, jobs, chunksize=1)
    return [one(*job) for job in jobs]


def fractions(
    drawn: Sequence[Draw], responses: Sequence[Response], reached: tuple[float, ...]
) -> dict[str, Any]:
    """By case and over all: what reached each travel, number of draws, unstable, median seconds."""
    table: dict[str, Any] = {}
    for case in (*CASES, "all"):
        runs = [r for d, r in zip(drawn, responses, strict=True) if case in ("all", d.case)]
        if not runs:
            continue
        table[case] = {
            f"{d:g} mm": float(np.mean([r.reached >= d - 1e-9 for r in runs])) for d in reached
        } | {
            "draws": len(runs),
            "unstable": float(np.mean([(r.negative_pivots > 0).any() for r in runs])),
            "median_seconds": float(np.median([r.seconds for r in runs])),
        }
    return table


def stopped(
    drawn: Sequence[Draw], responses: Sequence[Response], travel: float
) -> list[dict[str, Any]]:
    """The draws that did not reach `travel` (mm), how far they came and why."""
    return [
        {"number": i} | draw._asdict() | {"reached": r.reached, "message": r.message}
        for i, (draw, r) in enumerate(zip(drawn, responses, strict=True))
        if r.reached < travel - 1e-9
    ]


def _stored(
    folder: Path,
    cells: Mapping[str, Cells | Rings],
    travel: tuple[float, ...],
    number: int,
    draw: Draw,
) -> Response:
    mesh = cells[draw.case]
    model = model_of(draw, mesh, travel)
    path = folder / name_of(mesh) / f"{number:04d}-{run_key(model)}.npz"
    if path.exists():
        return load_response(path)
    response = model(np.array([draw.r, draw.s]))
    path.parent.mkdir(parents=True, exist_ok=True)
    save_response(path, response)
    print(
        f"  {number} {draw.case}: {response.reached:g} mm, {response.seconds:.0f} s, "
        f"{response.n_factorisations} factorisations, {response.negative_pivots.max()} negative "
        f"pivots; {response.message}",
        flush=True,
    )
    return response
