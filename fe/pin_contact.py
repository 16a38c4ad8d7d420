"""How well contact with the pin is resolved: points that touch it, and how deep they are in it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.contact import TIED_TO_PIN, Faces, penalty
from fe.face_rows import positions
from fe.pin_surface import RigidPin, pin_point

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

FEW = 4
"""points of the modelled part: with fewer a pin is felt by chance"""
DEEP = 0.05
"""penetration over the height left under the pin, from which the penalty is part of the answer"""
COMPLIANCE = "compliance"
"""kind of the doubt that grows with the travel"""
COMPLIANT = 0.05
"""share of its force that a rigid pin would need beyond, from which that is said"""


class Touching(NamedTuple):
    """Contact with the pin of the modelled part."""

    n: int
    """points that touch it or are tied to it"""
    deepest: float
    """penetration, mm"""
    mean: float
    """penetration weighted by the penalty's force at each point, mm; of points tied to the pin by
    what they would feel if free"""


@kernel()
def _touching(
    u: Array, faces: Faces, tied: IntArray, travel: float, pin: RigidPin
) -> tuple[int, float, float]:
    n, deepest, weighted, total = 0, 0.0, 0.0, 0.0
    for c in range(faces.nodes.shape[0]):
        if faces.base[c]:
            continue
        here = positions(u, faces.nodes[c], faces.shape[c], faces.points[c])
        for q in range(faces.shape.shape[1]):
            gap = pin_point(here[q], travel, pin).gap
            if gap < 0.0 or tied[c, q] == TIED_TO_PIN:
                n += 1
            deepest = max(deepest, -gap)
            pressed = -faces.weights[c, q] * penalty(gap, pin.stiffness, pin.ramp)[1]
            weighted += pressed * max(-gap, 0.0)
            total += pressed
    return n, deepest, weighted / total if total > 0.0 else 0.0


def touching(u: Array, faces: Faces, tied: IntArray, travel: float, pin: RigidPin) -> Touching:
    """Contact with the pin at u (n_node, 3) mm and its travel, mm."""
    return Touching(*_touching(u, faces, tied, travel, pin))


def doubts(
    u: Array,
    faces: Faces,
    tied: IntArray,
    travel: float,
    pin: RigidPin,
    growth: float = 0.0,
) -> list[tuple[str, str]]:
    """What makes contact at a travel, mm, doubtful: (kind, sentence) each.

    `growth` is that of the force by the travel, over the force, 1/mm. A rigid pin would be where
    the surface is, on the whole: the share that it would need beyond the force is the growth times
    the mean penetration (to first order in the compliance, by the derivative of the potential).
    """
    n, deepest, mean = touching(u, faces, tied, travel, pin)
    found = []
    if n < FEW:
        found.append(
            (
                "few points",
                f"only {n} contact points of the mesh touch the pin at a travel of {travel:.4f} mm",
            )
        )
    if mean * growth > COMPLIANT:
        found.append(
            (
                COMPLIANCE,
                f"the contact gives way by {1e3 * mean:.3g} um at a travel of {travel:.4f} mm: "
                f"a rigid pin would need some {100.0 * mean * growth:.0f} % more force "
                "(see PenaltyLaw.stiffened)",
            )
        )
    left = pin.height - travel
    if deepest > DEEP * left:
        found.append(penetration_doubt(deepest, "pin", travel, left))
    return found


def penetration_doubt(deepest: float, body: str, travel: float, left: float) -> tuple[str, str]:
    """Kind and sentence of a surface that is `deepest` mm in a body, with `left` mm of height."""
    return (
        "penetration",
        f"the surface is {deepest:.3g} mm inside the {body} at a travel of {travel:.4f} mm, "
        f"with {left:.3g} mm of height left: the contact's stiffness is part of the force",
    )
