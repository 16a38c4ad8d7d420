"""The validation test: a notched plate, clamped at both ends and pulled (thesis, section 3.6).

The thesis pulls a sample whose strain field is mixed, modelled up to 5 mm into the clamps, but its
figure gives no dimensions in the text: here a plate (width x, length y, thickness z) with two
circular notches in the middle of its sides, all dimensions free.  An eighth is modelled (planes
x = 0, y = 0, z = 0); the camera looks at the front face z = thickness / 2.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from skfem import Basis, ElementHex2, MeshHex

from fe import driven_response
from fe.discretisation import elements
from fe.driven import DrivenProblem, equations, unknowns
from fe.driven_parameters import Shape, free_shape
from fe.driven_response import DrivenSpecimen, Schedule
from fe.field_motion import field_probe
from fe.force_control import check_targets
from fe.newton import NewtonOptions
from fe.parameters import check_asked
from fe.specimens.checks import check_bulk_ratio, check_counts, check_kinds, check_lengths
from fe.specimens.field_grid import FieldGrid, own_points
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

    def __post_init__(self) -> None:
        check_kinds(self, specimen=NotchedPlate, steps=StepOptions, newton=NewtonOptions)
        check_counts("cells", self.cells, (1, 2, 1))
        self._check_own_points()
        check_targets(self.travel, self.force)
        check_asked(self.sensitivities)
        check_bulk_ratio(self.bulk_ratio)

    def points(self) -> Array:
        """(n_point, 2) reference x, y of the field points on the front face, mm."""
        given = own_points(self.field_grid)
        if given is not None:
            return given
        nx, ny = (int(n) for n in np.asarray(self.field_grid))
        across, along = np.meshgrid((np.arange(nx) + 0.5) / nx, (np.arange(ny) + 0.5) / ny)
        y = along.ravel() * self.specimen.length / 2.0
        return np.stack([across.ravel() * self.specimen.half_width(y), y], axis=1)

    def _check_own_points(self) -> None:
        """Raise ValueError for points beside the front face of the eighth."""
        found = own_points(self.field_grid)
        if found is None:
            return
        x, y = found.T
        beside = (x < 0.0) | (y < 0.0) | (y > self.specimen.length / 2.0)
        beside |= x > self.specimen.half_width(y)
        if beside.any():
            raise ValueError(
                f"field_grid: expected points with x from 0 to half the width there and y from 0 "
                f"to {self.specimen.length / 2.0:g} mm, found {found[beside][0].tolist()}"
            )

    parameter_names = driven_response.parameter_names
    __call__ = driven_response.respond_to_ratios
    respond = driven_response.respond
    objective_gradients = driven_response.objective_gradients
    solve_for = driven_response.solve_for

    def mesh(self) -> MeshHex:
        """Hexahedra of the eighth: half of those along y lie beside the notch."""
        nx, ny, nz = self.cells
        beside = max(1, round(ny / 2))
        reach, end = self.specimen.notch_reach, self.specimen.length / 2.0
        lines = np.concatenate(
            [np.linspace(0.0, reach, beside + 1), np.linspace(reach, end, ny - beside + 1)[1:]]
        )
        depth = np.linspace(0.0, self.specimen.thickness / 2.0, nz + 1)
        unit = MeshHex.init_tensor(np.linspace(0.0, 1.0, nx + 1), lines, depth)
        p = unit.p.copy()
        p[0] *= self.specimen.half_width(p[1])
        return MeshHex(p, unit.t)

    def shape(self, specimen: NotchedPlate) -> Shape:
        """What moves with the dimensions, at those of `specimen`."""
        given = own_points(self.field_grid)
        # a point on the edge may be beside the face of another specimen
        grid = self.field_grid if given is None else (1, 1)
        model = replace(self, specimen=specimen, field_grid=grid)
        basis = Basis(model.mesh(), ElementHex2(), intorder=1)
        return free_shape(basis.doflocs.T, model._on_front(given))

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
            probe=field_probe(basis, self._on_front()),
            symmetry=SYMMETRY_FACTOR,
        )

    def _on_front(self, given: Array | None = None) -> Array:
        """(n_point, 3) field points, mm, or those that are `given` (n_point, 2)."""
        points = self.points() if given is None else given
        return np.column_stack([points, np.full(len(points), self.specimen.thickness / 2.0)])

    @property
    def schedule(self) -> Schedule:
        """What is asked, and how the solver gets there."""
        return Schedule(self.travel, self.steps, self.newton, self.force)
