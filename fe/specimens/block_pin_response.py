"""The response of a block under a pin from the states of its modelled part."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from fe.ending import ending
from fe.force_control import Control
from fe.linear_solver import installed_library
from fe.load_stepping import TravelState
from fe.response import Response
from fe.specimens.block_pin_field import FieldMotion
from fe.steps import March

Array = npt.NDArray[np.float64]


class Seen(NamedTuple):
    """What is looked at."""

    targets: Array
    """(n_step,) travels, mm, or forces of the whole sample, N, that were asked"""
    control: Control
    """which of the two"""
    points: Array
    """(n_point, 2) mm"""
    probe: sp.csr_matrix
    """(n_point, n_node) nodal values to values at the points"""
    motion: FieldMotion
    factor: float
    """how many of the modelled parts the whole sample has"""


def response(
    states: list[TravelState],
    outcome: March,
    seen: Seen,
    names: tuple[str, ...],
    n_factorisations: int,
    seconds: float,
) -> Response:
    """Forces of the whole sample and the field at the points, with gradients in the names."""
    n_step, n_point, n_p = seen.targets.size, len(seen.points), len(names)
    by_force = seen.control == "force"
    travel = np.full(n_step, np.nan) if by_force else seen.targets.copy()
    travel_gradient = np.full((n_step, n_p), np.nan) if by_force else np.zeros((0, 0))
    force = np.full(n_step, np.nan)
    displacement = np.full((n_step, n_point, 3), np.nan)
    force_gradient = np.full((n_step, n_p), np.nan)
    displacement_gradient = np.full((n_step, n_point, 3, n_p), np.nan)
    negative = np.full(n_step, -1, dtype=np.int64)
    for i, state in enumerate(states):
        travel[i] = state.travel
        if by_force:
            travel_gradient[i] = state.travel_gradient
        force[i] = seen.factor * state.pin_force
        force_gradient[i] = seen.factor * state.force_gradient
        displacement[i] = seen.probe @ state.u
        along = seen.probe @ state.u_gradient.reshape(len(state.u), 3 * n_p)
        displacement_gradient[i] = along.reshape(n_point, 3, n_p) + seen.motion.seen(state.u)
        negative[i] = state.negative_pivots
    end = ending(outcome, seen.control, seen.factor, complete=len(states) == n_step)
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
        n_factorisations=n_factorisations,
        seconds=seconds,
        points=seen.points,
        parameters=names,
        solver=installed_library().name,
        travel_gradient=travel_gradient,
    )
