"""Force under a turned bar, whose mesh follows it where it can, beside that on finer elements."""

from __future__ import annotations

from typing import Any

import fe
from fe import BlockPin, BlockPinModel, Contact
from fe.specimens.turned_bar import lie

ANGLES = (0.0, 5.0, 10.0, 20.0, 27.0, 45.0, 90.0)
"""degrees"""
TRAVEL = 0.2
COARSE, FINE = (6, 3, 4), (12, 4, 8)
"""elements across, over the height and along a quarter; across is x to 45 degrees, then z"""
CONTACTS = {
    "stuck": Contact("stick", "stick"),
    "sliding on a stuck base": Contact("slide", "stick"),
}
LAW, CONSTANTS = "neo-hookean", (0.01, 0.2)
"""C10 and bulk modulus, MPa"""


def figures() -> dict[str, Any]:
    """By contact and angle: force N on both meshes, and what the coarser one is off by, %."""
    found: dict[str, Any] = {}
    for name, contact in CONTACTS.items():
        rows = []
        for angle in ANGLES:
            coarse, fine = (_force(angle, contact, cells) for cells in (COARSE, FINE))
            row = {
                "degrees": angle,
                "followed": lie(BlockPin(pin_rotation=angle)).followed,
                "force_N": [coarse, fine],
                "off_percent": 100.0 * (coarse / fine - 1.0),
            }
            print(f"  {name}: {row}", flush=True)
            rows.append(row)
        found[name] = rows
    return {"turned_bars": {"cells": [COARSE, FINE], "travel_mm": TRAVEL, "rows": found}}


def _force(angle: float, contact: Contact, cells: tuple[int, int, int]) -> float:
    block = BlockPin(pin_rotation=angle)
    across, height, along = cells
    turned = cells if lie(block).along == 2 else (along, height, across)
    model = BlockPinModel(
        block,
        contact,
        turned,
        (TRAVEL,),
        field_grid=(2, 2),
        symmetry="full",
        sensitivities=(),
    )
    return float(fe.simulate(model, LAW, CONSTANTS).force[-1])
