"""A cylinder compressed between two rigid plates: axisymmetric, bonded, sliding or with friction.

The upper half is modelled (the plane z = 0 is one of symmetry), so the plate comes down by half the
travel.  Ends that are bonded or slide keep flat on the plate; the free side may roll over onto it.
Displacements of the response are (u_r, u_z, 0) on the side r = diameter / 2.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt
from skfem import Basis, ElementQuad2, MeshQuad

from fe import driven_response
from fe.campaign_parameters import RATIOS, Parameter
from fe.contact import PenaltyLaw
from fe.driven import DrivenProblem, unknowns
from fe.driven_parameters import Shape, plate_shape
from fe.driven_response import DrivenSpecimen, Schedule
from fe.field_motion import field_probe
from fe.force_control import keep_targets
from fe.newton import NewtonOptions
from fe.parameters import keep_asked
from fe.plane_elements import axisymmetric_elements, hoop_equations, with_hoop
from fe.plate import Edges, Plate, ring_edges
from fe.positive_numbers import is_number
from fe.response import OF_REVOLUTION
from fe.specimens.checks import (
    check_bulk_ratio,
    check_counts,
    check_kinds,
    check_length,
    check_lengths,
    check_travel,
    keep_counts,
)
from fe.steps import StepOptions

Array = npt.NDArray[np.float64]

SYMMETRY_FACTOR = 2.0
STIFFNESS, RAMP = 15000.0, 1.0 / 150.0
"""default penalty: stiffness = STIFFNESS / height, ramp = RAMP * height; softer than a block's"""
GRADING = 0.7
"""0 is a uniform mesh; elements shrink towards the rim of the plate as it grows to 1"""


@dataclass(frozen=True)
class Cylinder:
    """Dimensions, mm; raises ValueError unless above 0."""

    diameter: float = 50.0
    height: float = 30.0

    def __post_init__(self) -> None:
        check_lengths(self)


@dataclass(frozen=True)
class CylinderModel:
    """Simulation of the cylinder as a function of (r, s) or of any material; picklable, one thread.

    `ends` are bonded to the plates or slide on them with the coefficient `friction`, which also
    acts on a side that has rolled over. `cells` are the numbers of Q2 elements along the radius and
    half the height; `travel` the approaches of the plates (mm, increasing) at which the response is
    asked, or `force` the forces (N, increasing); `bulk_ratio` the bulk modulus over mu = 2 kappa
    for calls with ratios; `n_point` the number of field points along half the side.
    `sensitivities` names the parameters of the response's gradients (`parameter_names` lists all
    there are), by default those that it is a function of. Field points keep their fractions of the
    height; gradients are those of what is seen there. With friction they are those of the
    path-dependent scheme: its slips count from the step before. Where a change of a constant makes
    the scheme take other steps, as where the side first meets a plate, the force jumps by some
    3e-4 of itself; its derivatives are those between such jumps.
    """

    specimen: Cylinder
    cells: tuple[int, int]
    travel: tuple[float, ...] = ()
    ends: Literal["bonded", "slide"] = "slide"
    friction: float = 0.0
    bulk_ratio: float = 200.0
    n_point: int = 20
    slip: float = 0.01
    """length over which friction builds up in a step, mm"""
    penalty: PenaltyLaw | None = None
    """of the side that rolls over, stiffness and ramp; by default one that gives way by the same
    share of the height whatever this is: 500 / mm and 0.2 mm at 30 mm. Gradients in the height are
    of one that stays, as a given one does"""
    steps: StepOptions = field(default_factory=lambda: StepOptions(0.25, 1.0, 0.005))
    newton: NewtonOptions = field(default_factory=lambda: NewtonOptions(1e-8, max_move=1.0))
    force: tuple[float, ...] = ()
    sensitivities: tuple[str, ...] | None = None
    columns: ClassVar[tuple[Parameter, ...]] = RATIOS
    """of a row of a campaign's design"""

    def __post_init__(self) -> None:
        check_kinds(self, specimen=Cylinder, steps=StepOptions, newton=NewtonOptions)
        if self.penalty is not None:
            check_kinds(self, penalty=PenaltyLaw)
            _check_penalty(self.penalty)
        keep_counts(self, "cells", (1, 1))
        check_counts("n_point", self.n_point, 1)
        keep_targets(self)
        keep_asked(self)
        check_travel(self.travel, self.specimen.height, "height")
        if self.ends not in ("bonded", "slide"):
            raise ValueError(f"ends: expected 'bonded' or 'slide', found {self.ends!r}")
        if not (is_number(self.friction) and 0.0 <= self.friction < np.inf):
            raise ValueError(
                f"friction: expected a finite coefficient of at least 0, found {self.friction!r}"
            )
        check_length("slip", self.slip)
        check_bulk_ratio(self.bulk_ratio)

    @property
    def law(self) -> PenaltyLaw:
        """The penalty of the side that rolls over; gradients in the height hold it."""
        if self.penalty is not None:
            return self.penalty
        height = self.specimen.height
        return PenaltyLaw(stiffness=STIFFNESS / height, ramp=RAMP * height)

    def points(self) -> Array:
        """(n_point, 2) reference r, z of the field points on the side, mm."""
        z = (np.arange(self.n_point) + 0.5) * self.specimen.height / 2.0 / self.n_point
        return np.stack([np.full(self.n_point, self.specimen.diameter / 2.0), z], axis=1)

    parameter_names = driven_response.parameter_names
    __call__ = driven_response.respond_to_ratios
    respond = driven_response.respond
    objective_gradients = driven_response.objective_gradients
    solve_for = driven_response.solve_for

    def mesh(self) -> MeshQuad:
        """Half section (r, z), finer towards the rim of the plate."""
        lines = []
        for n, length in zip(self.cells, self._half_size(), strict=True):
            x = np.linspace(0.0, 1.0, n + 1)
            lines.append(length * x * (1.0 + GRADING * (1.0 - x)))
        return MeshQuad.init_tensor(*lines)

    def discretise(self) -> DrivenSpecimen:
        """Tables of the section's mesh, the plate, constraints and field points."""
        mesh = self.mesh()
        table, basis = axisymmetric_elements(mesh)
        top = self._half_size()[1]
        tolerance = 1e-9 * top
        position = table.positions[: basis.N, :2]
        fixed = position < tolerance
        end = position[:, 1] > top - tolerance
        fixed[end, 1] = True
        if self.ends == "bonded":
            fixed[end, 0] = True
        ends = np.flatnonzero(end)
        motion = np.zeros(table.positions.shape)
        motion[ends, 1] = -0.5
        plate = Plate(
            height=top,
            speed=0.5,
            ends=ends,
            edges=self._side(mesh),
            friction=self.friction,
            slip=self.slip,
            law=self.law,
        )
        return DrivenSpecimen(
            problem=DrivenProblem(
                elements=table,
                pattern=unknowns(table.nodes, hoop_equations(fixed), plate.edges.nodes),
                motion=motion,
                plate=plate,
            ),
            points=self.points(),
            probe=field_probe(basis, self.points(), n_hidden=basis.N),
            symmetry=SYMMETRY_FACTOR,
            components=OF_REVOLUTION,
        )

    def shape(self, specimen: Cylinder) -> Shape:
        """What moves with the dimensions, at those of `specimen`."""
        model = replace(self, specimen=specimen)
        mesh = model.mesh()
        nodes = with_hoop(Basis(mesh, ElementQuad2(), intorder=1).doflocs.T)
        return plate_shape(nodes, model.points(), model._side(mesh), specimen.height / 2.0)

    def _side(self, mesh: MeshQuad) -> Edges:
        """The free side, which may touch the plate."""
        radius, top = self._half_size()
        return ring_edges(mesh, mesh.facets_satisfying(lambda x: abs(x[0] - radius) < 1e-9 * top))

    def _half_size(self) -> tuple[float, float]:
        """Radius and half the height, mm."""
        return self.specimen.diameter / 2.0, self.specimen.height / 2.0

    @property
    def schedule(self) -> Schedule:
        """What is asked, and how the solver gets there."""
        return Schedule(self.travel, self.steps, self.newton, self.force)


def _check_penalty(law: PenaltyLaw) -> None:
    """Raise ValueError for a slip that a plate takes no account of."""
    if law.slip != PenaltyLaw().slip:
        raise ValueError(
            f"penalty: a cylinder has its own slip, expected the default of {PenaltyLaw().slip} mm "
            f"here, found {law.slip}"
        )
