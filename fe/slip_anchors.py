"""From where the slip of each contact point is measured, and how that depends on the parameters.

The anchors are the history of friction: at the end of a load step each is drawn behind its point
(return mapping), and carries its derivative along, so that sensitivities of the path-dependent
scheme are exact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.contact import FREE, Faces
from fe.face_rows import motions, positions
from fe.friction import slip_potential
from fe.pin_surface import ROUND, RigidPin
from fe.surface_slopes import SurfaceSlopes, relative_motion, seen_from
from fe.touch import FLOOR, PIN, Chart, FrictionLaw, chart_floor, chart_pin, empty_chart, touch

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


def rest(faces: Faces, pin: RigidPin, slopes: SurfaceSlopes) -> SlipAnchors:
    """Anchors at travel 0 under the points themselves."""
    place = np.zeros((*faces.weights.shape, 2, 2))
    slip = SlipAnchors(place, np.zeros((*place.shape, slopes.height.size)), np.zeros_like(place))
    _places(faces, pin, slopes, slip)
    return slip


@kernel()
def _places(faces: Faces, pin: RigidPin, slopes: SurfaceSlopes, slip: SlipAnchors) -> None:
    chart = empty_chart()
    seen, there = np.empty(slopes.points.shape[2:]), np.empty((2, slopes.points.shape[3]))
    for c in range(faces.weights.shape[0]):
        for q in range(faces.weights.shape[1]):
            x, motion = faces.points[c, q], slopes.points[c, q]
            for surface in (PIN, FLOOR):
                if surface == PIN:
                    chart_pin(x, 0.0, pin, chart)
                    relative_motion(x, motion, pin, slopes, seen)
                else:
                    chart_floor(x, chart)
                    seen[:, :] = motion
                slip.place[c, q, surface] = chart.place
                place_slopes(x, seen, chart, surface, pin, slopes, there)
                slip.gradient[c, q, surface] = there


@kernel(inline="always")
def place_slopes(
    x: Array,
    seen: Array,
    chart: Chart,
    surface: int,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    there: Array,
) -> None:
    """Fill `there` (2, n_p) with the derivative of the place of the point x (3,) mm, mm.

    `seen` (3, n_p) mm is the motion of the point as the surface sees it.  What is left is that
    the arc length starts further out on a wider flat, and grows with the radius of the fillet.
    """
    n_p = seen.shape[1]
    s0, s1 = chart.slope[0], chart.slope[1]
    for j in range(n_p):
        there[0, j] = s0[0] * seen[0, j] + s0[1] * seen[1, j] + s0[2] * seen[2, j]
        there[1, j] = s1[0] * seen[0, j] + s1[1] * seen[1, j] + s1[2] * seen[2, j]
    if surface != PIN:
        return
    e0, e1, turned = arc_growth(x, chart, pin)
    for j in range(n_p):
        longer = slopes.half_width[j] + turned * slopes.fillet[j]
        there[0, j] += longer * e0
        there[1, j] += longer * e1


@kernel()
def arc_growth(x: Array, chart: Chart, pin: RigidPin) -> tuple[float, float, float]:
    """Where on the pin the place of x (3,) mm goes as half the width grows, and its share.

    (its two numbers, how many times as far it goes as the fillet grows).
    """
    n = np.sqrt(chart.normal[0] ** 2 + chart.normal[2] ** 2)
    turned = np.arctan2(n, -chart.normal[1]) - 1.0
    ex, ez, side = seen_from(x, pin)
    if pin.shape != ROUND:
        ex, ez = side, 0.0
    return ex, ez, turned


@kernel()
def advance_anchors(
    u: Array,
    u_gradient: Array,
    faces: Faces,
    tied: IntArray,
    slip: SlipAnchors,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    slopes: SurfaceSlopes,
) -> float:
    """Return mapping of all anchors at the end of a step; returns the work of friction, N mm.

    u (n_node, 3) and its derivative (n_node, 3, n_p) in mm; `slip` is changed, on the surfaces
    that a point's face can rub on.
    """
    n_p = u_gradient.shape[2]
    seen, there = np.empty((3, n_p)), np.empty((2, n_p))
    chart = empty_chart()
    work = 0.0
    for c in range(faces.weights.shape[0]):
        rubs = (
            law.pin > 0.0 and not faces.base[c],
            law.base > 0.0 and (faces.base[c] or faces.floor[c]),
        )
        if not (rubs[PIN] or rubs[FLOOR]):
            continue
        nodes, shape = faces.nodes[c], faces.shape[c]
        places = positions(u, nodes, shape, faces.points[c])
        moved = motions(u_gradient, nodes, shape, slopes.points[c])
        for q in range(faces.weights.shape[1]):
            if tied[c, q] != FREE:
                continue
            x, motion = places[q], moved[q]
            touched, pressed, _ = touch(x, faces.base[c], faces.floor[c], travel, pin, law, chart)
            for surface in (PIN, FLOOR):
                if not rubs[surface]:
                    continue
                if surface == PIN:
                    chart_pin(x, travel, pin, chart)
                    relative_motion(x, motion, pin, slopes, seen)
                else:
                    chart_floor(x, chart)
                    seen[:, :] = motion
                place_slopes(x, seen, chart, surface, pin, slopes, there)
                limit = pressed if touched == surface else 0.0
                work += faces.weights[c, q] * _return(
                    limit,
                    law.slip,
                    slopes.slip,
                    chart.place,
                    there,
                    slip.place[c, q, surface],
                    slip.gradient[c, q, surface],
                    slip.traction[c, q, surface],
                )
    return work


@kernel(inline="always")
def _return(
    limit: float,
    slip: float,
    slip_slope: Array,
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
            longer = slip_slope[j] / size if limit > 0.0 else 0.0
            gradient[0, j] = there[0, j] - keep * (d0 - along * s0) - longer * s0
            gradient[1, j] = there[1, j] - keep * (d1 - along * s1) - longer * s1
        place[0], place[1] = new0, new1
    traction[0], traction[1] = t0, t1
    return work
