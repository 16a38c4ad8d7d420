"""Parameters of a block under a pin by name, and how its discrete problem depends on each.

Besides the material's: "friction_pin", "friction_base" where friction is; "contact_stiffness",
"contact_ramp", "contact_base", "contact_slip" of the penalty law; "width", "depth", "height",
"pin_width", "pin_fillet" of the specimen, mm; "pin_shift_x", "pin_shift_z", mm, and "pin_rotation",
degrees, where the modelled part has room for them, the rotation of a bar only;
"travel_zero", mm, by which the pin starts above the block.  Mesh lines and field points go with the
geometry.  Which points a round pin holds from the start does not: its rim runs across elements, and
derivatives in "pin_width" and "pin_fillet" are those with the same points glued.  So it is of a
bar that the mesh does not follow (`fe.specimens.turned_bar`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from skfem import Basis, ElementHex1, Mesh

from fe.differenced import ends
from fe.material_parameters import MaterialParameters
from fe.parameters import TRAVEL_ZERO, Parameters, carry_faces
from fe.plane_elements import with_hoop
from fe.potential import Problem
from fe.specimens.block_pin_geometry import BlockPin, Contact, Symmetry
from fe.specimens.mesh_lines import is_grid
from fe.surface_slopes import SurfaceSlopes, no_slopes

Array = npt.NDArray[np.float64]

SPECIMEN = ("width", "depth", "height", "pin_width", "pin_fillet")
PENALTY = ("contact_stiffness", "contact_ramp", "contact_base", "contact_slip")
DIFFERENCE = 1e-6
"""change of a dimension, mm, over which mesh lines and field points are differenced"""
INWARDS = 1e-9
"""of the way to the middle of the mesh, by which points are moved that are sought in it"""
DIFFERENCE_DEGREES = 1e-4
"""the same of a bar's rotation"""

Geometry = Callable[[BlockPin], Array]


def known_names(specimen: BlockPin, contact: Contact, part: Symmetry) -> tuple[str, ...]:
    """Names of all parameters other than the material's."""
    law = contact.friction(1.0)
    rubs = (("friction_pin", law.pin), ("friction_base", law.base))
    names = [name for name, coefficient in rubs if coefficient > 0.0]
    names += [*PENALTY, *SPECIMEN, TRAVEL_ZERO]
    names += ["pin_shift_x"] if part != "quarter" else []
    names += ["pin_shift_z"] if part == "full" else []
    turns = part == "full" and specimen.pin == "bar"
    return (*names, *(["pin_rotation"] if turns else []))


def parameters(
    names: tuple[str, ...],
    material: MaterialParameters,
    problem: Problem,
    specimen: BlockPin,
    shear: float,
    lines: Callable[[BlockPin], Mesh],
    *,
    ring: bool = False,
    area: Geometry | None = None,
) -> Parameters[SurfaceSlopes]:
    """Derivatives of the discrete problem in the named parameters.

    `shear` is the modulus that the contact stiffness goes with, MPa; `lines` makes the mesh.  A
    `ring` is a section (r, y) of a body of revolution, with hoop nodes.  `area` gives the areas
    (n_face, n_q) of the contact points, mm2, of faces that are no rectangles along the axes.
    """
    n_p, pin = len(names), problem.pin
    nodes = problem.elements.positions
    constants = np.zeros((n_p, material.constants.shape[1]))
    bulk = np.zeros(n_p)
    motion = np.zeros((n_p, *nodes.shape))
    surface = no_slopes(problem.faces, n_p)
    for j, name in enumerate(names):
        if name in material.names:
            k = material.names.index(name)
            constants[j], bulk[j] = material.constants[k], material.bulk[k]
            surface.stiffness[j] = pin.stiffness * material.stiffness[k]
            surface.base_stiffness[j] = pin.base_stiffness * material.stiffness[k]
            continue
        motion[j] = mesh_motion(name, specimen, nodes, lines)
        if name == "contact_stiffness":
            surface.stiffness[j] = shear
        elif name == "contact_base":
            surface.base_stiffness[j] = shear
        elif name in _DIRECT:
            field, slope = _DIRECT[name]
            getattr(surface, field)[j] = slope
    surface = carry_faces(surface, problem.faces, nodes, motion)
    if area is not None:
        for j, name in enumerate(names):
            grown = by_geometry(name, specimen, area)
            if grown is not None:
                surface.weights[..., j] = grown
    if ring:
        for moved in motion:
            moved[:] = with_hoop(moved[: len(moved) // 2, :2])
        faces = problem.faces
        wider = surface.points[..., 0, :] / faces.points[..., 0, None]
        surface = surface._replace(weights=surface.weights + faces.weights[..., None] * wider)
    return Parameters(names, constants, bulk, motion, surface)


_DIRECT = {
    "friction_pin": ("friction_pin", 1.0),
    "friction_base": ("friction_base", 1.0),
    "contact_ramp": ("ramp", 1.0),
    "contact_slip": ("slip", 1.0),
    "height": ("height", 1.0),
    TRAVEL_ZERO: ("height", 1.0),
    "pin_width": ("half_width", 0.5),
    "pin_fillet": ("fillet", 1.0),
    "pin_shift_x": ("x", 1.0),
    "pin_shift_z": ("z", 1.0),
    "pin_rotation": ("angle", np.pi / 180.0),
}
"""what of the surfaces changes by how much per unit"""


def by_geometry(name: str, specimen: BlockPin, of: Geometry) -> Array | None:
    """Difference of an array in one dimension of the specimen, per mm or degree; None in others.

    Central, or to one side of a dimension at its limit.
    """
    if name not in (*SPECIMEN, "pin_shift_x", "pin_shift_z", "pin_rotation"):
        return None

    def changed(by: float) -> BlockPin:
        if name in ("pin_shift_x", "pin_shift_z"):
            x, z = specimen.pin_shift
            moved = (x + by, z) if name == "pin_shift_x" else (x, z + by)
            return replace(specimen, pin_shift=moved)
        return replace(specimen, **{name: getattr(specimen, name) + by})

    high, low, width = ends(changed, DIFFERENCE_DEGREES if name == "pin_rotation" else DIFFERENCE)
    slope: Array = (of(high) - of(low)) / width
    return slope


def mesh_motion(
    name: str, specimen: BlockPin, nodes: Array, lines: Callable[[BlockPin], Mesh]
) -> Array:
    """(n, 3) motion of the material at `nodes` (n, 3) mm with the mesh, per unit."""
    moved = by_geometry(name, specimen, lambda changed: np.asarray(lines(changed).p))
    motion = np.zeros(nodes.shape)
    if moved is None:
        return motion
    mesh = lines(specimen)
    vertices = mesh.p
    if name == "pin_rotation" or not is_grid(vertices):
        middle = vertices.mean(axis=1)
        # a point on a face may be outside by rounding, which older versions of scikit-fem refuse
        within = middle[:, None] + (1.0 - INWARDS) * (nodes.T - middle[:, None])
        return np.asarray(Basis(mesh, ElementHex1(), intorder=1).probes(within) @ moved.T)
    for i in range(len(moved)):
        if moved[i].any():
            planes, first = np.unique(vertices[i], return_index=True)
            motion[:, i] = np.interp(nodes[:, i], planes, moved[i][first])
    return motion
