"""Sensitivities: order of the Taylor remainder, direct against adjoint, cost.

The remainder |q(theta + h) - q - h dq| of forces and field falls as h^2 in every parameter of the
material, the contact and the geometry; the gradient of a misfit by the adjoint is that of the
direct derivatives; and all of them together cost a small part of the solve.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.sensitivity_cost import cost_percent
from fe import BlockPin, BlockPinModel, Contact
from fe.materials import Material, material
from fe.newton import NewtonOptions
from fe.steps import StepOptions

Array = npt.NDArray[np.float64]

CELLS = (5, 2, 1)
TRAVEL = (0.1, 0.2, 0.3)
CONTACTS: dict[str, Contact] = {
    "stick": Contact("stick", "stick"),
    "slide": Contact("slide", "slide"),
    "friction": Contact(0.3, 0.2),
}
STEPS = 4e-3 * 0.5 ** np.arange(4)
"""relative to the size of the parameter"""
FINE = 1.0 / 64.0
"""of these steps, dimensions change by: over more, rows of contact points pass mesh lines and the
corners of the fillet, where second derivatives jump; constants change little over so little"""
PENALTY = {"contact_stiffness": "stiffness", "contact_ramp": "ramp", "contact_slip": "slip"}
LAW = (0.5, 0.4, 0.1, 400.0)
"""C10, C01, C11, bulk modulus, MPa"""


TURNED = BlockPin(pin_shift=(0.3, 0.2), pin_rotation=10.0)
"""lengths in mm, angle in degrees"""
TURNED_CELLS = (4, 2, 3)
"""elements of the whole block"""
PLACE = ("pin_shift_x", "pin_shift_z", "pin_rotation")
"""parameters that only a pin out of place has"""


def rubber(numbers: tuple[float, ...] = LAW) -> Material:
    """Mooney-Rivlin with three constants and, last, the bulk modulus, MPa."""
    return material("mooney-rivlin-3", numbers[:-1], numbers[-1])


def model(contact: Contact, cells: tuple[int, int, int] = CELLS) -> BlockPinModel:
    """A small block in three steps; what is left to solve is below the smallest remainder.

    However many iterations a step takes, it is not cut: where friction is, other steps are another
    path.
    """
    return BlockPinModel(
        BlockPin(),
        contact,
        cells,
        TRAVEL,
        field_grid=(6, 4),
        newton=replace(NewtonOptions(), tolerance=1e-11, inexact=1e-6, max_iterations=400),
        steps=StepOptions(first=0.18, largest=0.18),
    )


def turned(contact: Contact) -> BlockPinModel:
    """The whole of a small block under a bar that is shifted and turned; its base holds it."""
    if contact == CONTACTS["slide"]:
        contact = Contact("slide", "stick")
    return replace(model(contact, TURNED_CELLS), specimen=TURNED, travel=TRAVEL[:2])


def names(block: BlockPinModel) -> tuple[str, ...]:
    """All parameters but the stiffness of the base's spring, which only serves to read pressure,
    and the slip where nothing rubs."""
    rubs = any(name.startswith("friction") for name in block.parameter_names())
    idle = {"contact_base"} | (set() if rubs else {"contact_slip"})
    return tuple(name for name in block.parameter_names(rubber()) if name not in idle)


def size(block: BlockPinModel, name: str) -> float:
    """What a change of the parameter is relative to, in its unit."""
    known = dict(zip(("C10", "C01", "C11", "bulk"), LAW, strict=True))
    if name in known:
        return known[name]
    if name in PENALTY:
        return float(getattr(block.penalty, PENALTY[name]))
    if name.startswith("friction"):
        return float(getattr(block.contact, name.removeprefix("friction_")))
    lengths = {"travel_zero": 0.1, "pin_shift_x": 0.3, "pin_shift_z": 0.3}
    return lengths.get(name) or float(getattr(block.specimen, name))


def moved(block: BlockPinModel, name: str, h: float) -> tuple[BlockPinModel, Material]:
    """Block and material with one parameter changed by h."""
    block = replace(block, sensitivities=())
    known = ("C10", "C01", "C11", "bulk")
    if name in known:
        change = h * np.eye(4)[known.index(name)]
        return block, rubber(tuple((np.array(LAW) + change).tolist()))
    if name == "travel_zero":
        block = replace(block, travel=tuple(t - h for t in block.travel))
    elif name in PENALTY:
        value = getattr(block.penalty, PENALTY[name]) + h
        block = replace(block, penalty=replace(block.penalty, **{PENALTY[name]: value}))
    elif name.startswith("friction"):
        side = name.removeprefix("friction_")
        value = getattr(block.contact, side) + h
        block = replace(block, contact=replace(block.contact, **{side: value}))
    elif name.startswith("pin_shift"):
        x, z = block.specimen.pin_shift
        place = (x + h, z) if name.endswith("x") else (x, z + h)
        block = replace(block, specimen=replace(block.specimen, pin_shift=place))
    else:
        value = getattr(block.specimen, name) + h
        block = replace(block, specimen=replace(block.specimen, **{name: value}))
    return block, rubber()


def steps_of(block: BlockPinModel, name: str) -> Array:
    """(4,) changes of a parameter, relative to its size."""
    if name in PLACE:  # forces hardly change with them: more, to stay above what is left to solve
        return 4.0 * FINE * STEPS
    return STEPS * FINE if hasattr(block.specimen, name) else STEPS


def remainders(block: BlockPinModel, name: str, steps: Array) -> Array:
    """(n_step_size, 2) remainders of forces and field in one parameter, relative."""
    base = replace(block, sensitivities=(name,)).respond(rubber())
    found = []
    for h in steps * size(block, name):
        changed, law = moved(block, name, h)
        there = changed.respond(law)
        force = there.force - base.force - h * base.force_gradient[:, 0]
        field = there.displacement - base.displacement - h * base.displacement_gradient[..., 0]
        found.append(
            [
                np.linalg.norm(force) / np.linalg.norm(base.force),
                np.linalg.norm(field) / np.linalg.norm(base.displacement),
            ]
        )
    return np.array(found)


def orders(values: Array, steps: Array) -> Array:
    """(n, ) least-squares slopes of log values (n_step_size, n) over log steps."""
    slopes: Array = np.polyfit(np.log(steps), np.log(values), 1)[0]
    return slopes


def order_of(block: BlockPinModel, name: str) -> Array:
    """(2,) order of the remainder of forces and field in one parameter."""
    steps = steps_of(block, name)
    return orders(remainders(block, name, steps), steps)


def direct_adjoint_difference(block: BlockPinModel) -> float:
    """Largest difference of the two gradients of a misfit, relative to the parameter's largest.

    In every parameter; each travel's misfit has its own random weights of field and force.
    """
    block = replace(block, sensitivities=names(block))
    rng = np.random.default_rng(0)
    weights = rng.standard_normal((len(block.travel), len(block.points()), 3))
    by_force = rng.standard_normal(len(block.travel))
    adjoint = block.objective_gradients(rubber(), lambda i, field, force: (weights[i], by_force[i]))
    base = block.respond(rubber())
    direct = by_force[:, None] * base.force_gradient
    direct = direct + np.einsum("ipk,ipkj->ij", weights, base.displacement_gradient)
    return float((np.abs(adjoint - direct).max(axis=0) / np.abs(direct).max(axis=0)).max())


def figures() -> dict[str, Any]:
    """`taylor_order` by contact, the worst over the parameters, and what each of them gives."""
    order, detail, difference, cost, place = {}, {}, {}, {}, {}
    for case, contact in CONTACTS.items():
        block = model(contact)
        found = {name: order_of(block, name) for name in names(block)}
        worst = np.array(list(found.values())).min(axis=0)
        order[case] = {"force": worst[0], "field": worst[1]}
        detail[case] = {name: value.tolist() for name, value in found.items()}
        difference[case] = direct_adjoint_difference(block)
        cost[case] = cost_percent(case, contact, rubber())
        out_of_place = turned(contact)
        place[case] = {name: order_of(out_of_place, name).tolist() for name in PLACE}
        place[case]["direct_adjoint_difference"] = direct_adjoint_difference(out_of_place)
    return {
        "taylor_order": order,
        "taylor_orders": detail,
        "taylor_orders_turned_bar": place,
        "direct_adjoint_difference": difference,
        "sensitivity_cost_percent": cost,
    }
