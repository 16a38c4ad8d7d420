"""Soft block under a bar pin: geometry, contact hypothesis, mesh, and the model to run.

The block (width x, height y, depth z) stands on a base; a rigid bar, filleted at its lower edges
and running through the whole depth, is pressed into the middle of its top.  A quarter is modelled
(planes x = 0 and z = 0 through the pin's centre), so forces are multiplied by four.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from skfem import MeshHex
from threadpoolctl import threadpool_limits

from fe.contact import Faces, PenaltyLaw, RigidPin
from fe.contact_memory import initial_memory
from fe.discretisation import Pattern, elements, faces, pattern
from fe.friction import FrictionLaw
from fe.linear_solver import SymmetricSolver
from fe.load_stepping import March, StepOptions, TravelState, march
from fe.materials.material import mooney_rivlin_of_ratios
from fe.newton import NewtonOptions
from fe.potential import Potential, Problem
from fe.response import Response, Status
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Interface = Literal["stick", "slide"] | float

SYMMETRY_FACTOR = 4.0
"""a quarter model carries a quarter of the measured force"""

EDGE_DENSITY = 2.0
"""how much denser the mesh lines are at the pin's edge than far away, less one"""
DEPTH_GRADING = 0.6
"""0 is uniform along the bar; elements shrink towards the front face as it grows to 1"""


@dataclass(frozen=True)
class BlockPin:
    """Dimensions of block and pin, mm; a pin wider than the block is a platen."""

    width: float = 10.0
    depth: float = 10.0
    height: float = 2.5
    pin_width: float = 4.0
    pin_fillet: float = 0.3

    def __post_init__(self) -> None:
        for name in ("width", "depth", "height", "pin_width", "pin_fillet"):
            value = getattr(self, name)
            if not value > 0.0:
                raise ValueError(f"{name}: expected a length above 0 mm, found {value}")
        if not self.pin_fillet < self.pin_width / 2.0:
            raise ValueError(
                f"pin_fillet: expected less than half the pin's width {self.pin_width} mm, "
                f"found {self.pin_fillet}"
            )


@dataclass(frozen=True)
class Contact:
    """What the block's surface does where it touches pin and base.

    It sticks ("stick"), slides without friction ("slide" or 0), or slides with a coefficient of
    Coulomb friction (a number above 0).  Sliding or not, the base does not lift.
    """

    pin: Interface = "stick"
    base: Interface = "stick"

    def __post_init__(self) -> None:
        for name in ("pin", "base"):
            value = getattr(self, name)
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if value not in ("stick", "slide") and not (number and 0.0 <= value < np.inf):
                raise ValueError(
                    f"{name}: expected 'stick', 'slide' or a coefficient of friction of 0 or more, "
                    f"found {value!r}"
                )

    def friction(self, slip: float) -> FrictionLaw:
        """Coefficients of friction, 0 also where the block sticks; `slip` in mm."""
        pin, base = (0.0 if isinstance(c, str) else float(c) for c in (self.pin, self.base))
        return FrictionLaw(pin, base, slip)


@dataclass(frozen=True)
class Discretisation:
    """Everything about one specimen that does not depend on the material."""

    elements: Elements
    faces: Faces
    pattern: Pattern
    glued: BoolArray
    """(n_face, n_q) contact points under the pin's flat part"""
    probe: sp.csr_matrix
    """(n_point, n_node) nodal values to values at the field points"""


@dataclass(frozen=True)
class BlockPinModel:
    """Simulation of the specimen as a function of the ratios (r, s); picklable, one thread.

    `cells` are the numbers of Q2 elements along x, y, z of the quarter; `travel` the pin travels
    (mm, increasing) at which the response is asked; `bulk_ratio` the bulk modulus over the shear
    modulus mu = 2 kappa; `field_grid` the numbers of field points along x and y of the quarter's
    front face, at the centres of equal rectangles (thesis, section 4.4.2: 35 x 24 = 840 points).
    """

    specimen: BlockPin
    contact: Contact
    cells: tuple[int, int, int]
    travel: tuple[float, ...]
    bulk_ratio: float = 200.0
    field_grid: tuple[int, int] = (35, 24)
    penalty: PenaltyLaw = field(default_factory=PenaltyLaw)
    steps: StepOptions = field(default_factory=StepOptions)
    newton: NewtonOptions = field(default_factory=NewtonOptions)

    def __post_init__(self) -> None:
        if min(self.cells) < 1:
            raise ValueError(f"cells: expected at least one element a side, found {self.cells}")
        travel = np.asarray(self.travel)
        if travel.size == 0 or travel[0] <= 0.0 or (np.diff(travel) <= 0.0).any():
            raise ValueError(f"travel: expected increasing travels above 0 mm, found {self.travel}")
        if travel[-1] >= self.specimen.height:
            raise ValueError(
                f"travel: expected less than the block's height {self.specimen.height} mm, "
                f"found {travel[-1]}"
            )
        if not self.bulk_ratio > 0.0:
            raise ValueError(f"bulk_ratio: expected a ratio above 0, found {self.bulk_ratio}")

    def points(self) -> Array:
        """(n_point, 2) reference x, y of the field points on the front face, mm."""
        nx, ny = self.field_grid
        x = (np.arange(nx) + 0.5) * self.specimen.width / 2.0 / nx
        y = (np.arange(ny) + 0.5) * self.specimen.height / ny
        return np.stack([c.ravel() for c in np.meshgrid(x, y, indexing="ij")], axis=1)

    def __call__(self, ratios: Array) -> Response:
        """Response at kappa = 1 MPa for ratios (r, s); a solver failure is a status, not a raise.

        Raises ValueError when the ratios do not give a material (two finite numbers).
        """
        ratios = np.asarray(ratios, dtype=np.float64)
        if ratios.shape != (2,) or not np.isfinite(ratios).all():
            raise ValueError(f"ratios: expected two finite numbers (r, s), found {ratios}")
        started = time.perf_counter()
        with threadpool_limits(limits=1):
            states, outcome, n_factorisations = self.solve(ratios)
        return self._response(states, outcome, n_factorisations, time.perf_counter() - started)

    def solve(self, ratios: Array, kappa: float = 1.0) -> tuple[list[TravelState], March, int]:
        """States of the quarter at the travels reached, at the given kappa (MPa)."""
        discrete = self.discretise()
        problem = self.problem(discrete, ratios, kappa)
        potential = Potential(problem)
        solver = SymmetricSolver(discrete.pattern.indptr, discrete.pattern.indices)
        outcome = March()
        try:
            states = list(
                march(
                    potential,
                    solver,
                    initial_memory(discrete.faces, discrete.glued, problem.pin, problem.friction),
                    self.travel,
                    outcome,
                    stick_to_pin=self.contact.pin == "stick",
                    stick_to_floor=self.contact.base == "stick",
                    steps=self.steps,
                    newton=self.newton,
                )
            )
        finally:
            solver.close()
        return states, outcome, solver.n_factorisations

    def problem(self, discrete: Discretisation, ratios: Array, kappa: float = 1.0) -> Problem:
        """The discrete problem at ratios (r, s) and kappa (MPa)."""
        return Problem(
            elements=discrete.elements,
            faces=discrete.faces,
            pattern=discrete.pattern,
            pin=RigidPin(
                height=self.specimen.height,
                half_width=self.specimen.pin_width / 2.0,
                fillet=self.specimen.pin_fillet,
                stiffness=self.penalty.stiffness * 2.0 * kappa,
                ramp=self.penalty.ramp,
                base_stiffness=self.penalty.base * 2.0 * kappa,
            ),
            material=mooney_rivlin_of_ratios(ratios, kappa, self.bulk_ratio * 2.0 * kappa),
            friction=self.contact.friction(self.penalty.slip),
        )

    def mesh(self) -> MeshHex:
        """Hexahedra of the quarter block, finer in x where material passes the pin's edge.

        Whole rows of nodes snap past the fillet when the block slides; fine rows there make the
        force curve smooth.  Along the bar little happens until near the front face, so the depth
        takes few elements, finer towards the front.
        """
        half_width, half_depth = self.specimen.width / 2.0, self.specimen.depth / 2.0
        nx, ny, nz = self.cells
        edge = self.specimen.pin_width / 2.0
        z = np.linspace(0.0, 1.0, nz + 1)
        return MeshHex.init_tensor(
            _graded_lines(half_width, nx, centre=0.7 * edge, spread=0.45 * edge),
            np.linspace(0.0, self.specimen.height, ny + 1),
            half_depth * z * (1.0 + DEPTH_GRADING * (1.0 - z)),
        )

    def discretise(self) -> Discretisation:
        """Tables of the quarter block's mesh, contact faces, constraints and field points."""
        mesh = self.mesh()
        table, basis = elements(mesh)
        half_width, height, half_depth = mesh.p.max(axis=1)
        tolerance = 1e-9 * height
        top = mesh.facets_satisfying(lambda x: abs(x[1] - height) < tolerance)
        side = mesh.facets_satisfying(
            lambda x: (abs(x[0] - half_width) < tolerance) | (abs(x[2] - half_depth) < tolerance)
        )
        rubs = self.contact.friction(self.penalty.slip).base > 0.0
        bottom = mesh.facets_satisfying(lambda x: abs(x[1]) < tolerance) if rubs else top[:0]
        kind = np.repeat([0, 1, 2], [top.size, side.size, bottom.size])
        contact_faces = faces(mesh, np.concatenate([top, side, bottom]), kind == 1, kind == 2)
        position = table.positions
        fixed = np.zeros(position.shape, dtype=bool)
        fixed[position[:, 0] < tolerance, 0] = True
        fixed[position[:, 2] < tolerance, 2] = True
        base = position[:, 1] < tolerance
        fixed[base, 1] = not rubs
        if self.contact.base == "stick":
            fixed[base] = True
        flat = self.specimen.pin_width / 2.0 - self.specimen.pin_fillet
        on_top = kind == 0
        glued = on_top[:, None] & (contact_faces.points[..., 0] <= flat)
        points = self.points()
        probe_at = np.vstack([points.T, np.full(len(points), half_depth)])
        return Discretisation(
            elements=table,
            faces=contact_faces,
            pattern=pattern(table.nodes, contact_faces.nodes, fixed.ravel()),
            glued=glued & (self.contact.pin == "stick"),
            probe=basis.probes(probe_at).tocsr(),
        )

    def _response(
        self, states: list[TravelState], outcome: March, n_factorisations: int, seconds: float
    ) -> Response:
        n_step, n_point = len(self.travel), len(self.points())
        force = np.full(n_step, np.nan)
        displacement = np.full((n_step, n_point, 3), np.nan)
        force_gradient = np.full((n_step, 2), np.nan)
        displacement_gradient = np.full((n_step, n_point, 3, 2), np.nan)
        negative = np.full(n_step, -1, dtype=np.int64)
        probe = self.discretise().probe
        for i, state in enumerate(states):
            force[i] = SYMMETRY_FACTOR * state.pin_force
            force_gradient[i] = SYMMETRY_FACTOR * state.force_gradient[:2]
            displacement[i] = probe @ state.u
            for j in range(2):
                displacement_gradient[i, :, :, j] = probe @ state.u_gradient[:, :, j]
            negative[i] = state.negative_pivots
        complete = len(states) == n_step
        return Response(
            travel=np.asarray(self.travel),
            force=force,
            displacement=displacement,
            force_gradient=force_gradient,
            displacement_gradient=displacement_gradient,
            reached=outcome.reached,
            status=Status.CONVERGED if complete else Status.STOPPED,
            message="reached every asked travel" if complete else outcome.reason,
            negative_pivots=negative,
            n_factorisations=n_factorisations,
            seconds=seconds,
        )


def _graded_lines(length: float, n: int, *, centre: float, spread: float) -> Array:
    """(n + 1,) mesh lines on [0, length], mm, densest at `centre` over a width of `spread`."""
    x = np.linspace(0.0, length, 4001)
    density = 1.0 + EDGE_DENSITY * np.exp(-(((x - centre) / spread) ** 2))
    count = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
    lines = np.interp(np.linspace(0.0, 1.0, n + 1), count / count[-1], x)
    lines[[0, -1]] = 0.0, length
    return lines
