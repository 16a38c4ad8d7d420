"""What the sensitivities of a march are taken in: how a discrete problem depends on parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fe.contact import Faces
from fe.material_parameters import MaterialParameters
from fe.materials.material import Material
from fe.pin_surface import RigidPin
from fe.shape_slopes import Directions, directions
from fe.surface_slopes import SurfaceSlopes, no_slopes

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Parameters:
    """Derivatives of everything in a discrete problem in n_p parameters, per unit of each."""

    names: tuple[str, ...]
    constants: Array
    """(n_p, n_constant) of the material's constants, MPa (exponents: 1)"""
    bulk: Array
    """(n_p,) of the bulk modulus, MPa"""
    motion: Array
    """(n_p, n_node, 3) of the nodes' reference positions, mm"""
    surface: SurfaceSlopes

    @property
    def changing(self) -> IntArray:
        """Those (n_c,) that change the constants."""
        return np.flatnonzero(self.constants.any(axis=1))

    @property
    def moving(self) -> IntArray:
        """Those (n_v,) that move the mesh."""
        return np.flatnonzero(self.motion.any(axis=(1, 2)))

    def directions(self, material: Material) -> Directions:
        """What the element residual is differentiated along, `changing` and `moving` in order."""
        return directions(material, self.constants[self.changing], self.motion[self.moving])


def of_material(
    parameters: MaterialParameters, faces: Faces, pin: RigidPin, n_node: int
) -> Parameters:
    """Parameters of a material alone, with the contact stiffness that goes with it."""
    n_p = len(parameters.names)
    surface = no_slopes(faces, n_p)
    return Parameters(
        names=parameters.names,
        constants=parameters.constants,
        bulk=parameters.bulk,
        motion=np.zeros((n_p, n_node, 3)),
        surface=surface._replace(
            stiffness=pin.stiffness * parameters.stiffness,
            base_stiffness=pin.base_stiffness * parameters.stiffness,
        ),
    )


def carry_faces(surface: SurfaceSlopes, faces: Faces, nodes: Array, motion: Array) -> SurfaceSlopes:
    """The slopes with the contact points taken along by the nodes.

    `nodes` (n_node, 3) mm, `motion` (n_p, n_node, 3) mm per unit.  The faces are rectangles along
    the axes and stay so.
    """
    moved = motion[:, faces.nodes].transpose(1, 2, 3, 0)
    points = np.einsum("cqa,caij->cqij", faces.shape, moved)
    at = nodes[faces.nodes]
    first, last = at.argmin(axis=1), at.argmax(axis=1)
    rows, axes = np.arange(len(at))[:, None], np.arange(3)
    sides = at[rows, last, axes] - at[rows, first, axes]
    growth = moved[rows, last, axes] - moved[rows, first, axes]
    flat = sides < 1e-9 * sides.max(axis=1, keepdims=True)
    stretch = np.where(flat[..., None], 0.0, growth) / np.where(flat, 1.0, sides)[..., None]
    return surface._replace(
        points=points, weights=faces.weights[..., None] * stretch.sum(axis=1)[:, None]
    )
