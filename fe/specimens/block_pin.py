"""Soft block under a pin: the simulation of it as a function of its material.

The block (width x, height y, depth z) stands on a base; a rigid pin, filleted at its lower edge,
is pressed into the middle of its top.  A quarter is modelled (planes x = 0 and z = 0 through the
pin's centre), so forces are multiplied by four; where the pin's shift or rotation break that
symmetry, a half or the whole is.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from skfem import MeshHex
from threadpoolctl import threadpool_limits

from fe.contact import PenaltyLaw
from fe.contact_memory import initial_memory
from fe.force_control import Control, check_targets
from fe.linear_solver import SymmetricSolver
from fe.load_stepping import TravelState, march
from fe.material_parameters import MaterialParameters, all_parameters, ratio_parameters
from fe.materials.material import Material, mooney_rivlin_of_ratios
from fe.newton import NewtonOptions
from fe.parameters import Parameters
from fe.potential import Potential, Problem
from fe.progress import Progress, listener
from fe.response import Response
from fe.sensitivity import Objective
from fe.specimens.block_pin_field import FieldMotion, field_motion
from fe.specimens.block_pin_geometry import BlockPin, Contact, Interface, Symmetry
from fe.specimens.block_pin_mesh import (
    Discretisation,
    FieldGrid,
    block_mesh,
    check_field_grid,
    discretise,
    front_points,
)
from fe.specimens.block_pin_parameters import check_names, known_names, parameters
from fe.specimens.block_pin_part import SYMMETRY_FACTOR, check_part, modelled_part
from fe.specimens.block_pin_response import Seen, response
from fe.steps import March, StepOptions

__all__ = ["BlockPin", "BlockPinModel", "Contact", "Discretisation", "Interface"]

Array = npt.NDArray[np.float64]

FieldObjective = Callable[[int, Array, float], tuple[Array, float]]
"""(step, displacement (n_point, 3) mm, force N) -> derivatives of a scalar in these two"""


class _Run(NamedTuple):
    """A material and the parameters asked for."""

    material: Material
    shear: float
    """modulus that the contact stiffness goes with, MPa"""
    known: MaterialParameters
    names: tuple[str, ...]


@dataclass(frozen=True)
class BlockPinModel:
    """Simulation of the specimen as a function of its material; picklable, one thread.

    `cells` are the numbers of Q2 elements along x, y, z of a quarter; `travel` the pin travels
    (mm, increasing) at which the response is asked, or `force` the forces of the whole sample (N,
    increasing; at kappa = 1 MPa for ratios); `bulk_ratio` the bulk modulus over the shear
    modulus mu = 2 kappa where ratios (r, s) are asked; `field_grid` the numbers of field points
    along x and y of half the front face, at the centres of equal rectangles (thesis, section
    4.4.2: 35 x 24 = 840 points).  `symmetry` "auto" models the smallest part that stands for the
    whole; a half has both sides of the plane x = 0, and its field too.  In `plane_strain` nothing
    moves along z: one element along it does (cells (nx, ny, 1)), and forces are those of a block of
    the depth whose ends are held; much faster, and good for what does not depend on the ends.
    `sensitivities` names the
    parameters of the response's gradients (`parameter_names` lists all there are), by default
    those that it is a function of.  Field points keep their places as fractions of width and
    height, so they move with these; gradients are those of what is seen there.

    Raises ValueError for impossible numbers, for a symmetry that the pin's place breaks, and where
    nothing keeps a half or full block from sliding away; in plane strain also for more than one
    element along z and for a pin that is no straight bar.
    """

    specimen: BlockPin
    contact: Contact
    cells: tuple[int, int, int]
    travel: tuple[float, ...] = ()
    bulk_ratio: float = 200.0
    field_grid: FieldGrid = (35, 24)
    penalty: PenaltyLaw = field(default_factory=PenaltyLaw)
    steps: StepOptions = field(default_factory=StepOptions)
    newton: NewtonOptions = field(default_factory=NewtonOptions)
    symmetry: Literal["auto"] | Symmetry = "auto"
    sensitivities: tuple[str, ...] | None = None
    force: tuple[float, ...] = ()
    plane_strain: bool = False

    def __post_init__(self) -> None:
        cells = np.asarray(self.cells)
        if cells.shape != (3,) or cells.dtype.kind != "i" or cells.min() < 1:
            raise ValueError(f"cells: expected 3 whole numbers of at least 1, found {self.cells}")
        if isinstance(self.sensitivities, str):
            raise ValueError(f"sensitivities: expected a tuple, found {self.sensitivities!r}")
        check_targets(self.travel, self.force)
        if max(self.travel, default=0.0) >= self.specimen.height:
            raise ValueError(
                f"travel: expected less than the block's height {self.specimen.height} mm, "
                f"found {self.travel[-1]}"
            )
        if not self.bulk_ratio > 0.0:
            raise ValueError(f"bulk_ratio: expected a ratio above 0, found {self.bulk_ratio}")
        check_part(self.specimen, self.contact, self.symmetry)
        check_field_grid(self.field_grid, self.specimen, self.part)
        straight = self.specimen.pin == "bar" and not self.specimen.turned
        if self.plane_strain and not (straight and self.cells[2] == 1 and self.part != "full"):
            raise ValueError(
                f"plane_strain: expected a bar along z, a quarter or half model and one element "
                f"along z, found pin={self.specimen.pin!r} turned by "
                f"{self.specimen.pin_rotation} degrees, a {self.part} model, cells={self.cells}"
            )

    @property
    def part(self) -> Symmetry:
        """What part of the block is modelled."""
        return modelled_part(self.specimen, self.symmetry)

    @property
    def control(self) -> Control:
        """What is asked."""
        return "force" if self.force else "travel"

    def points(self) -> Array:
        """(n_point, 2) reference x, y of the field points on the front face, mm."""
        return front_points(self.specimen, self.part, self.field_grid)

    def parameter_names(self, material: Material | None = None) -> tuple[str, ...]:
        """Names that `sensitivities` may have: of ratios, or of a material if one is given."""
        own = ("r", "s", "bulk_ratio") if material is None else all_parameters(material).names
        return (*own, *known_names(self.specimen, self.contact, self.part))

    def __call__(self, ratios: Array) -> Response:
        """Response at kappa = 1 MPa for ratios (r, s); a solver failure is a status, not a raise.

        Raises ValueError when the ratios do not give a material (two finite numbers), and for
        sensitivities that there are not.
        """
        ratios = np.asarray(ratios, dtype=np.float64)
        if ratios.shape != (2,) or not np.isfinite(ratios).all():
            raise ValueError(f"ratios: expected two finite numbers (r, s), found {ratios}")
        return self._respond(self._at(ratios))

    def respond(self, material: Material, progress: Progress | None = None) -> Response:
        """Response of a material, with derivatives in every constant and, last, the bulk modulus.

        `progress` is called after each step of the solver. `bulk_ratio` is not used. The contact
        stiffness goes with the material's shear modulus, and so it does in the derivatives. A
        solver failure is a status, not a raise.

        Raises ValueError when the material is incompressible (infinite bulk modulus), and for
        sensitivities that there are not.
        """
        return self._respond(self._of(material), progress)

    def objective_gradients(self, material: Material, objective: FieldObjective) -> Array:
        """(n_step, n_p) derivatives of a scalar of each travel's response, by the adjoint.

        `objective` takes the step's number, the displacement (n_point, 3) mm and the force N of
        the whole sample, and gives the scalar's derivatives in these two.  One transposed solve
        for each travel takes the place of one for each parameter; where contact has a memory
        (stick, friction), the direct derivatives are still carried forward for its sake.  NaN
        beyond the travel that was reached.

        Raises ValueError as `respond` does, and where forces are asked instead of travels.
        """
        if self.force:
            raise ValueError(f"force: expected asked travels for the adjoint, found {self.force}")
        run = self._of(material)
        discrete = self.discretise()
        found = np.full((len(self.travel), len(run.names)), np.nan)
        factor, steps = SYMMETRY_FACTOR[self.part], iter(range(len(self.travel)))
        explicit, motion = [], self._field_motion(run.names)

        def of_state(travel: float, u: Array, force: float) -> tuple[Array, float]:
            by_field, by_force = objective(next(steps), discrete.probe @ u, factor * force)
            explicit.append(np.einsum("pi,pij->j", by_field, motion.seen(u)))
            return discrete.probe.T @ by_field, factor * by_force

        with threadpool_limits(limits=1):
            states, _, _ = self._march(run, of_state)
        for i, state in enumerate(states):
            found[i] = state.objective_gradient + explicit[i]
        return found

    def solve_for(
        self, material: Material, progress: Progress | None = None
    ) -> tuple[list[TravelState], March, int]:
        """States of the modelled part of a block of this material at the targets reached."""
        return self._march(self._of(material), progress=progress)

    def solve(self, ratios: Array, kappa: float = 1.0) -> tuple[list[TravelState], March, int]:
        """States of the modelled part at the travels reached, at the given kappa (MPa)."""
        return self._march(self._at(ratios, kappa))

    def _at(self, ratios: Array, kappa: float = 1.0) -> _Run:
        material = mooney_rivlin_of_ratios(ratios, kappa, self.bulk_ratio * 2.0 * kappa)
        known = ratio_parameters(material)
        names = ("r", "s") if self.sensitivities is None else self.sensitivities
        return self._run(material, 2.0 * kappa, known, names)

    def _of(self, material: Material) -> _Run:
        known = all_parameters(material)
        names = known.names if self.sensitivities is None else self.sensitivities
        return self._run(material, material.shear_modulus, known, names)

    def _run(
        self, material: Material, shear: float, known: MaterialParameters, names: tuple[str, ...]
    ) -> _Run:
        others = known_names(self.specimen, self.contact, self.part)
        check_names(names, (*known.names, *others))
        return _Run(material, shear, known, names)

    def _respond(self, run: _Run, progress: Progress | None = None) -> Response:
        started = time.perf_counter()
        with threadpool_limits(limits=1):
            solved = self._march(run, progress=progress)
        return self._response(*solved, time.perf_counter() - started, run.names)

    def _march(
        self, run: _Run, objective: Objective | None = None, progress: Progress | None = None
    ) -> tuple[list[TravelState], March, int]:
        """States at the targets reached, outcome, number of factorisations."""
        discrete = self.discretise()
        problem = self._problem(discrete, run.material, run.shear)
        along = self.parameters(run.names, run.known, problem, run.shear)
        memory = initial_memory(
            discrete.faces, discrete.glued, problem.pin, along.surface, along.at_rest
        )
        solver = SymmetricSolver(discrete.pattern.indptr, discrete.pattern.indices)
        factor = SYMMETRY_FACTOR[self.part]
        outcome = March(listen=listener(progress, factor))
        try:
            states = list(
                march(
                    Potential(problem),
                    solver,
                    memory,
                    self.travel or tuple(f / factor for f in self.force),
                    outcome,
                    parameters=along,
                    stick_to_pin=self.contact.pin == "stick",
                    stick_to_floor=self.contact.base == "stick",
                    steps=self.steps,
                    newton=self.newton,
                    control=self.control,
                    objective=objective,
                )
            )
        finally:
            solver.close()
        return states, outcome, solver.n_factorisations

    def parameters(
        self, names: tuple[str, ...], known: MaterialParameters, problem: Problem, shear: float
    ) -> Parameters:
        """How the discrete problem depends on the named parameters; `shear` as in the contact."""
        return parameters(
            names,
            known,
            problem,
            self.specimen,
            shear,
            lambda specimen: block_mesh(specimen, self.part, self.cells, self.contact),
        )

    def problem(self, discrete: Discretisation, ratios: Array, kappa: float = 1.0) -> Problem:
        """The discrete problem at ratios (r, s) and kappa (MPa)."""
        material = mooney_rivlin_of_ratios(ratios, kappa, self.bulk_ratio * 2.0 * kappa)
        return self._problem(discrete, material, 2.0 * kappa)

    def _problem(self, discrete: Discretisation, material: Material, shear: float) -> Problem:
        """The discrete problem with contact as stiff as for the shear modulus `shear` (MPa)."""
        penalty = self.penalty
        return Problem(
            elements=discrete.elements,
            faces=discrete.faces,
            pattern=discrete.pattern,
            pin=self.specimen.rigid_pin(
                penalty.stiffness * shear, penalty.ramp, penalty.base * shear
            ),
            material=material,
            friction=self.contact.friction(penalty.slip),
        )

    def mesh(self) -> MeshHex:
        """Hexahedra of the modelled part of the block."""
        return block_mesh(self.specimen, self.part, self.cells, self.contact)

    def discretise(self) -> Discretisation:
        """Tables of the mesh, contact faces, constraints and field points."""
        pin = self.specimen.rigid_pin(1.0, 1.0, 1.0)  # where it is, not how stiff
        return discretise(
            self.specimen,
            self.contact,
            self.part,
            self.mesh(),
            pin,
            self.points(),
            plane_strain=self.plane_strain,
        )

    def _field_motion(self, names: tuple[str, ...]) -> FieldMotion:
        return field_motion(
            names,
            self.specimen,
            lambda specimen: block_mesh(specimen, self.part, self.cells, self.contact),
            lambda specimen: front_points(specimen, self.part, self.field_grid),
        )

    def _response(
        self,
        states: list[TravelState],
        outcome: March,
        n_factorisations: int,
        seconds: float,
        names: tuple[str, ...],
    ) -> Response:
        return response(
            states,
            outcome,
            Seen(
                np.asarray(self.travel or self.force),
                self.control,
                self.points(),
                self.discretise().probe,
                self._field_motion(names),
                SYMMETRY_FACTOR[self.part],
            ),
            names,
            n_factorisations,
            seconds,
        )
