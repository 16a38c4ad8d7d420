"""What block and disc have in common: the discrete problem under a pin, and what is asked of it."""

from __future__ import annotations

from typing import Protocol

from fe.contact import PenaltyLaw
from fe.force_control import Control
from fe.materials.material import Material
from fe.newton import NewtonOptions
from fe.potential import Problem
from fe.pressing import Pressed
from fe.specimens.block_pin_geometry import BlockPin, Contact
from fe.specimens.block_pin_mesh import Discretisation
from fe.steps import StepOptions
from fe.ties import Stick


class UnderPin(Protocol):
    """A model of a specimen under a pin."""

    @property
    def contact(self) -> Contact:
        """What happens where it touches."""
        ...

    @property
    def penalty(self) -> PenaltyLaw:
        """Of contact, relative to the shear modulus."""
        ...

    @property
    def travel(self) -> tuple[float, ...]:
        """Asked, mm."""
        ...

    @property
    def force(self) -> tuple[float, ...]:
        """Asked of the whole sample, N."""
        ...

    @property
    def control(self) -> Control:
        """Which of the two."""
        ...

    @property
    def steps(self) -> StepOptions:
        """Of the march."""
        ...

    @property
    def newton(self) -> NewtonOptions:
        """Of each equilibrium."""
        ...


def problem_of(
    model: UnderPin, block: BlockPin, discrete: Discretisation, material: Material, shear: float
) -> Problem:
    """The discrete problem with contact as stiff as for the shear modulus `shear`, MPa."""
    law = model.penalty
    return Problem(
        elements=discrete.elements,
        faces=discrete.faces,
        pattern=discrete.pattern,
        pin=block.rigid_pin(law.stiffness * shear, law.ramp, law.base * shear, law.grip),
        material=material,
        friction=model.contact.friction(law.slip),
    )


def pressed_of(
    model: UnderPin, problem: Problem, discrete: Discretisation, factor: float
) -> Pressed:
    """What is pressed and how; the whole sample is `factor` times the modelled part."""
    return Pressed(
        problem=problem,
        glued=discrete.glued,
        stick=Stick(model.contact.pin == "stick", model.contact.base == "stick"),
        targets=model.travel or tuple(f / factor for f in model.force),
        control=model.control,
        steps=model.steps,
        newton=model.newton,
    )
