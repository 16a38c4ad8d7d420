"""Soft block under a pin: the simulation of it as a function of its material.

The block (width x, height y, depth z) stands on a base; a rigid pin, filleted at its lower edge,
is pressed into the middle of its top.  A quarter is modelled (planes x = 0 and z = 0 through the
pin's centre), so forces are multiplied by four; where the pin's shift or rotation break that
symmetry, a half or the whole is.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from skfem import MeshHex
from threadpoolctl import threadpool_limits

from fe.campaign_parameters import RATIOS, Parameter
from fe.contact import PenaltyLaw
from fe.force_control import Control, keep_targets
from fe.load_stepping import TravelState
from fe.material_parameters import MaterialParameters, all_parameters, ratio_parameters
from fe.materials.material import Material, mooney_rivlin_of_ratios
from fe.newton import NewtonOptions
from fe.parameters import Parameters, check_names, keep_asked
from fe.potential import Problem
from fe.pressing import press
from fe.progress import Progress, listener
from fe.response import Response
from fe.seen import FieldObjective, Seen, objective_gradients, response
from fe.sensitivity import Objective
from fe.specimens.block_pin_field import field_motion
from fe.specimens.block_pin_geometry import BlockPin, Contact, Interface, Symmetry
from fe.specimens.block_pin_mesh import (
    Discretisation,
    block_mesh,
    check_field_grid,
    contact_faces,
    discretise,
    front_points,
)
from fe.specimens.block_pin_parameters import known_names, parameters
from fe.specimens.block_pin_part import (
    SYMMETRY_FACTOR,
    check_part,
    check_plane_strain,
    check_room,
    modelled_part,
)
from fe.specimens.checks import check_bulk_ratio, check_kinds, check_travel, keep_counts
from fe.specimens.field_grid import FieldGrid, keep_field_grid
from fe.specimens.ring_mesh import Cells, Rings, check_rings
from fe.specimens.turned_bar import edge_crosses_elements
from fe.specimens.under_pin import pressed_of, problem_of
from fe.steps import March, StepOptions
from fe.surface_slopes import SurfaceSlopes

__all__ = ["BlockPin", "BlockPinModel", "Cells", "Contact", "Discretisation", "Interface", "Rings"]

Array = npt.NDArray[np.float64]


class _Run(NamedTuple):
    """A material and the parameters asked for."""

    material: Material
    shear: float
    """modulus that the contact stiffness goes with, MPa"""
    known: MaterialParameters
    names: tuple[str, ...]
    lines: Callable[[BlockPin], MeshHex]
    """the mesh of a specimen, made once of each"""


@dataclass(frozen=True)
class BlockPinModel:
    """Simulation of the specimen as a function of its material; picklable, one thread.

    `cells` are the numbers of Q2 elements along x, y, z of a quarter, or `Rings` that follow the
    rim of a round pin; `travel` the pin travels (mm, increasing) at which the response is asked, or
    `force` the forces of the whole sample (N, increasing; at kappa = 1 MPa for ratios);
    `bulk_ratio` the bulk modulus over the shear modulus mu = 2 kappa where ratios (r, s) are asked;
    `field_grid` the numbers of field points along x and y of half the front face, at the centres of
    equal rectangles (thesis, section 4.4.2: 35 x 24 = 840 points). `symmetry` "auto" models the
    smallest part that stands for the whole; a half has both sides of the plane x = 0, and its field
    too. In `plane_strain` nothing moves along z: one element along it does (cells (nx, ny, 1)), and
    forces are those of a block of the depth whose ends are held; much faster, and good for what
    does not depend on the ends.
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
    cells: Cells
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
    columns: ClassVar[tuple[Parameter, ...]] = RATIOS
    """of a row of a campaign's design"""

    def __post_init__(self) -> None:
        check_kinds(self, specimen=BlockPin, contact=Contact, penalty=PenaltyLaw)
        check_kinds(self, steps=StepOptions, newton=NewtonOptions)
        if not isinstance(self.cells, Rings):
            keep_counts(self, "cells", (1, 1, 1))
        keep_asked(self)
        keep_targets(self)
        check_travel(self.travel, self.specimen.height, "block's height")
        check_bulk_ratio(self.bulk_ratio)
        check_part(self.specimen, self.contact, self.symmetry)
        check_room(self.specimen)
        if isinstance(self.cells, Rings):
            check_rings(self.specimen, self.part)
        check_field_grid(self.field_grid, self.specimen, self.part)
        keep_field_grid(self)
        if not isinstance(self.plane_strain, bool):
            raise ValueError(f"plane_strain: expected True or False, found {self.plane_strain!r}")
        if self.plane_strain:
            check_plane_strain(self.specimen, self.cells, self.part)

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
        run = self._of(material)

        discrete = self.discretise()

        def states(of_state: Objective) -> list[TravelState]:
            return self._march(run, discrete, of_state)[0]

        with threadpool_limits(limits=1):
            return objective_gradients(states, self._seen(run, discrete), objective)

    def solve_for(
        self, material: Material, progress: Progress | None = None
    ) -> tuple[list[TravelState], March, int]:
        """States of the modelled part of a block of this material at the targets reached."""
        return self._march(self._of(material), self.discretise(), progress=progress)

    def solve(self, ratios: Array, kappa: float = 1.0) -> tuple[list[TravelState], March, int]:
        """States of the modelled part at the travels reached, at the given kappa (MPa)."""
        return self._march(self._at(ratios, kappa), self.discretise())

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
        return _Run(material, shear, known, names, functools.cache(self._mesh_of))

    def _respond(self, run: _Run, progress: Progress | None = None) -> Response:
        started = time.perf_counter()
        with threadpool_limits(limits=1):
            discrete = self.discretise()
            states, outcome, n_factorisations = self._march(run, discrete, progress=progress)
        seconds = time.perf_counter() - started
        seen = self._seen(run, discrete)
        return response(states, outcome, seen, n_factorisations, seconds)

    def _march(
        self,
        run: _Run,
        discrete: Discretisation,
        objective: Objective | None = None,
        progress: Progress | None = None,
    ) -> tuple[list[TravelState], March, int]:
        """States at the targets reached, outcome, number of factorisations."""
        problem = self._problem(discrete, run.material, run.shear)
        along = self.parameters(run.names, run.known, problem, run.shear, run.lines)
        factor = SYMMETRY_FACTOR[self.part]
        pressed = pressed_of(self, problem, discrete, factor)._replace(doubt=self._doubt())
        return press(pressed, along, objective, listener(progress, factor))

    def _doubt(self) -> str:
        """What about the mesh is less good than of a straight bar."""
        if not edge_crosses_elements(self.specimen):
            return ""
        glued = (
            ", and glue that ends inside elements stiffens them; derivatives in the bar's place, "
            "width and turn leave out which points it holds"
        )
        return "the edge of the turned bar crosses elements" + (
            glued if self.contact.pin == "stick" else ""
        )

    def parameters(
        self,
        names: tuple[str, ...],
        known: MaterialParameters,
        problem: Problem,
        shear: float,
        lines: Callable[[BlockPin], MeshHex] | None = None,
    ) -> Parameters[SurfaceSlopes]:
        """How the discrete problem depends on the named parameters.

        `shear` is as in the contact; `lines` makes the mesh of a specimen, if that is kept.
        """
        mesh = lines or self._mesh_of
        rubs = self.contact.friction(1.0).base > 0.0

        def area(of: BlockPin) -> Array:
            return contact_faces(mesh(of), of, rubs, ends=True)[0].weights

        grid = not isinstance(self.cells, Rings) and self.part != "full"
        args = (names, known, problem, self.specimen, shear, mesh)
        return parameters(*args, area=None if grid else area)

    def problem(self, discrete: Discretisation, ratios: Array, kappa: float = 1.0) -> Problem:
        """The discrete problem at ratios (r, s) and kappa (MPa)."""
        material = mooney_rivlin_of_ratios(ratios, kappa, self.bulk_ratio * 2.0 * kappa)
        return self._problem(discrete, material, 2.0 * kappa)

    def _problem(self, discrete: Discretisation, material: Material, shear: float) -> Problem:
        """The discrete problem with contact as stiff as for the shear modulus `shear` (MPa)."""
        return problem_of(self, self.specimen, discrete, material, shear)

    def mesh(self) -> MeshHex:
        """Hexahedra of the modelled part of the block."""
        return self._mesh_of(self.specimen)

    def _mesh_of(self, specimen: BlockPin) -> MeshHex:
        return block_mesh(specimen, self.part, self.cells, self.contact, self.specimen)

    def discretise(self) -> Discretisation:
        """Tables of the mesh, contact faces, constraints and field points."""
        pin = self.specimen.rigid_pin(1.0, 1.0, 1.0)  # where it is, not how stiff
        of = (self.specimen, self.contact, self.part, self.mesh(), pin, self.points())
        return discretise(*of, plane_strain=self.plane_strain)

    def _seen(self, run: _Run, discrete: Discretisation) -> Seen:
        motion = field_motion(
            run.names,
            self.specimen,
            run.lines,
            lambda specimen: front_points(specimen, self.part, self.field_grid),
            discrete.probe,
        )
        return Seen(
            np.asarray(self.travel or self.force),
            self.control,
            self.points(),
            discrete.probe.values,
            motion,
            SYMMETRY_FACTOR[self.part],
            run.names,
        )
