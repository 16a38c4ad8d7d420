"""A round disc under a round pin, axisymmetric: the fast lane of `fe.specimens.block_pin`.

The disc (diameter, height) stands on a base; a rigid round pin, filleted at its lower edge, is
pressed into the middle of its top.  The half section (r, y) is modelled, with the contact of pin
and base of the block: stick, slide or friction, also on the side that rolls over.  Displacements of
the response are (u_r, u_y, 0) on the side r = diameter / 2.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
from skfem import MeshQuad
from threadpoolctl import threadpool_limits

from fe.campaign_parameters import RATIOS, Parameter
from fe.contact import Faces, PenaltyLaw
from fe.driven import unknowns
from fe.field_motion import field_probe, passing
from fe.force_control import Control, keep_targets
from fe.load_stepping import TravelState
from fe.material_parameters import MaterialParameters, all_parameters, ratio_parameters
from fe.materials.material import Material, mooney_rivlin_of_ratios
from fe.newton import NewtonOptions
from fe.parameters import check_names, keep_asked
from fe.pin_surface import under_flat
from fe.plane_elements import axisymmetric_elements, hoop_equations
from fe.plate import ring_edges
from fe.pressing import press
from fe.progress import Progress, listener
from fe.response import OF_REVOLUTION, Response
from fe.seen import FieldObjective, Seen, objective_gradients, response
from fe.sensitivity import Objective
from fe.specimens.block_pin_geometry import BlockPin, Contact
from fe.specimens.block_pin_mesh import Discretisation, block_mesh
from fe.specimens.block_pin_parameters import by_geometry, known_names, mesh_motion, parameters
from fe.specimens.checks import (
    check_bulk_ratio,
    check_counts,
    check_kinds,
    check_lengths,
    check_travel,
    keep_counts,
)
from fe.specimens.under_pin import pressed_of, problem_of
from fe.steps import March, StepOptions

Array = npt.NDArray[np.float64]

DIMENSIONS = {
    "diameter": "width",
    "height": "height",
    "pin_width": "pin_width",
    "pin_fillet": "pin_fillet",
}
"""of a disc, and what a block calls them"""


@dataclass(frozen=True)
class Disc:
    """Dimensions of disc and pin, mm; a pin wider than the disc is a platen.

    Raises ValueError for lengths that are not above 0 and a fillet of half the pin's width.
    """

    diameter: float = 10.0
    height: float = 2.5
    pin_width: float = 4.0
    """diameter of the pin"""
    pin_fillet: float = 0.3

    def __post_init__(self) -> None:
        check_lengths(self)
        self.block()

    def block(self) -> BlockPin:
        """The square block that the disc is inscribed in."""
        return BlockPin(
            width=self.diameter,
            depth=self.diameter,
            height=self.height,
            pin_width=self.pin_width,
            pin_fillet=self.pin_fillet,
            pin="round",
        )


class _Run(NamedTuple):
    """A material and the parameters asked for."""

    material: Material
    known: MaterialParameters
    names: tuple[str, ...]


@dataclass(frozen=True)
class DiscPinModel:
    """Simulation of the disc as a function of (r, s) or of any material; picklable, one thread.

    `cells` are the numbers of Q2 elements along radius and height; `n_point` the number of field
    points along the side; all else is as of `fe.BlockPinModel`, forces those of the whole disc.
    Sensitivities are also in "diameter", "height", "pin_width", "pin_fillet" and "travel_zero".
    Raises ValueError for impossible numbers.
    """

    specimen: Disc
    contact: Contact
    cells: tuple[int, int]
    travel: tuple[float, ...] = ()
    bulk_ratio: float = 200.0
    n_point: int = 20
    penalty: PenaltyLaw = field(default_factory=PenaltyLaw)
    steps: StepOptions = field(default_factory=StepOptions)
    newton: NewtonOptions = field(default_factory=NewtonOptions)
    sensitivities: tuple[str, ...] | None = None
    force: tuple[float, ...] = ()
    columns: ClassVar[tuple[Parameter, ...]] = RATIOS
    """of a row of a campaign's design"""

    def __post_init__(self) -> None:
        check_kinds(self, specimen=Disc, contact=Contact, penalty=PenaltyLaw)
        check_kinds(self, steps=StepOptions, newton=NewtonOptions)
        keep_counts(self, "cells", (1, 1))
        check_counts("n_point", self.n_point, 1)
        keep_targets(self)
        keep_asked(self)
        check_travel(self.travel, self.specimen.height, "height")
        check_bulk_ratio(self.bulk_ratio)

    @property
    def control(self) -> Control:
        """What is asked."""
        return "force" if self.force else "travel"

    def points(self) -> Array:
        """(n_point, 2) reference r, y of the field points on the side, mm."""
        return self._points(self.specimen.block())

    def parameter_names(self, material: Material | None = None) -> tuple[str, ...]:
        """Names that `sensitivities` may have: of ratios, or of a material if one is given."""
        own = ("r", "s", "bulk_ratio") if material is None else all_parameters(material).names
        return (*own, *self._known_names())

    def __call__(self, ratios: Array) -> Response:
        """Response at kappa = 1 MPa for ratios (r, s).

        Raises ValueError when the ratios do not give a material (two finite numbers), and for
        sensitivities that there are not.
        """
        material = mooney_rivlin_of_ratios(ratios, 1.0, 2.0 * self.bulk_ratio)
        return self._respond(self._run(material, ratio_parameters(material), ("r", "s")), None)

    def respond(self, material: Material, progress: Progress | None = None) -> Response:
        """Response of any material, by default with gradients in its constants and bulk modulus.

        `progress` is called after each step of the solver.  Raises ValueError for sensitivities
        that there are not, and when the material is incompressible (infinite bulk modulus).
        """
        return self._respond(self._of(material), progress)

    def objective_gradients(self, material: Material, objective: FieldObjective) -> Array:
        """(n_step, n_p) derivatives of a scalar of each travel's response, by the adjoint.

        As of `fe.BlockPinModel.objective_gradients`.
        """
        run = self._of(material)

        discrete = self.discretise()

        def states(of_state: Objective) -> list[TravelState]:
            return self._march(run, discrete, of_state, None)[0]

        return objective_gradients(states, self._seen(run.names, discrete), objective)

    def solve_for(
        self, material: Material, progress: Progress | None = None
    ) -> tuple[list[TravelState], March, int]:
        """States of the half section at the targets reached, outcome, factorisations."""
        return self._march(self._of(material), self.discretise(), None, progress)

    def mesh(self) -> MeshQuad:
        """Half section (r, y), with the lines of a block under a round pin."""
        return self._mesh(self.specimen.block())

    def discretise(self) -> Discretisation:
        """Tables of the section, contact edges, constraints and field points."""
        mesh, contact, block = self.mesh(), self.contact, self.specimen.block()
        table, basis = axisymmetric_elements(mesh)
        tolerance = 1e-9 * block.height
        rubs = contact.friction(1.0).base > 0.0
        faces, on_top = _contact_edges(mesh, block, rubs)
        fixed = np.zeros((basis.N, 2), dtype=bool)
        fixed[basis.doflocs[0] < tolerance, 0] = True
        base = basis.doflocs[1] < tolerance
        fixed[base, 1] = not rubs
        if contact.base == "stick":
            fixed[base] = True
        glued = on_top[:, None] & under_flat(faces.points, block.rigid_pin(1.0, 1.0, 1.0))
        return Discretisation(
            elements=table,
            faces=faces,
            pattern=unknowns(table.nodes, hoop_equations(fixed), faces.nodes),
            glued=glued & (contact.pin == "stick"),
            probe=field_probe(basis, self.points(), n_hidden=basis.N),
        )

    def _of(self, material: Material) -> _Run:
        known = all_parameters(material)
        return self._run(material, known, known.names)

    def _run(self, material: Material, known: MaterialParameters, default: tuple[str, ...]) -> _Run:
        names = default if self.sensitivities is None else self.sensitivities
        check_names(names, (*known.names, *self._known_names()))
        return _Run(material, known, names)

    def _known_names(self) -> tuple[str, ...]:
        """Of all parameters other than the material's."""
        own = {of_block: name for name, of_block in DIMENSIONS.items()}
        names = known_names(self.specimen.block(), self.contact, "quarter")
        return tuple(own.get(name, name) for name in names if name != "depth")

    def _respond(self, run: _Run, progress: Progress | None) -> Response:
        started = time.perf_counter()
        discrete = self.discretise()
        states, outcome, n_factorisations = self._march(run, discrete, None, progress)
        seconds = time.perf_counter() - started
        return response(states, outcome, self._seen(run.names, discrete), n_factorisations, seconds)

    def _march(
        self,
        run: _Run,
        discrete: Discretisation,
        objective: Objective | None,
        progress: Progress | None,
    ) -> tuple[list[TravelState], March, int]:
        shear = run.material.shear_modulus
        block = self.specimen.block()
        problem = problem_of(self, block, discrete, run.material, shear)
        of_block = tuple(DIMENSIONS.get(name, name) for name in run.names)
        along = parameters(of_block, run.known, problem, block, shear, self._mesh, ring=True)
        pressed = pressed_of(self, problem, discrete, 1.0)
        with threadpool_limits(limits=1):
            return press(pressed, along, objective, listener(progress, 1.0))

    def _mesh(self, block: BlockPin) -> MeshQuad:
        lines = block_mesh(block, "quarter", (*self.cells, 1), self.contact).p
        return MeshQuad.init_tensor(np.unique(lines[0]), np.unique(lines[1]))

    def _points(self, block: BlockPin) -> Array:
        y = (np.arange(self.n_point) + 0.5) * block.height / self.n_point
        return np.stack([np.full(self.n_point, block.width / 2.0), y], axis=1)

    def _seen(self, names: tuple[str, ...], discrete: Discretisation) -> Seen:
        block, at = self.specimen.block(), self.points()
        passed = np.zeros((*at.shape, len(names)))
        for j, name in enumerate(names):
            of_block = DIMENSIONS.get(name, name)
            moved = by_geometry(of_block, block, self._points)
            if moved is not None:
                passed[..., j] = moved - mesh_motion(of_block, block, at, self._mesh)
        return Seen(
            targets=np.asarray(self.travel or self.force),
            control=self.control,
            points=at,
            probe=discrete.probe.values,
            motion=passing(passed, discrete.probe),
            factor=1.0,
            names=names,
            components=OF_REVOLUTION,
        )


def _contact_edges(
    mesh: MeshQuad, block: BlockPin, rubs: bool
) -> tuple[Faces, npt.NDArray[np.bool_]]:
    """Edges that may touch, and which of them (n_edge,) are on top; the bottom's if it rubs."""
    tolerance = 1e-9 * block.height
    top = mesh.facets_satisfying(lambda x: abs(x[1] - block.height) < tolerance)
    side = mesh.facets_satisfying(lambda x: abs(x[0] - block.width / 2.0) < tolerance)
    bottom = mesh.facets_satisfying(lambda x: abs(x[1]) < tolerance) if rubs else top[:0]
    kind = np.repeat([0, 1, 2], [top.size, side.size, bottom.size])
    ring = ring_edges(mesh, np.concatenate([top, side, bottom]))
    points = np.concatenate([ring.points, np.zeros((*ring.weights.shape, 1))], axis=2)
    faces = Faces(ring.nodes, ring.shape, ring.weights, points, kind == 1, kind == 2)
    return faces, kind == 0
