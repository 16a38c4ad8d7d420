"""The validation test: a notched plate, clamped at both ends and pulled (thesis, section 3.6).

The thesis pulls a sample whose strain field is mixed, modelled up to 5 mm into the clamps, but its
figure gives no dimensions in the text: here a plate (width x, length y, thickness z) with two
circular notches in the middle of its sides, all dimensions free.  An eighth is modelled (planes
x = 0, y = 0, z = 0); the camera looks at the front face z = thickness / 2.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from skfem import Basis, ElementHex2, MeshHex

from fe import driven_response
from fe.campaign_parameters import RATIOS, Parameter
from fe.discretisation import elements
from fe.driven import DrivenProblem, equations, unknowns
from fe.driven_parameters import Shape, free_shape
from fe.driven_response import DrivenSpecimen, Schedule
from fe.field_motion import field_probe
from fe.force_control import keep_targets
from fe.newton import NewtonOptions
from fe.parameters import keep_asked
from fe.specimens.checks import check_bulk_ratio, check_kinds, check_lengths, keep_counts
from fe.specimens.field_grid import FieldGrid, keep_field_grid, own_points
from fe.steps import StepOptions

Array = npt.NDArray[np.float64]

SYMMETRY_FACTOR = 8.0


@dataclass(frozen=True)
class NotchedPlate:
    """Dimensions of the plate between the clamps, mm.

    Raises ValueError for a length that is not above 0, notches that meet or that reach the clamps,
    and a notch at least as deep as its radius.
    """

    width: float = 20.0
    length: float = 30.0
    thickness: float = 2.5
    notch_radius: float = 5.0
    notch_depth: float = 4.0

    def __post_init__(self) -> None:
        check_lengths(self)
        if not self.notch_depth < min(self.notch_radius, self.width / 2.0):
            raise ValueError(
                f"notch_depth: expected less than the radius {self.notch_radius} mm and half the "
                f"width {self.width / 2.0} mm, found {self.notch_depth}"
            )
        if not 2.0 * self.notch_reach < self.length:
            raise ValueError(
                f"notch_radius: expected notches that end before the clamps, found an opening of "
                f"{2.0 * self.notch_reach:.3g} mm in a length of {self.length} mm"
            )

    @property
    def notch_reach(self) -> float:
        """Half the opening of a notch along y, mm."""
        above = self.notch_radius - self.notch_depth
        return float(np.sqrt(self.notch_radius**2 - above**2))

    def half_width(self, y: npt.ArrayLike) -> Array:
        """Half the width (mm) at the distance y (mm) from the middle."""
        y = np.abs(np.asarray(y, dtype=np.float64))
        inside = np.sqrt(np.maximum(self.notch_radius**2 - y**2, 0.0))
        cut = inside - (self.notch_radius - self.notch_depth)
        return self.width / 2.0 - np.where(y < self.notch_reach, np.maximum(cut, 0.0), 0.0)


def check_field_grid(grid: FieldGrid, plate: NotchedPlate) -> None:
    """Raise ValueError for impossible numbers, and for points beside the front face's quarter."""
    found = own_points(grid)
    if found is None:
        return
    x, y = found.T
    half = plate.length / 2.0
    beside = (x < 0.0) | (y < 0.0) | (y > half) | (x > plate.half_width(y))
    if beside.any():
        raise ValueError(
            f"field_grid: expected points with x from 0 to half the width there and y from 0 to "
            f"{half:g} mm, found {found[beside][0].tolist()}"
        )


def front_points(plate: NotchedPlate, grid: FieldGrid) -> Array:
    """(n_point, 2) reference x, y of the field points on the quarter of the front face, mm.

    `grid` are their numbers across half the width and along half the length, at the centres of
    equal shares; or it is the points themselves, which stay where they are when the plate changes.
    """
    given = own_points(grid)
    if given is not None:
        return given
    nx, ny = (int(n) for n in np.asarray(grid))
    across, along = np.meshgrid((np.arange(nx) + 0.5) / nx, (np.arange(ny) + 0.5) / ny)
    y = along.ravel() * plate.length / 2.0
    return np.stack([across.ravel() * plate.half_width(y), y], axis=1)


def _seen_places(plate: NotchedPlate, grid: FieldGrid) -> Array:
    """(n_point, 3) the field points in space, mm."""
    points = front_points(plate, grid)
    return np.column_stack([points, np.full(len(points), plate.thickness / 2.0)])


def plate_mesh(plate: NotchedPlate, cells: tuple[int, int, int]) -> MeshHex:
    """Hexahedra (numbers along x, y, z) of an eighth: half of those along y beside the notch."""
    nx, ny, nz = cells
    beside = max(1, round(ny / 2))
    reach, end = plate.notch_reach, plate.length / 2.0
    lines = np.concatenate(
        [np.linspace(0.0, reach, beside + 1), np.linspace(reach, end, ny - beside + 1)[1:]]
    )
    depth = np.linspace(0.0, plate.thickness / 2.0, nz + 1)
    unit = MeshHex.init_tensor(np.linspace(0.0, 1.0, nx + 1), lines, depth)
    p = unit.p.copy()
    p[0] *= plate.half_width(p[1])
    return MeshHex(p, unit.t)


@dataclass(frozen=True)
class TensileModel:
    """Simulation of the plate as a function of (r, s) or of any material; picklable, one thread.

    `cells` are the numbers of Q2 elements along x, y, z of the eighth; `travel` the motions of one
    clamp against the other (mm, increasing) at which the response is asked, or `force` the forces
    (N, increasing); `bulk_ratio` the bulk modulus over mu = 2 kappa for calls with ratios;
    `field_grid` the numbers of field points across half the width and along half the length of the
    front face, or their own x, y in mm.  `sensitivities` names the parameters of the response's
    gradients (`parameter_names` lists all there are), by default those that it is a function of.
    Field points of a number keep their fractions of the width and length, those of their own x, y
    stay where they are; gradients are those of what is seen there.
    """

    specimen: NotchedPlate
    cells: tuple[int, int, int]
    travel: tuple[float, ...] = ()
    bulk_ratio: float = 200.0
    field_grid: FieldGrid = (12, 18)
    steps: StepOptions = field(default_factory=lambda: StepOptions(0.5, 3.0, 0.01))
    newton: NewtonOptions = field(default_factory=lambda: NewtonOptions(1e-8, max_move=1.0))
    force: tuple[float, ...] = ()
    sensitivities: tuple[str, ...] | None = None
    columns: ClassVar[tuple[Parameter, ...]] = RATIOS
    """of a row of a campaign's design"""

    def __post_init__(self) -> None:
        check_kinds(self, specimen=NotchedPlate, steps=StepOptions, newton=NewtonOptions)
        keep_counts(self, "cells", (1, 2, 1))
        check_field_grid(self.field_grid, self.specimen)
        keep_field_grid(self)
        keep_targets(self)
        keep_asked(self)
        check_bulk_ratio(self.bulk_ratio)

    def points(self) -> Array:
        """(n_point, 2) reference x, y of the field points on the front face, mm."""
        return front_points(self.specimen, self.field_grid)

    parameter_names = driven_response.parameter_names
    __call__ = driven_response.respond_to_ratios
    respond = driven_response.respond
    objective_gradients = driven_response.objective_gradients
    solve_for = driven_response.solve_for

    def mesh(self) -> MeshHex:
        """Hexahedra of the eighth: half of those along y lie beside the notch."""
        return plate_mesh(self.specimen, self.cells)

    def shape(self, specimen: NotchedPlate) -> Shape:
        """What moves with the dimensions, at those of `specimen`."""
        basis = Basis(plate_mesh(specimen, self.cells), ElementHex2(), intorder=1)
        return free_shape(basis.doflocs.T, _seen_places(specimen, self.field_grid))

    def discretise(self) -> DrivenSpecimen:
        """Tables of the eighth's mesh, constraints, motion of the clamp and field points."""
        table, basis = elements(self.mesh())
        tolerance = 1e-9 * self.specimen.length
        fixed = table.positions < tolerance
        clamp = table.positions[:, 1] > self.specimen.length / 2.0 - tolerance
        fixed[clamp] = True
        motion = np.zeros(table.positions.shape)
        motion[clamp, 1] = 0.5
        return DrivenSpecimen(
            problem=DrivenProblem(table, unknowns(table.nodes, equations(fixed)), motion),
            points=self.points(),
            probe=field_probe(basis, _seen_places(self.specimen, self.field_grid)),
            symmetry=SYMMETRY_FACTOR,
        )

    @property
    def schedule(self) -> Schedule:
        """What is asked, and how the solver gets there."""
        return Schedule(self.travel, self.steps, self.newton, self.force)
