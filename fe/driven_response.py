"""From a specimen moved by a travel to its `Response`: what all specimens without a pin share."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from threadpoolctl import threadpool_limits

from fe import linear_solver
from fe.driven import DrivenProblem
from fe.driving import Solution, solve
from fe.ending import ending
from fe.force_control import Control, check_targets
from fe.materials.material import Material, mooney_rivlin_of_ratios
from fe.materials.mooney_rivlin import RATIO_DERIVATIVES
from fe.newton import NewtonOptions
from fe.progress import Progress, listener
from fe.response import Response
from fe.steps import StepOptions

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class DrivenSpecimen:
    """A meshed part of a specimen, the points where its surface is seen, and its symmetry."""

    problem: DrivenProblem
    points: Array
    """(n_point, 2) reference position of the field points on the surface, mm"""
    probe: sp.csr_matrix
    """(n_point, n_node) nodal values to values at the field points"""
    symmetry: float
    """how many such parts the whole specimen has"""


@dataclass(frozen=True)
class Schedule:
    """At which travels (mm) or forces (N) the response is asked, and how the solver gets there.

    Raises ValueError unless one of the two is given, above 0 and increasing.
    """

    travel: tuple[float, ...]
    steps: StepOptions
    newton: NewtonOptions
    force: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        check_targets(self.travel, self.force)

    @property
    def control(self) -> Control:
        """What is asked."""
        return "force" if self.force else "travel"


def respond(
    specimen: DrivenSpecimen,
    material: Material,
    schedule: Schedule,
    progress: Progress | None = None,
) -> Response:
    """Response with derivatives in every constant and, last, the bulk modulus."""
    names = (*material.law.constant_names, "bulk")
    return _run(specimen, material, schedule, np.eye(len(names)), names, progress)


def respond_to_ratios(
    specimen: DrivenSpecimen, ratios: Array, bulk_ratio: float, schedule: Schedule
) -> Response:
    """Response at kappa = 1 MPa with derivatives in (r, s), bulk modulus 2 `bulk_ratio` MPa.

    Raises ValueError when the ratios do not give a material (two finite numbers).
    """
    ratios = np.asarray(ratios, dtype=np.float64)
    if ratios.shape != (2,) or not np.isfinite(ratios).all():
        raise ValueError(f"ratios: expected two finite numbers (r, s), found {ratios}")
    material = mooney_rivlin_of_ratios(ratios, 1.0, 2.0 * bulk_ratio)
    directions = np.hstack([RATIO_DERIVATIVES, np.zeros((2, 1))])
    return _run(specimen, material, schedule, directions, ("r", "s"))


def _run(
    specimen: DrivenSpecimen,
    material: Material,
    schedule: Schedule,
    directions: Array,
    parameters: tuple[str, ...],
    progress: Progress | None = None,
) -> Response:
    started = time.perf_counter()
    with threadpool_limits(limits=1):
        solution = solve(
            specimen.problem,
            material,
            schedule.travel or tuple(f / specimen.symmetry for f in schedule.force),
            directions=directions,
            steps=schedule.steps,
            newton=schedule.newton,
            control=schedule.control,
            listen=listener(progress, specimen.symmetry),
        )
    seconds = time.perf_counter() - started
    return _response(specimen, solution, schedule, parameters, seconds)


def _response(
    specimen: DrivenSpecimen,
    solution: Solution,
    schedule: Schedule,
    parameters: tuple[str, ...],
    seconds: float,
) -> Response:
    n_step = len(schedule.travel or schedule.force)
    n_point, n_parameter = len(specimen.points), len(parameters)
    by_force = schedule.control == "force"
    travel = np.full(n_step, np.nan) if by_force else np.array(schedule.travel)
    travel_gradient = np.full((n_step, n_parameter), np.nan) if by_force else np.zeros((0, 0))
    force = np.full(n_step, np.nan)
    displacement = np.full((n_step, n_point, 3), np.nan)
    force_gradient = np.full((n_step, n_parameter), np.nan)
    displacement_gradient = np.full((n_step, n_point, 3, n_parameter), np.nan)
    negative = np.full(n_step, -1, dtype=np.int64)
    for i, state in enumerate(solution.states):
        travel[i] = state.travel
        if by_force:
            travel_gradient[i] = state.travel_gradient
        force[i] = specimen.symmetry * state.force
        force_gradient[i] = specimen.symmetry * state.force_gradient
        displacement[i] = specimen.probe @ state.u
        for j in range(n_parameter):
            displacement_gradient[i, :, :, j] = specimen.probe @ state.u_gradient[:, :, j]
        negative[i] = state.negative_pivots
    complete = len(solution.states) == n_step
    end = ending(solution.outcome, schedule.control, specimen.symmetry, complete=complete)
    return Response(
        travel=travel,
        force=force,
        displacement=displacement,
        force_gradient=force_gradient,
        displacement_gradient=displacement_gradient,
        reached=end.reached,
        status=end.status,
        message=end.message,
        negative_pivots=negative,
        n_factorisations=solution.n_factorisations,
        seconds=seconds,
        points=specimen.points,
        parameters=parameters,
        solver=linear_solver.installed_library().name,
        travel_gradient=travel_gradient,
    )
