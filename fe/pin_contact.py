"""How well contact with the pin is resolved: points that touch it, and how deep they are in it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.contact import TIED_TO_PIN, Faces
from fe.face_rows import positions
from fe.pin_surface import RigidPin, pin_point

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

FEW = 4
"""points of the modelled part: with fewer a pin is felt by chance"""
DEEP = 0.05
"""penetration over the height left under the pin, from which the penalty is part of the answer"""


@kernel()
def touching(
    u: Array, faces: Faces, tied: IntArray, travel: float, pin: RigidPin
) -> tuple[int, float]:
    """(points that touch the pin or are tied to it, deepest penetration mm) at u (n_node, 3) mm."""
    n, deepest = 0, 0.0
    for c in range(faces.nodes.shape[0]):
        if faces.base[c]:
            continue
        here = positions(u, faces.nodes[c], faces.shape[c], faces.points[c])
        for q in range(faces.shape.shape[1]):
            gap = pin_point(here[q], travel, pin).gap
            if gap < 0.0 or tied[c, q] == TIED_TO_PIN:
                n += 1
            deepest = max(deepest, -gap)
    return n, deepest


def doubts(
    u: Array, faces: Faces, tied: IntArray, travel: float, pin: RigidPin
) -> list[tuple[str, str]]:
    """What makes contact at a travel, mm, doubtful: (kind, sentence) each."""
    n, deepest = touching(u, faces, tied, travel, pin)
    found = []
    if n < FEW:
        found.append(
            (
                "few points",
                f"only {n} contact points of the mesh touch the pin at a travel of {travel:.4f} mm",
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
