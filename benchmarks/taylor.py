"""Taylor test of the sensitivities: the remainder |F(theta + h) - F - h dF| falls as h^2."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from fe import BlockPin, BlockPinModel, Contact
from fe.newton import NewtonOptions

Array = npt.NDArray[np.float64]

CELLS = (8, 3, 2)
TRAVEL = (0.2, 0.4)
RATIOS = np.array([0.4, 0.1])
DIRECTION = np.array([0.8, 0.6])
STEPS = 0.08 * 0.5 ** np.arange(4)
INTERFACES = ("slide", "stick")


def remainders(model: BlockPinModel, steps: Array = STEPS) -> tuple[Array, Array]:
    """First-order remainders of forces and field, relative, and those without the derivative.

    Both (n_step_size, 2): [force, field]; the second column set falls as h only.
    """
    base = model(RATIOS)
    force_slope = base.force_gradient @ DIRECTION
    field_slope = base.displacement_gradient @ DIRECTION
    with_derivative, without = [], []
    for h in steps:
        moved = model(RATIOS + h * DIRECTION)
        force = moved.force - base.force
        field = moved.displacement - base.displacement
        scale = np.linalg.norm(base.force), np.linalg.norm(base.displacement)
        with_derivative.append(
            [
                np.linalg.norm(force - h * force_slope) / scale[0],
                np.linalg.norm(field - h * field_slope) / scale[1],
            ]
        )
        without.append([np.linalg.norm(force) / scale[0], np.linalg.norm(field) / scale[1]])
    return np.array(with_derivative), np.array(without)


def orders(values: Array, steps: Array = STEPS) -> Array:
    """(n, ) least-squares slopes of log values (n_step_size, n) over log steps."""
    slopes: Array = np.polyfit(np.log(steps), np.log(values), 1)[0]
    return slopes


def model(interface: Any, cells: tuple[int, int, int] = CELLS) -> BlockPinModel:
    """A small block; the tolerance is below the smallest remainder."""
    options = replace(NewtonOptions(), tolerance=1e-10)
    contact = Contact(interface, interface)
    return BlockPinModel(BlockPin(), contact, cells, TRAVEL, field_grid=(6, 4), newton=options)


def figures() -> dict[str, Any]:
    """`taylor_order` by contact, of force and field, with the remainders behind them."""
    order, detail = {}, {}
    for interface in INTERFACES:
        values, plain = remainders(model(interface))
        slope = orders(values)
        order[interface] = {"force": slope[0], "field": slope[1]}
        detail[interface] = {
            "steps": STEPS.tolist(),
            "remainder": values.tolist(),
            "difference": plain.tolist(),
        }
    return {"taylor_order": order, "taylor_remainders": detail}
