"""A pin's contact by CalculiX's own contact and bricks; skipped, visibly, without ccx."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import calculix
from benchmarks.calculix_contact import CASES, compare, pin_bricks
from fe import BlockPin
from fe.pin_surface import bar_distance

needs_ccx = pytest.mark.skipif(
    not calculix.available(),
    reason="ccx is not installed (apt-get install calculix-ccx): no comparison with CalculiX",
)


@needs_ccx
@pytest.mark.lasting
@pytest.mark.parametrize(("number", "share"), [(0, 0.03), (2, 0.06)], ids=["sliding", "friction"])
def test_force_and_front_face_under_a_bar_are_those_of_calculix(number: int, share: float) -> None:
    """On two coarse meshes; measured: 0.3 % of the force, 1 and 4 % of the field."""
    found = compare(replace(CASES[number], travel=(0.3,)), (10, 4, 3), 1)
    assert np.abs(found.percent).max() < 0.7
    assert (found.field_rms < share * found.field_size).all()


@needs_ccx
@pytest.mark.slow
@pytest.mark.parametrize("number", [3, 4], ids=["sliding", "friction"])
def test_force_and_front_face_under_a_round_pin_are_those_of_calculix(number: int) -> None:
    """Measured: 0.1 % of the force with friction; 0.6 um of a face that moves by 7 um."""
    found = compare(replace(CASES[number], travel=(0.4,)), (10, 5, 10), 1)
    assert np.abs(found.percent).max() < 1.5
    assert found.field_rms.max() < 1e-3  # mm


@pytest.mark.parametrize("pin", ["bar", "round"])
def test_facets_lie_on_the_pins_surface_and_look_outwards(pin) -> None:
    block = BlockPin(pin=pin)
    positions, nodes = pin_bricks(block)
    facets = positions[nodes[:, :4]]
    surface = block.rigid_pin(1.0, 1.0, 1.0)
    normal = np.cross(facets[:, 2] - facets[:, 0], facets[:, 3] - facets[:, 1])
    inside = positions[nodes[:, 4:]].mean(axis=1) - facets.mean(axis=1)
    assert (np.einsum("ni,ni->n", normal, inside) > 0.0).all()  # CalculiX counts them so
    out = facets[..., 0] if pin == "bar" else np.hypot(facets[..., 0], facets[..., 2])
    gaps = [
        bar_distance(r, y, surface.half_width, surface.fillet, surface.height)[0]
        for r, y in zip(out.ravel(), facets[..., 1].ravel(), strict=True)
    ]
    assert np.abs(gaps).max() < 1e-12


@needs_ccx
def test_a_deck_that_ccx_cannot_solve_is_refused_with_what_it_printed(monkeypatch) -> None:
    solve = calculix.run
    broken = ("MATERIAL=STEEL", "MATERIAL=NONE")
    monkeypatch.setattr(calculix, "run", lambda text: solve(text.replace(*broken)))
    with pytest.raises(RuntimeError, match="ccx did not solve all 5 increments"):
        compare(CASES[0], (4, 2, 1), 1)
