"""Block and pin as they stand: dimensions, the pin's place, and what happens where they touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from fe.pin_surface import BAR, GRIP, ROUND, RigidPin
from fe.positive_numbers import as_numbers, is_number
from fe.specimens.checks import check_length
from fe.touch import FrictionLaw

Interface = Literal["stick", "slide"] | float
Symmetry = Literal["quarter", "half", "full"]


@dataclass(frozen=True)
class BlockPin:
    """Dimensions of block and pin, mm; a pin wider than the block is a platen.

    A bar runs through the whole depth; a round pin is a cylinder with a vertical axis, `pin_width`
    its diameter.  `pin_shift` moves the pin's axis from the block's centre along x and z, mm;
    `pin_rotation` turns the pin about its vertical axis, degrees.
    """

    width: float = 10.0
    depth: float = 10.0
    height: float = 2.5
    pin_width: float = 4.0
    pin_fillet: float = 0.3
    pin: Literal["bar", "round"] = "bar"
    pin_shift: tuple[float, float] = (0.0, 0.0)
    pin_rotation: float = 0.0

    def __post_init__(self) -> None:
        for name in ("width", "depth", "height", "pin_width", "pin_fillet"):
            check_length(name, getattr(self, name))
        if not self.pin_fillet < self.pin_width / 2.0:
            raise ValueError(
                f"pin_fillet: expected less than half the pin's width {self.pin_width} mm, "
                f"found {self.pin_fillet}"
            )
        if self.pin not in ("bar", "round"):
            raise ValueError(f"pin: expected 'bar' or 'round', found {self.pin!r}")
        shift = as_numbers(self.pin_shift)
        if shift is None or shift.shape != (2,):
            raise ValueError(f"pin_shift: expected two lengths (x, z), found {self.pin_shift}")
        x, z = shift.tolist()
        object.__setattr__(self, "pin_shift", (x, z))  # hashable: meshes are kept by specimen
        if not (abs(x) < self.width / 2.0 and abs(z) < self.depth / 2.0):
            raise ValueError(
                f"pin_shift: expected a pin axis over the block of {self.width} x {self.depth} mm, "
                f"found a shift of {self.pin_shift} mm"
            )
        if not (is_number(self.pin_rotation) and np.isfinite(self.pin_rotation)):
            raise ValueError(f"pin_rotation: expected a finite angle, found {self.pin_rotation!r}")

    @property
    def half_flat(self) -> float:
        """Half the width of the pin's flat, or its radius, mm."""
        return self.pin_width / 2.0 - self.pin_fillet

    @property
    def turned(self) -> bool:
        """Whether the pin's rotation can be seen."""
        return self.pin == "bar" and self.pin_rotation % 180.0 != 0.0

    @property
    def symmetry(self) -> Symmetry:
        """The smallest part of block and pin that stands for the whole."""
        x, z = self.pin_shift
        if self.turned or (self.pin == "round" and z != 0.0):
            return "full"
        return "quarter" if x == 0.0 else "half"

    def rigid_pin(
        self, stiffness: float, ramp: float, base_stiffness: float, grip: float = GRIP
    ) -> RigidPin:
        """The pin as the kernels take it; stiffness in MPa/mm, ramp and grip in mm."""
        angle = np.radians(self.pin_rotation) if self.turned else 0.0
        return RigidPin(
            height=self.height,
            half_width=self.pin_width / 2.0,
            fillet=self.pin_fillet,
            stiffness=stiffness,
            ramp=ramp,
            base_stiffness=base_stiffness,
            shape=ROUND if self.pin == "round" else BAR,
            x=self.pin_shift[0],
            z=self.pin_shift[1],
            across_x=float(np.cos(angle)),
            across_z=-float(np.sin(angle)),
            grip=grip,
        )


@dataclass(frozen=True)
class Contact:
    """What the block's surface does where it touches pin and base.

    It sticks ("stick"), slides without friction ("slide" or 0), or slides with a coefficient of
    Coulomb friction (a number above 0).  Sliding or not, the base does not lift.
    """

    pin: Interface = "stick"
    base: Interface = "stick"

    def __post_init__(self) -> None:
        for name in ("pin", "base"):
            value = getattr(self, name)
            named = isinstance(value, str) and value in ("stick", "slide")
            if not named and not (is_number(value) and 0.0 <= value < np.inf):
                raise ValueError(
                    f"{name}: expected 'stick', 'slide' or a coefficient of friction of 0 or more, "
                    f"found {value!r}"
                )

    def friction(self, slip: float) -> FrictionLaw:
        """Coefficients of friction, 0 also where the block sticks; `slip` in mm."""
        pin, base = (0.0 if isinstance(c, str) else float(c) for c in (self.pin, self.base))
        return FrictionLaw(pin, base, slip)
