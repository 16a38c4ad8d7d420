"""Whether what is stated of a mesh's error holds for the constants that finer meshes would give.

    python -m benchmarks.mesh_pairs [--runs FOLDER]

On all runs that the studies of convergence have kept at (r, s) = (0.5, 0.05), `verify_fe --only gci
directions bounds`: the sampling mesh of each pin and contact, every mesh that a study may check it
by, and the finest that is at least as fine as that in every coordinate, of 1.9 times as many
elements or more. The newest run of each mesh is taken, whichever code of `fe` it is of. Forces and
field of the finest are fitted without noise as in `benchmarks.mesh_statement`, by the tangents of
the check mesh's run and with several statements of the field's error.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from benchmarks.calibration_experiments import template
from benchmarks.calibration_figures import points
from benchmarks.calibration_runs import prior
from benchmarks.mesh_convergence import RUNS, TRAVEL
from benchmarks.mesh_fit import Fitted, Linear, within
from benchmarks.mesh_fit import told as summary
from benchmarks.mesh_statement import MIDDLE
from benchmarks.meshes import EARLIER_SAMPLING_CELLS, SAMPLING_CELLS
from calib.inference.field_noise import FieldCovariance, field_covariance
from calib.inference.noise import ForceErrors, field_nuisances, force_errors
from calib.inference.tangent_errors import apart, mistaken, with_nuisances
from calib.study.block_cells import refinement
from calib.study.mesh_error import MeshError, left_share
from fe import Response, Rings, load_response
from fe.specimens.block_pin import Cells

NAME = re.compile(r"(?P<family>.+)-(?P<cells>\d+x\d+x\d+)-0.5-0.05-\w{12}\.npz")
SAMPLING: dict[str, Cells] = {
    family: cast(Cells, astuple(cells) if isinstance(cells, Rings) else cells)
    for family, cells in (
        ("friction-0.1", SAMPLING_CELLS["bar, friction"]),
        ("friction-0.3", SAMPLING_CELLS["bar, friction"]),
        ("round-friction-0.3", SAMPLING_CELLS["round, friction"]),
        ("round-slide", SAMPLING_CELLS["round, frictionless"]),
        ("round-stick", SAMPLING_CELLS["round, stick"]),
        ("slide", SAMPLING_CELLS["bar, frictionless"]),
        ("stick", EARLIER_SAMPLING_CELLS["bar, stick"]),
    )
}
"""what each family of runs is checked for; of round pins rings, layers and sectors"""
LEAST_CHECK = 1.29
"""times smaller elements: 12 x 6 x 3 beside 12 x 4 x 2, 1.31, is the first"""
LEAST_FINER = 1.9
"""times as many elements of the truth as of the check"""


@dataclass(frozen=True)
class Pair:
    """A mesh that is checked, the mesh that checks it, and a finer one."""

    family: str
    sampling: Response
    check: Response
    truth: Response
    check_cells: Cells
    truth_cells: Cells
    refinement: float
    """how many times smaller the elements of the check are than those of the sampling mesh"""

    @property
    def error(self) -> MeshError:
        """What a study would measure."""
        return MeshError(
            self.refinement,
            np.array([[0.5, 0.05]]),
            (self.sampling.force / self.check.force - 1.0)[None],
            (self.sampling.displacement - self.check.displacement)[None],
            points=self.check.points,
        )

    @property
    def every_coordinate(self) -> bool:
        """Whether the check is finer in every coordinate."""
        return bool(np.all(np.divide(self.check_cells, SAMPLING[self.family]) > 1.1))


Statement = Callable[[Pair, FieldCovariance], FieldCovariance]


def pairs(folder: Path) -> list[Pair]:
    """Of all kept runs, each check with the finest of its truths."""
    runs = kept(folder)
    found = []
    for family, sampling in SAMPLING.items():
        meshes = [cells for name, cells in runs if name == family]
        for check in meshes if sampling in meshes else []:
            rho = refinement(check, sampling)
            finer = [t for t in meshes if np.prod(t) >= LEAST_FINER * np.prod(check)]
            finer = [t for t in finer if np.all(np.greater_equal(t, check))]
            if rho < LEAST_CHECK or np.any(np.less(check, sampling)) or not finer:
                continue
            truth = max(finer, key=lambda cells: (np.prod(cells), cells))
            three = (runs[family, cells] for cells in (sampling, check, truth))
            found.append(Pair(family, *three, check, truth, rho))
    return found


def kept(folder: Path) -> dict[tuple[str, Cells], Response]:
    """The newest run of each family and mesh that reached the end and has derivatives."""
    found = {}
    for path in sorted(folder.glob("*.npz"), key=lambda path: path.stat().st_mtime):
        name = NAME.fullmatch(path.name)
        if name is None:
            continue
        run = load_response(path)
        complete = run.reached >= TRAVEL[-1] and np.isfinite(run.displacement_gradient).all()
        if complete and run.displacement.shape[:2] == (len(TRAVEL), len(points())):
            cells = cast(Cells, tuple(int(n) for n in name["cells"].split("x")))
            found[name["family"], cells] = run
    return found


def errors_of(pair: Pair) -> ForceErrors:
    """Of the forces, with the mesh error that a study would state."""
    return force_errors(*template(points()), pair.error.force)


def linear(pair: Pair) -> Linear:
    """About the run of the check mesh."""
    check, errors = pair.check, errors_of(pair)
    by_ratio = np.moveaxis(check.displacement_gradient[..., :2], -1, 0)
    by_zero = errors.slope @ check.force
    force = MIDDLE * np.column_stack([check.force, check.force_gradient[:, :2], by_zero])
    field = with_nuisances(by_ratio, check.displacement, field_nuisances(*template(points())))
    return Linear(force, field, errors.travel_zero_sd)


def as_studies(pair: Pair, floor: FieldCovariance) -> FieldCovariance:
    """What the differences would be mistaken for, each constant on its own, beside the floor.

    All is at one (r, s) here, so that the tangents have not turned.
    """
    model = linear(pair)
    box = prior().bounds[1:]
    held = np.append(np.ptp(box, axis=1) / np.sqrt(12.0), model.zero_sd)
    found = mistaken(floor, np.array(TRAVEL), model.field, pair.error.field, held)
    left = apart(left_share(pair.refinement) ** 2 * found, ("zero",), box)
    return floor.with_patterns(left.patterns(model.field))


def by_shapes(pair: Pair, floor: FieldCovariance) -> FieldCovariance:
    """Shapes of the differences, each increment's with a factor of its own."""
    single = np.eye(len(TRAVEL))[:, :, None, None] * pair.error.field[0]
    return floor.with_patterns(left_share(pair.refinement) * single)


STATEMENTS: dict[str, Statement] = {
    "as studies": as_studies,
    "shapes of the differences": by_shapes,
    "floor alone": lambda pair, floor: floor,
    "no mesh error": lambda pair, floor: replace(floor, floor=np.zeros_like(floor.floor)),
}


def fitted(pair: Pair, statement: Statement) -> Fitted:
    """Distance from the truth, and SDs that go with it, by one statement."""
    field = template(points())[0].field
    assert field is not None
    stated = field_covariance(field, floor=pair.error.field_floor)
    return linear(pair).fit(
        MIDDLE * (pair.truth.force - pair.check.force),
        errors_of(pair).covariance(MIDDLE * pair.check.force[:, None])[:, :, 0],
        pair.truth.displacement - pair.check.displacement,
        statement(pair, stated),
    )


def figures(folder: Path = RUNS) -> dict[str, Any]:
    """By statement: errors of the constants of finer meshes in their SDs."""
    found = pairs(folder)
    if not found:
        print(f"{folder}: holds no three meshes, run benchmarks.verify_fe --only gci directions")
        return {}
    told: dict[str, Any] = {
        "pairs": [
            f"{p.family} {p.check_cells} of {p.truth_cells}".replace(", ", "x") for p in found
        ]
    }
    for name, statement in STATEMENTS.items():
        each = [fitted(pair, statement) for pair in found]
        kinds = {
            "all": lambda pair: True,
            "checks finer in every coordinate": lambda pair: pair.every_coordinate,
            "stuck bars": lambda pair: pair.family == "stick",
        }
        told[name] = {
            kind: summary([fit for fit, pair in zip(each, found, strict=True) if of(pair)])
            for kind, of in kinds.items()
        }
        print(name, told[name], flush=True)
    told["what is left"] = [_left(pair) for pair in found]
    force = [(p.check.force / p.truth.force - 1.0) / p.error.force for p in found]
    told["force, all increments"] = within(np.array(force).reshape(-1, 1))
    print("force", told["force, all increments"])
    return {"mesh_pairs": told}


def _left(pair: Pair) -> dict[str, float]:
    """What the check errs by, beside the difference that it measured."""
    left = pair.check.displacement - pair.truth.displacement
    difference = pair.error.field[0]
    size = np.sqrt(np.mean(left**2))
    stated = left_share(pair.refinement) * np.sqrt(np.mean(difference**2))
    return {
        "along_difference": float(np.sum(left * difference) / np.sum(difference**2)),
        "size_over_stated": float(size / stated),
        "largest_over_size": float(np.abs(left).max() / size),
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.mesh_pairs", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--runs", type=Path, default=RUNS, metavar="FOLDER")
    for line in figures(parser.parse_args().runs)["mesh_pairs"]["pairs"]:
        print(line)


if __name__ == "__main__":
    main()
