"""What part of a block under a pin is modelled, and whether that may stand for the whole."""

from __future__ import annotations

from typing import Literal

from fe.specimens.block_pin_geometry import BlockPin, Contact, Symmetry
from fe.specimens.ring_mesh import Cells, Rings

Asked = Literal["auto"] | Symmetry

ROOM = 0.01
"""of a side of the block, between a face and the axis of a pin along it: elements are to fit"""
SYMMETRY_FACTOR: dict[Symmetry, float] = {"quarter": 4.0, "half": 2.0, "full": 1.0}
"""how many of the modelled parts the whole sample has"""


def modelled_part(specimen: BlockPin, symmetry: Asked) -> Symmetry:
    """The part asked for; "auto" is the smallest that stands for the whole."""
    return specimen.symmetry if symmetry == "auto" else symmetry


def check_part(specimen: BlockPin, contact: Contact, symmetry: Asked) -> None:
    """Raise ValueError for a symmetry that the pin breaks, and for a part that could slide away."""
    if symmetry not in ("auto", *SYMMETRY_FACTOR):
        raise ValueError(
            f"symmetry: expected 'auto', 'quarter', 'half' or 'full', found {symmetry!r}"
        )
    part = modelled_part(specimen, symmetry)
    if SYMMETRY_FACTOR[part] > SYMMETRY_FACTOR[specimen.symmetry]:
        raise ValueError(
            f"symmetry: expected {specimen.symmetry!r} or more of the block for a pin "
            f"shifted by {specimen.pin_shift} mm and turned by "
            f"{specimen.pin_rotation} degrees, found {symmetry!r}"
        )
    friction = contact.friction(1.0)
    held = "stick" in (contact.pin, contact.base) or max(friction[:2]) > 0.0
    if part != "quarter" and not held:
        raise ValueError(
            f"contact: expected a pin or base that sticks or has friction in a {part} "
            f"model, where the block could slide away, found pin={contact.pin}, "
            f"base={contact.base}"
        )


def check_plane_strain(specimen: BlockPin, cells: Cells, part: Symmetry) -> None:
    """Raise ValueError for what is not the same all along z, or more than one element there."""
    straight = specimen.pin == "bar" and not specimen.turned
    one = not isinstance(cells, Rings) and cells[2] == 1
    if not (straight and one and part != "full"):
        raise ValueError(
            f"plane_strain: expected a bar along z, a quarter or half model and one element along "
            f"z, found pin={specimen.pin!r} turned by {specimen.pin_rotation} degrees, a {part} "
            f"model, cells={cells}"
        )


def check_room(specimen: BlockPin) -> None:
    """Raise ValueError where no elements fit between a face and the axis of a pin along it."""
    if specimen.turned:
        return
    sides = specimen.width, specimen.depth
    most = [(0.5 - ROOM) * side for side in sides]
    if any(abs(shift) > largest for shift, largest in zip(specimen.pin_shift, most, strict=True)):
        raise ValueError(
            f"pin_shift: expected at most {most[0]:g} and {most[1]:g} mm, {ROOM:.0%} of the block "
            f"between its faces and the pin's axis, found {specimen.pin_shift} mm"
        )
