"""What the sensitivities of a march are taken in: how a discrete problem depends on parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from fe.contact import Faces
from fe.directions import Directions, directions
from fe.materials.material import Material
from fe.surface_slopes import SurfaceSlopes
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

TRAVEL_ZERO = "travel_zero"
"""name of the travel, mm, that pin, plates or clamps make before the body is moved"""

Surface = TypeVar("Surface")
"""how what touches the body depends on the parameters"""


def keep_asked(model: Any) -> None:
    """Make a frozen model's `sensitivities` a tuple; raise ValueError unless different names.

    None is left.
    """
    sensitivities = model.sensitivities
    if sensitivities is None:
        return
    if not isinstance(sensitivities, (tuple, list)) or not all(
        isinstance(name, str) for name in sensitivities
    ):
        raise ValueError(f"sensitivities: expected a tuple of names, found {sensitivities!r}")
    if len(set(sensitivities)) < len(sensitivities):
        raise ValueError(f"sensitivities: expected each name once, found {sensitivities}")
    object.__setattr__(model, "sensitivities", tuple(sensitivities))


def check_names(names: tuple[str, ...], known: tuple[str, ...]) -> None:
    """Raise ValueError for a name that is not known."""
    for name in names:
        if name not in known:
            raise ValueError(
                f"sensitivities: expected names among {', '.join(known)}, found {name!r}"
            )


@dataclass(frozen=True)
class Parameters(Generic[Surface]):
    """Derivatives of everything in a discrete problem in n_p parameters, per unit of each."""

    names: tuple[str, ...]
    constants: Array
    """(n_p, n_constant) of the material's constants, MPa (exponents: 1)"""
    bulk: Array
    """(n_p,) of the bulk modulus, MPa"""
    motion: Array
    """(n_p, n_node, 3) of the nodes' reference positions, mm"""
    surface: Surface

    @property
    def zeroes(self) -> npt.NDArray[np.bool_]:
        """(n_p,) which of them is the zero of the travel."""
        return np.array([name == TRAVEL_ZERO for name in self.names], dtype=bool)

    @cached_property
    def changing(self) -> IntArray:
        """Those (n_c,) that change the constants."""
        return np.flatnonzero(self.constants.any(axis=1))

    @cached_property
    def moving(self) -> IntArray:
        """Those (n_v,) that move the mesh."""
        return np.flatnonzero(self.motion.any(axis=(1, 2)))

    def directions(self, material: Material, elements: Elements) -> Directions:
        """What the element residual is differentiated along, `changing` and `moving` in order."""
        motion = self.motion[self.moving]
        return directions(material, elements, self.constants[self.changing], motion)

    def add_inner(self, total: Array, inner: Array) -> None:
        """Add to `total` (n, n_p) the derivatives along `directions`, bulk between the two.

        `inner` (n, n_c + 1 + n_v).
        """
        total += inner @ self._shares

    @cached_property
    def _shares(self) -> Array:
        """(n_c + 1 + n_v, n_p) of each direction in each parameter."""
        each = np.eye(len(self.names))
        return np.vstack([each[self.changing], self.bulk, each[self.moving]])


def at_rest(parameters: Parameters[SurfaceSlopes]) -> SurfaceSlopes:
    """The surfaces at travel 0, where the pin stands on the block wherever its travel begins.

    So a zero of the travel that is off shifts all travels, and nothing else.
    """
    surface = parameters.surface
    return surface._replace(height=np.where(parameters.zeroes, 0.0, surface.height))


def carry_faces(surface: SurfaceSlopes, faces: Faces, nodes: Array, motion: Array) -> SurfaceSlopes:
    """The slopes with the contact points taken along by the nodes.

    `nodes` (n_node, 3) mm, `motion` (n_p, n_node, 3) mm per unit.  The faces are rectangles along
    the axes and stay so.
    """
    moved = motion[:, faces.nodes].transpose(1, 2, 3, 0)
    points = np.ascontiguousarray(np.einsum("cqa,caij->cqij", faces.shape, moved))
    at = nodes[faces.nodes]
    first, last = at.argmin(axis=1), at.argmax(axis=1)
    rows, axes = np.arange(len(at))[:, None], np.arange(3)
    sides = at[rows, last, axes] - at[rows, first, axes]
    growth = moved[rows, last, axes] - moved[rows, first, axes]
    flat = sides < 1e-9 * sides.max(axis=1, keepdims=True)
    stretch = np.where(flat[..., None], 0.0, growth) / np.where(flat, 1.0, sides)[..., None]
    weights = np.ascontiguousarray(faces.weights[..., None] * stretch.sum(axis=1)[:, None])
    return surface._replace(points=points, weights=weights)
