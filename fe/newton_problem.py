"""What fe.newton asks of a potential: the seam between the iteration and what is in equilibrium."""

from __future__ import annotations

from typing import Any, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from fe.discretisation import Pattern
from fe.linear_solver import GeneralMatrix
from fe.potential import Assembly

Array = npt.NDArray[np.float64]

Memory_contra = TypeVar("Memory_contra", contravariant=True)
"""what contact remembers from step to step"""


class Discrete(Protocol):
    """A discretised problem."""

    @property
    def pattern(self) -> Pattern:
        """Pattern of the tangent."""
        ...


class NewtonProblem(Protocol[Memory_contra]):
    """A potential of a displacement (n_node, 3) mm and the travel, mm, with its derivatives."""

    has_friction: bool
    """whether the tangent is not symmetric: then `coupled_tangent` gives it"""
    n_unknowns: int

    @property
    def problem(self) -> Discrete:
        """What the potential is of."""
        ...

    def zero_state(self) -> tuple[Array, Array]:
        """Undeformed displacement (n_node, 3) mm and pressure (n_elem, n_p) MPa."""
        ...

    def energy(self, u: Array, travel: float, memory: Memory_contra, frame: Any = None) -> float:
        """Potential, N mm, with the friction of a frame; inf where some det F <= 0."""
        ...

    def assemble(self, u: Array, p: Array, travel: float, memory: Memory_contra) -> Assembly:
        """Potential, gradient and condensed tangent at (u, p)."""
        ...

    def expand(self, free: Array) -> Array:
        """(n_node, 3[, k]) displacement from its (n_free[, k]) free values, else zero."""
        ...

    def restrict(self, full: Array) -> Array:
        """(n_free,) or (n_free, k) from (n_node, 3[, k]): the transpose of `expand`."""
        ...

    def pressure_step(self, du: Array) -> Array:
        """Pressure increment (n_elem, n_p) MPa that belongs to du (n_node, 3) mm."""
        ...

    def consistent_pressure(self, u: Array) -> Array:
        """Pressure (n_elem, n_p) MPa with no residual in the volume equation at u."""
        ...

    def coupled_tangent(self) -> GeneralMatrix:
        """The whole tangent of the last `assemble` where there is friction, N/mm."""
        ...
