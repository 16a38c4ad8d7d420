"""The thesis' meshes of first-order elements: the block of the product on another element."""

from __future__ import annotations

import json

import pytest

from benchmarks.first_order_block import main, press
from fe import BlockPin, BlockPinModel, Contact

TRAVEL = (0.1, 0.2)


def test_their_force_comes_down_to_that_of_the_products_elements():
    model = BlockPinModel(BlockPin(), Contact("stick", "stick"), (10, 5, 4), TRAVEL)
    force = model([0.0, 0.0]).force
    off = [press(n, travel=TRAVEL).force[-1] / force[-1] - 1.0 for n in (2, 4)]
    assert off[0] > 2.0 * off[1] > 0.0


def test_the_script_writes_forces_times_and_how_far_it_came(tmp_path):
    out = tmp_path / "first_order.json"
    main(["2", "--json", str(out), "--travel", "0.1", "0.2"])
    (row,) = json.loads(out.read_text())
    assert row["n"] == 2 and row["cells"] == [4, 2, 4] and row["thesis_seconds"] is None
    # x, z: 5 lines from the symmetry plane, 4 of them free across it; the base is glued
    assert row["n_unknowns"] == 2 * (5 * 5 * 3 - 2 * 5)
    assert row["reached"] == pytest.approx(0.2) and len(row["force"]) == 2
