"""FE runs behind the figures of calibration: drawn from the prior, stored one by one, resumed.

    python -m benchmarks.calibration_runs [--store DIR] [--only PART ...]

The study is `thesis-forces`. One run at ratios (r, s) serves every kappa: the force is kappa times
that at kappa = 1 MPa and the field is the same.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.emulator_runs import CELLS, DESIGNS, family, simulate
from benchmarks.mesh_cases import (
    CHECK_STIFFENING,
    MESH_CASES,
    TRUTH_STIFFENING,
    MeshCase,
    hypothesis,
    study,
)
from benchmarks.run_key import kept_campaign
from calib.inference import Prior
from calib.study.artifacts import read_json, write_json
from calib.study.context import block_pin_model, stiffened
from calib.study.posterior_setup import prior_of
from calib.study.sections import Cells
from calib.study.unknowns import design_points
from fe import BlockPin, BlockPinModel, Contact
from fe.campaign_parameters import Parameter
from fe.campaign_result import Campaign
from fe.executors import process_map
from fe.materials import material
from fe.response import Array, Response
from surrogate.design import sobol_design

ROOT = Path(__file__).resolve().parents[1]
STORE = ROOT / "runs" / "verify-inference"
SEED, TRUTH_SEED = 20261122, 3
COARSE_CELLS: Cells = (8, 4, 3)
"""of the direct posterior, which takes a run at every node of a quadrature"""
FRICTION = 0.3
OTHER_LAW = (
    Parameter("alpha", "1", "material"),
    Parameter("bulk", "1", "material"),
)
"""Ogden's exponent, and the bulk modulus over the shear modulus mu"""
OTHER_BOUNDS = np.array([[1.5, 4.0], [5.0, 20.0]])
CONTACTS = {"sliding": "slide", "stuck": "stick"}
"""what benchmarks/emulator.py calls the hypotheses"""
N_PLACED = 8
"""corners and centres of faces that come first in a design of (r, s)"""
N_FINER, N_STUCK, N_OTHER, N_RUBBING = 12, 288, 100, 100
EVEN = replace(DESIGNS[0], dense_below=None)
"""runs that fill the box of (r, s) evenly, as the prior does"""

Progress = Callable[[int, int], None]


def prior() -> Prior:
    """Prior of the study; it spans a factor of 100 in kappa."""
    return prior_of(study(), hypothesis("sliding"), with_field=True)


@dataclass(frozen=True)
class OgdenBlock:
    """A compressible block of one Ogden term that slides with friction; mu = 2 MPa."""

    template: BlockPinModel

    def __call__(self, theta: Array) -> Response:
        """Response at theta = (alpha, bulk modulus over mu); a solver failure is a status."""
        alpha, bulk = (float(value) for value in theta)
        # 2 mu = mu_1 alpha_1
        return self.template.respond(material("ogden-1", (4.0 / alpha, alpha), 2.0 * bulk))


def ratios_drawn(n: int, purpose: int) -> Array:
    """(n, 2) ratios (r, s) drawn from the prior."""
    rng = np.random.default_rng([SEED, purpose])
    return prior().sample(rng, n)[:, 1:]


def design(store: Path, name: str, progress: Progress | None = None) -> Campaign:
    """The study's own design for one hypothesis: training runs, then those held out."""
    used, found = study(), hypothesis(name)
    model = block_pin_model(used, found, used.sampling_cells(found))
    folder = store / "campaign" / name
    return kept_campaign(model, design_points(used, found), folder, progress=progress)


def sliding(
    store: Path, folder: str, ratios: Array, cells: Cells | None, progress: Progress | None = None
) -> Campaign:
    """Runs of the sliding block; `cells` None is the sampling mesh."""
    return solved(store, "sliding", folder, ratios, cells, progress)


def solved(
    store: Path,
    name: str,
    folder: str,
    ratios: Array,
    cells: Cells | None,
    progress: Progress | None = None,
    stiffening: float = 1.0,
) -> Campaign:
    """Runs under one hypothesis, side by side; `cells` None is its sampling mesh."""
    used, found = study(), hypothesis(name)
    model = block_pin_model(used, found, cells or used.sampling_cells(found))
    return kept_campaign(
        stiffened(model, stiffening),
        ratios,
        store / folder,
        progress=progress,
        max_failure_rate=1.0,
        map_fn=process_map(0),
    )


def truths(store: Path, progress: Progress | None = None) -> Campaign:
    """Truths on the sampling mesh: the runs of benchmarks/emulator.py, but its corners and faces.

    Two Sobol sequences that fill the box of the prior evenly; no emulator of the study saw them.
    """
    points = np.vstack([EVEN.training()[N_PLACED:], held_out()])
    return _benchmark_runs(store, "sliding", points, progress)


def held_out(n: int = 32) -> Array:
    """(n, 2) the second of these sequences."""
    return EVEN.held_out(n, TRUTH_SEED)


def held_out_truths(
    store: Path, name: str, progress: Progress | None = None, n: int = 32
) -> Campaign:
    """Runs of the second sequence alone, under a hypothesis."""
    return _benchmark_runs(store, name, held_out(n), progress)


def further_training(
    store: Path, name: str, progress: Progress | None = None, cells: Cells | None = None
) -> Campaign:
    """The training runs of benchmarks/emulator.py, corners and faces among them.

    `cells` None is the sampling mesh of the study.
    """
    return _benchmark_runs(store, name, EVEN.training(), progress, cells)


def _benchmark_runs(
    store: Path,
    name: str,
    points: Array,
    progress: Progress | None,
    cells: Cells | None = None,
) -> Campaign:
    contact = CONTACTS[name]
    model = family(EVEN.names, contact, cells or study().sampling_cells(hypothesis(name)))
    return simulate(points, model, store / contact, progress or _quiet)


def finer_truths(store: Path, case: MeshCase, progress: Progress | None = None) -> Campaign:
    """Truths drawn from the prior, on the finer mesh."""
    ratios, name = ratios_drawn(N_FINER, case.draw)[: case.n_truths], case.hypothesis
    folder = f"finer-{name}"
    return solved(store, name, folder, ratios, case.truth_cells, progress, TRUTH_STIFFENING)


def coarse_design(store: Path, name: str, progress: Progress | None = None) -> Campaign:
    """The study's design of training runs, with derivatives, on the coarse mesh."""
    used = study()
    points = design_points(used, hypothesis(name))[: used.design.n_runs]
    return solved(store, name, f"coarse-{name}", points, COARSE_CELLS, progress)


def checks(
    store: Path, case: MeshCase, ratios: Array, progress: Progress | None = None
) -> tuple[Campaign, Campaign, Campaign]:
    """Runs of the check, of the emulator's model and on its mesh under the check's pin.

    All at the same ratios (n, 2).
    """
    name = case.hypothesis
    fine, coarse, stiffer = (
        solved(store, name, f"check-{kind}-{name}", ratios, cells, progress, stiffening)
        for kind, cells, stiffening in (
            ("fine", case.check_cells, CHECK_STIFFENING),
            ("coarse", case.cells, 1.0),
            ("stiffer", case.cells, CHECK_STIFFENING),
        )
    )
    return fine, coarse, stiffer


def other_truths(store: Path, progress: Progress | None = None) -> Campaign:
    """Ogden blocks, compressible, friction 0.3 on pin and base."""
    points = sobol_design(N_OTHER, OTHER_BOUNDS, SEED, n_corners=0)
    template = BlockPinModel(
        BlockPin(),
        Contact(FRICTION, FRICTION),
        (12, 4, 2),
        study().increments,
        sensitivities=(),
    )
    return kept_campaign(
        OgdenBlock(template),
        points,
        store / "ogden",
        parameters=OTHER_LAW,
        progress=progress,
        max_failure_rate=1.0,
    )


def rubbing_truths(store: Path, progress: Progress | None = None) -> Campaign:
    """Mooney-Rivlin blocks with friction, of other heights, fillets and bulk moduli.

    Inner points of the third design of benchmarks/emulator.py.
    """
    chosen = DESIGNS[2]
    points = chosen.training()[chosen.n_corners :][:N_RUBBING]
    model = family(chosen.names, "friction", CELLS["friction"])
    return simulate(points, model, store / "friction", progress or _quiet)


PARTS: dict[str, Callable[[Path, Progress], object]] = {
    "sliding": lambda store, progress: design(store, "sliding", progress),
    "stuck": lambda store, progress: further_training(store, "stuck", progress),
    "stuck-truths": lambda store, progress: held_out_truths(store, "stuck", progress, N_STUCK),
    "rubbing": rubbing_truths,
    "ogden": other_truths,
    "truths": truths,
    "finer": lambda store, progress: finer_truths(store, MESH_CASES["finer"], progress),
    "finer-stuck": lambda store, progress: finer_truths(store, MESH_CASES["finer-stuck"], progress),
}


def main(arguments: list[str] | None = None) -> None:
    """Run what is missing."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.calibration_runs", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    parser.add_argument("--store", type=Path, default=STORE, metavar="DIR")
    options = parser.parse_args(arguments)
    for name in options.only:
        PARTS[name](options.store, told(name))


def kept(path: Path, figures: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Figures that a file of the store holds, made where there is none.

    Stored figures do not know of a change of code: give another store after one.
    """
    if not path.exists():
        write_json(path, figures())
    found: dict[str, Any] = read_json(path)
    print(f"  {path.stem}: {found}", flush=True)
    return found


def told(name: str) -> Progress:
    """Prints how far a part is."""

    def progress(done: int, total: int) -> None:
        print(f"{name}: {done}/{total}", flush=True)

    return progress


def _quiet(done: int, total: int) -> None:
    """Tells nothing."""


if __name__ == "__main__":
    main()
