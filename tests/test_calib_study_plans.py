"""Experiments that a study may be followed by: which blocks are tried beside its own."""

from __future__ import annotations

import pytest

from calib.study.plans import _other_blocks
from fe import BlockPin, BlockPinModel, Contact


@pytest.mark.parametrize(
    ("pin_width", "fillet", "width", "expected"),
    [
        (4.0, 0.3, 10.0, ["3", "5"]),
        (1.0, 0.3, 10.0, ["0.75", "1.25"]),
        (1.0, 0.45, 10.0, ["1.25"]),  # two fillets leave no flat on a narrower one
        (3.5, 0.3, 4.0, ["2.62"]),  # a wider one would be wider than the block
    ],
)
def test_other_pins_are_narrower_and_wider_by_a_quarter_as_far_as_they_can_be(
    pin_width: float, fillet: float, width: float, expected: list[str]
) -> None:
    block = BlockPin(width=width, pin_width=pin_width, pin_fillet=fillet)
    found = dict(_other_blocks(BlockPinModel(block, Contact("stick", "stick"), (4, 2, 1), (0.5,))))
    pins = [name for name in found if name.startswith("pin")]
    assert pins == [f"pin {size} mm wide" for size in expected]
    for name in pins:
        assert found[name].specimen.pin_width == pytest.approx(float(name.split()[1]), abs=0.01)
    assert len(found) == len(pins) + 2
