"""From where the slip of each contact point is measured, and how that depends on the parameters.

The anchors are the history of friction: at the end of a load step each is drawn behind its point
(return mapping), and carries its derivative along, so that sensitivities of the path-dependent
scheme are exact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fe.contact import FREE, Faces, position
from fe.friction import slip_potential
from fe.pin_surface import RigidPin
from fe.touch import FLOOR, PIN, FrictionLaw, chart_floor, chart_pin, empty_chart, touch

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class SlipAnchors(NamedTuple):
    """From where each point's slip on pin (0) and floor (1) is measured."""

    place: Array
    """(n_face, n_q, 2, 2) on the surface, mm, see `fe.touch`"""
    gradient: Array
    """(n_face, n_q, 2, 2, n_p) d place / d parameter, mm"""
    traction: Array
    """(n_face, n_q, 2, 2) at the end of the last step, MPa"""


def rest(faces: Faces, pin: RigidPin, n_p: int) -> SlipAnchors:
    """Anchors at travel 0 under the points themselves."""
    place = np.zeros((*faces.weights.shape, 2, 2))
    slip = SlipAnchors(place, np.zeros((*place.shape, n_p)), np.zeros_like(place))
    _places(faces, pin, place)
    return slip


@njit(cache=True)
def _places(faces: Faces, pin: RigidPin, place: Array) -> None:
    chart = empty_chart()
    for c in range(faces.weights.shape[0]):
        for q in range(faces.weights.shape[1]):
            chart_pin(faces.points[c, q], 0.0, pin, chart)
            place[c, q, PIN] = chart.place
            chart_floor(faces.points[c, q], chart)
            place[c, q, FLOOR] = chart.place


@njit(cache=True)
def parameter_pull(
    u: Array,
    faces: Faces,
    tied: IntArray,
    slip: SlipAnchors,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    pull: Array,
) -> Array:
    """Derivative of the friction forces in the parameters, at fixed u, by anchors and coefficients.

    Adds the forces of each point (N) to `pull` (n_face, n_q, 3, n_p) and returns that of the
    pin force (n_p,) N.  The last two parameters are the coefficients of pin and base.
    """
    n_p = pull.shape[3]
    on_pin = np.zeros(n_p)
    x = np.empty(3)
    chart = empty_chart()
    for c in range(faces.weights.shape[0]):
        for q in range(faces.weights.shape[1]):
            if tied[c, q] != FREE:
                continue
            position(u, faces, c, q, x)
            surface, limit, _ = touch(x, faces.base[c], faces.floor[c], travel, pin, law, chart)
            if limit <= 0.0:
                continue
            s0 = chart.place[0] - slip.place[c, q, surface, 0]
            s1 = chart.place[1] - slip.place[c, q, surface, 1]
            _, secant, fall = slip_potential(s0, s1, law.slip)
            w = faces.weights[c, q] * limit
            for j in range(n_p):
                a0 = slip.gradient[c, q, surface, 0, j]
                a1 = slip.gradient[c, q, surface, 1, j]
                along = fall * (s0 * a0 + s1 * a1)
                g0 = w * (along * s0 - secant * a0)
                g1 = w * (along * s1 - secant * a1)
                if j == n_p - 2 + surface:
                    coefficient = law.pin if surface == PIN else law.base
                    g0 += w / coefficient * secant * s0
                    g1 += w / coefficient * secant * s1
                for i in range(3):
                    pull[c, q, i, j] += g0 * chart.tangent[0, i] + g1 * chart.tangent[1, i]
                if surface == PIN:
                    on_pin[j] += g0 * chart.tangent[0, 1] + g1 * chart.tangent[1, 1]
    return on_pin


@njit(cache=True)
def advance_anchors(
    u: Array,
    u_gradient: Array,
    faces: Faces,
    tied: IntArray,
    slip: SlipAnchors,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    travel_gradient: Array,
) -> float:
    """Return mapping of all anchors at the end of a step; returns the work of friction, N mm.

    u (n_node, 3), u_gradient (n_node, 3, n_p) and travel_gradient (n_p,) mm; `slip` is changed.
    """
    n_p = u_gradient.shape[2]
    x = np.empty(3)
    dx = np.empty((3, n_p))
    there = np.empty((2, n_p))
    chart = empty_chart()
    work = 0.0
    for c in range(faces.weights.shape[0]):
        for q in range(faces.weights.shape[1]):
            if tied[c, q] != FREE:
                continue
            position(u, faces, c, q, x)
            _position_gradient(u_gradient, faces, c, q, dx)
            touched, pressed, _ = touch(x, faces.base[c], faces.floor[c], travel, pin, law, chart)
            for surface in (PIN, FLOOR):
                if surface == PIN:
                    if faces.base[c]:
                        continue
                    chart_pin(x, travel, pin, chart)
                else:
                    chart_floor(x, chart)
                there[:, :] = 0.0
                for i in range(3):
                    there[0] += chart.slope[0, i] * dx[i]
                    there[1] += chart.slope[1, i] * dx[i]
                if surface == PIN:  # the chart sees x_y + travel
                    there[0] += chart.slope[0, 1] * travel_gradient
                    there[1] += chart.slope[1, 1] * travel_gradient
                limit = pressed if touched == surface else 0.0
                work += faces.weights[c, q] * _return(
                    limit,
                    law.slip,
                    chart.place,
                    there,
                    slip.place[c, q, surface],
                    slip.gradient[c, q, surface],
                    slip.traction[c, q, surface],
                )
    return work


@njit(cache=True)
def _position_gradient(u_gradient: Array, faces: Faces, c: int, q: int, dx: Array) -> None:
    dx[:, :] = 0.0
    for a in range(faces.nodes.shape[1]):
        dx += faces.shape[c, q, a] * u_gradient[faces.nodes[c, a]]


@njit(cache=True)
def _return(
    limit: float,
    slip: float,
    here: Array,
    there: Array,
    place: Array,
    gradient: Array,
    traction: Array,
) -> float:
    """Draw one anchor behind its point; returns the work of friction per area, N/mm."""
    s0, s1 = here[0] - place[0], here[1] - place[1]
    size = np.sqrt(s0 * s0 + s1 * s1)
    _, secant, _ = slip_potential(s0, s1, slip)
    t0, t1 = limit * secant * s0, limit * secant * s1
    work = 0.0
    if limit <= 0.0 or size > slip:
        keep = slip / size if limit > 0.0 else 0.0
        new0, new1 = here[0] - keep * s0, here[1] - keep * s1
        work += 0.5 * (
            (traction[0] + t0) * (new0 - place[0]) + (traction[1] + t1) * (new1 - place[1])
        )
        for j in range(there.shape[1]):
            d0 = there[0, j] - gradient[0, j]
            d1 = there[1, j] - gradient[1, j]
            along = (s0 * d0 + s1 * d1) / (size * size) if limit > 0.0 else 0.0
            gradient[0, j] = there[0, j] - keep * (d0 - along * s0)
            gradient[1, j] = there[1, j] - keep * (d1 - along * s1)
        place[0], place[1] = new0, new1
    traction[0], traction[1] = t0, t1
    return work
