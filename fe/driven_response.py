"""From a specimen moved by a travel to its `Response`: what all specimens without a pin share."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from threadpoolctl import threadpool_limits

from fe import seen
from fe.driven import DrivenProblem
from fe.driven_parameters import Shape, dimensions, known_names, parameters, shape_slope
from fe.driving import Solution, solve
from fe.field_motion import FieldProbe, passing
from fe.force_control import Control
from fe.material_parameters import MaterialParameters, all_parameters, ratio_parameters
from fe.materials.material import Material, mooney_rivlin_of_ratios
from fe.newton import NewtonOptions
from fe.parameters import Parameters, check_names
from fe.plate import PlateSlopes
from fe.progress import Progress, listener
from fe.response import XYZ, Response
from fe.seen import FieldObjective, Seen
from fe.sensitivity import Objective
from fe.steps import StepOptions
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class DrivenSpecimen:
    """A meshed part of a specimen, the points where its surface is seen, and its symmetry."""

    problem: DrivenProblem
    points: Array
    """(n_point, 2) reference position of the field points on the surface, mm"""
    probe: FieldProbe
    """what the field points see of nodal values"""
    symmetry: float
    """how many such parts the whole specimen has"""
    components: tuple[str, str, str] = XYZ
    """of the displacement that is seen"""

    @property
    def elements(self) -> Elements:
        """Tables of the mesh."""
        return self.problem.elements


@dataclass(frozen=True)
class Schedule:
    """At which travels (mm) or forces (N) the response is asked, and how the solver gets there."""

    travel: tuple[float, ...]
    steps: StepOptions
    newton: NewtonOptions
    force: tuple[float, ...] = ()

    @property
    def control(self) -> Control:
        """What is asked."""
        return "force" if self.force else "travel"


class DrivenModel(Protocol):
    """A specimen of some dimensions with how it is meshed, moved and seen."""

    @property
    def specimen(self) -> Any:
        """Its dimensions, a dataclass of lengths, mm."""
        ...

    @property
    def bulk_ratio(self) -> float:
        """Bulk modulus over mu = 2 kappa where ratios are asked."""
        ...

    @property
    def sensitivities(self) -> tuple[str, ...] | None:
        """Parameters of the gradients; None are those that the response is a function of."""
        ...

    @property
    def schedule(self) -> Schedule:
        """What is asked."""
        ...

    def discretise(self) -> DrivenSpecimen:
        """Tables of the mesh, constraints and field points."""
        ...

    def shape(self, specimen: Any) -> Shape:
        """What moves with the dimensions, at those of `specimen`."""
        ...


class _Run(NamedTuple):
    """A discretised specimen of one material and what is asked of it."""

    discrete: DrivenSpecimen
    schedule: Schedule
    material: Material
    along: Parameters[PlateSlopes | None]
    seen: Seen


def parameter_names(model: DrivenModel, material: Material | None = None) -> tuple[str, ...]:
    """Names that `sensitivities` may have: of ratios, or of a material if one is given."""
    own = ("r", "s", "bulk_ratio") if material is None else all_parameters(material).names
    return (*own, *known_names(model.discretise().problem, model.specimen))


def respond(model: DrivenModel, material: Material, progress: Progress | None = None) -> Response:
    """Response of any material, by default with gradients in its constants and bulk modulus.

    `progress` is called after each step of the solver.  Raises ValueError for sensitivities that
    there are not, and when the material is incompressible (infinite bulk modulus).
    """
    return _respond(lambda: _of(model, material), progress)


def respond_to_ratios(model: DrivenModel, ratios: Array) -> Response:
    """Response at kappa = 1 MPa for ratios (r, s), by default with gradients in these.

    Raises ValueError when the ratios do not give a material (two finite numbers), and for
    sensitivities that there are not.
    """
    material = mooney_rivlin_of_ratios(ratios, 1.0, 2.0 * model.bulk_ratio)
    known = ratio_parameters(material)
    return _respond(lambda: _run(model, material, known, ("r", "s")), None)


def objective_gradients(model: DrivenModel, material: Material, objective: FieldObjective) -> Array:
    """(n_step, n_p) derivatives of a scalar of each travel's response, by the adjoint.

    As of `fe.BlockPinModel.objective_gradients`.
    """
    run = _of(model, material)

    def states(of_state: Objective) -> Any:
        return _solve(run, None, of_state).states

    return seen.objective_gradients(states, run.seen, objective)


def solve_for(model: DrivenModel, material: Material, progress: Progress | None = None) -> Solution:
    """States of the modelled part at the targets reached, outcome, factorisations."""
    return _solve(_of(model, material), progress)


def _of(model: DrivenModel, material: Material) -> _Run:
    known = all_parameters(material)
    return _run(model, material, known, known.names)


def _run(
    model: DrivenModel, material: Material, known: MaterialParameters, default: tuple[str, ...]
) -> _Run:
    names = default if model.sensitivities is None else model.sensitivities
    discrete, schedule, specimen = model.discretise(), model.schedule, model.specimen
    check_names(names, (*known.names, *known_names(discrete.problem, specimen)))
    lengths = dimensions(specimen)
    moved = {name: shape_slope(model.shape, specimen, name) for name in names if name in lengths}
    at = model.shape(specimen).points
    passed = np.zeros((*at.shape, len(names)))
    for name, slope in moved.items():
        by_mesh = discrete.probe.values @ slope.nodes
        passed[..., names.index(name)] = slope.points - by_mesh[:, : at.shape[1]]
    return _Run(
        discrete=discrete,
        schedule=schedule,
        material=material,
        along=parameters(names, known, discrete.problem, moved, material.shear_modulus),
        seen=Seen(
            targets=np.asarray(schedule.travel or schedule.force),
            control=schedule.control,
            points=discrete.points,
            probe=discrete.probe.values,
            motion=passing(passed, discrete.probe),
            factor=discrete.symmetry,
            names=names,
            components=discrete.components,
        ),
    )


def _solve(run: _Run, progress: Progress | None, objective: Objective | None = None) -> Solution:
    schedule, symmetry = run.schedule, run.discrete.symmetry
    with threadpool_limits(limits=1):
        return solve(
            run.discrete.problem,
            run.material,
            schedule.travel or tuple(f / symmetry for f in schedule.force),
            parameters=run.along,
            steps=schedule.steps,
            newton=schedule.newton,
            control=schedule.control,
            objective=objective,
            listen=listener(progress, symmetry),
        )


def _respond(make: Callable[[], _Run], progress: Progress | None) -> Response:
    started = time.perf_counter()
    run = make()
    states, outcome, n_factorisations = _solve(run, progress)
    seconds = time.perf_counter() - started
    return seen.response(states, outcome, run.seen, n_factorisations, seconds)
