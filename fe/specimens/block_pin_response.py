"""The response of a block under a pin from the states of its modelled part."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from fe.load_stepping import March, TravelState
from fe.response import Response, Status
from fe.specimens.block_pin_field import FieldMotion

Array = npt.NDArray[np.float64]


class Seen(NamedTuple):
    """What is looked at."""

    travel: Array
    """(n_step,) asked, mm"""
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
    n_step, n_point, n_p = seen.travel.size, len(seen.points), len(names)
    force = np.full(n_step, np.nan)
    displacement = np.full((n_step, n_point, 3), np.nan)
    force_gradient = np.full((n_step, n_p), np.nan)
    displacement_gradient = np.full((n_step, n_point, 3, n_p), np.nan)
    negative = np.full(n_step, -1, dtype=np.int64)
    for i, state in enumerate(states):
        force[i] = seen.factor * state.pin_force
        force_gradient[i] = seen.factor * state.force_gradient
        displacement[i] = seen.probe @ state.u
        along = seen.probe @ state.u_gradient.reshape(len(state.u), 3 * n_p)
        displacement_gradient[i] = along.reshape(n_point, 3, n_p) + seen.motion.seen(state.u)
        negative[i] = state.negative_pivots
    complete = len(states) == n_step
    return Response(
        travel=seen.travel,
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
        points=seen.points,
        parameters=names,
    )
