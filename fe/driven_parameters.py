"""Parameters of a specimen without a pin by name, and how its discrete problem depends on each.

Besides the material's: the dimensions of the specimen, mm; "travel_zero", mm, that plates or clamps
travel before the specimen is moved; and with a plate "friction" and "contact_slip" (a, mm) where it
rubs, "contact_stiffness" (1/mm, relative to the shear modulus) and "contact_ramp" (mm) of its
penalty.  Mesh lines and field points go with the geometry.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fe.differenced import ends
from fe.driven import DrivenProblem
from fe.material_parameters import MaterialParameters
from fe.parameters import TRAVEL_ZERO, Parameters
from fe.plate import Edges, PlateSlopes, no_slopes

Array = npt.NDArray[np.float64]

DIFFERENCE = 1e-5
"""change of a dimension, mm, over which a shape is differenced: most are linear in it"""


class Shape(NamedTuple):
    """What moves with the dimensions of a specimen."""

    nodes: Array
    """(n_node, 3) mm; of hoop nodes the radius as the third, see `fe.plane_elements.with_hoop`"""
    points: Array
    """(n_point, n_dim) field points, mm"""
    edge_points: Array
    """(n_edge, n_q, 2) of the edges that may touch a plate, mm; (0,) without a plate"""
    edge_weights: Array
    """(n_edge, n_q) mm2; (0,) without a plate"""
    plate_height: Array
    """() mm, 0 without a plate"""


def free_shape(nodes: Array, points: Array) -> Shape:
    """Of a specimen without a plate."""
    return Shape(nodes, points, np.zeros(0), np.zeros(0), np.zeros(()))


def plate_shape(nodes: Array, points: Array, edges: Edges, height: float) -> Shape:
    """Of a specimen under a plate."""
    return Shape(nodes, points, edges.points, edges.weights, np.array(height))


def dimensions(specimen: Any) -> tuple[str, ...]:
    """Names of the dimensions of a specimen, a dataclass."""
    return tuple(f.name for f in fields(specimen))


def known_names(problem: DrivenProblem, specimen: Any) -> tuple[str, ...]:
    """Names of all parameters other than the material's."""
    plate = problem.plate
    contact: tuple[str, ...] = ()
    if plate is not None:
        contact = ("contact_stiffness", "contact_ramp")
        if plate.friction > 0.0:
            contact = ("friction", "contact_slip", *contact)
    return (*contact, *dimensions(specimen), TRAVEL_ZERO)


def shape_slope(shape: Callable[[Any], Shape], specimen: Any, name: str) -> Shape:
    """Difference of the shape in one dimension, per mm; to one side of it at its limit."""
    value = getattr(specimen, name)
    high, low, width = ends(lambda by: replace(specimen, **{name: value + by}), DIFFERENCE)
    pairs = zip(shape(high), shape(low), strict=True)
    return Shape(*((a - b) / width for a, b in pairs))


def parameters(
    names: tuple[str, ...],
    material: MaterialParameters,
    problem: DrivenProblem,
    moved: dict[str, Shape],
    shear: float,
) -> Parameters[PlateSlopes | None]:
    """Derivatives of the discrete problem in the named parameters.

    `moved` has the slope of the shape in those of them that are dimensions; `shear` is the modulus
    that the contact stiffness goes with, MPa.
    """
    n_p, plate = len(names), problem.plate
    constants = np.zeros((n_p, material.constants.shape[1]))
    bulk = np.zeros(n_p)
    motion = np.zeros((n_p, *problem.motion.shape))
    for j, name in enumerate(names):
        if name in material.names:
            k = material.names.index(name)
            constants[j], bulk[j] = material.constants[k], material.bulk[k]
        elif name in moved:
            motion[j] = moved[name].nodes
    surface = None
    if plate is not None:
        surface = no_slopes(plate.edges, n_p)
        _fill(surface, names, material, moved, plate.law.stiffness * shear, shear)
    return Parameters(names, constants, bulk, motion, surface)


def _fill(
    surface: PlateSlopes,
    names: tuple[str, ...],
    material: MaterialParameters,
    moved: dict[str, Shape],
    stiffness: float,
    shear: float,
) -> None:
    """Fill the slopes of plate and edges; `stiffness` is the contact's, MPa/mm."""
    direct = {
        "friction": (surface.friction, 1.0),
        "contact_slip": (surface.slip, 1.0),
        "contact_ramp": (surface.ramp, 1.0),
        "contact_stiffness": (surface.stiffness, shear),
    }
    for j, name in enumerate(names):
        if name in direct:
            values, slope = direct[name]
            values[j] = slope
        elif name in material.names:
            surface.stiffness[j] = stiffness * material.stiffness[material.names.index(name)]
        elif name in moved:
            shape = moved[name]
            surface.points[..., j] = shape.edge_points
            surface.weights[..., j] = shape.edge_weights
            surface.height[j] = shape.plate_height
