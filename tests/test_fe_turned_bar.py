"""Lines of a mesh that follow a turned bar, and what is said where they cannot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fe
from fe import BlockPin, BlockPinModel, Contact, Status
from fe.specimens.block_pin_mesh import block_mesh
from fe.specimens.turned_bar import Lie, edge_crosses_elements, lie

STUCK, SLIDING = Contact("stick", "stick"), Contact("slide", "stick")
THETA = (0.01, 0.2)
CROSSES = "the edge of the turned bar crosses elements"


def model(contact=STUCK, cells=(3, 2, 2), travel=(0.1, 0.2), **geometry) -> BlockPinModel:
    return BlockPinModel(
        BlockPin(**geometry),
        contact,
        cells,
        travel,
        field_grid=(3, 2),
        newton=fe.NewtonOptions(tolerance=1e-9),
        symmetry="full",
    )


def force(of: BlockPinModel) -> np.ndarray:
    response = fe.simulate(of, "neo-hookean", THETA)
    assert response.status is Status.CONVERGED, response.message
    return response.force


@pytest.mark.parametrize("contact", [STUCK, SLIDING, Contact(0.3, "stick")], ids=str)
def test_a_bar_turned_by_90_degrees_is_the_straight_one_with_width_and_depth_exchanged(contact):
    straight = model(contact, (3, 2, 2), width=10.0, depth=8.0, pin_shift=(0.4, 0.0))
    turned = model(
        contact, (2, 2, 3), width=8.0, depth=10.0, pin_shift=(0.0, -0.4), pin_rotation=90.0
    )
    np.testing.assert_allclose(force(turned), force(straight), rtol=1e-6)


@pytest.mark.parametrize("rotation", [-155.0, -20.0, -3.0, 1e-3, 12.0, 25.0, 70.0, 89.0, 110.0])
def test_two_lines_are_the_edges_of_the_flat_at_each_line_along_the_bar(rotation):
    block = BlockPin(width=11.0, depth=10.0, pin_shift=(0.3, -0.2), pin_rotation=rotation)
    assert lie(block).followed
    p = block_mesh(block, "full", (4, 1, 3), STUCK).p
    angle = np.radians(rotation)
    across = np.cos(angle) * (p[0] - 0.3) - np.sin(angle) * (p[2] + 0.2)
    for edge in (-1.7, 1.7):
        # seven lines along the bar (quarter 3), two of height
        found = np.count_nonzero(np.abs(across - edge) < 1e-9)
        assert found == 2 * (2 * 3 + 1 if lie(block).along == 2 else 2 * 4 + 1)


@pytest.mark.parametrize("rotation", [-20.0, 12.0, 45.0, 70.0, 90.0])
def test_the_mesh_fills_the_block(rotation):
    block = BlockPin(width=11.0, depth=10.0, pin_rotation=rotation)
    mesh = block_mesh(block, "full", (3, 2, 2), STUCK)
    assert mesh.nelements == 8 * 3 * 2 * 2 // 2
    corners = mesh.p[:, mesh.t]
    sizes = corners.max(axis=1) - corners.min(axis=1)
    assert sizes.min() > 0.05
    volume = fe.BlockPinModel(block, STUCK, (3, 2, 2), (0.1,), symmetry="full").discretise()
    assert volume.elements.weights.sum() == pytest.approx(11.0 * 10.0 * 2.5, rel=1e-12)


@pytest.mark.parametrize(
    ("rotation", "expected"),
    [
        (0.0, Lie(2, True)),
        (25.0, Lie(2, True)),
        (-25.0, Lie(2, True)),
        (45.0, Lie(2, False)),
        (-44.0, Lie(2, False)),
        (65.0, Lie(0, True)),
        (90.0, Lie(0, True)),
        (180.0 + 25.0, Lie(2, True)),
    ],
)
def test_lines_follow_a_bar_that_leaves_by_the_faces_it_goes_to(rotation, expected):
    assert lie(BlockPin(pin_rotation=rotation)) == expected


def test_a_turn_of_ten_degrees_adds_to_the_force_what_a_fine_mesh_says():
    """1.5 %; with the lines of a straight bar, where glue ends inside elements, 9 to 11 %."""
    coarse, fine = (
        force(model(cells=cells, pin_rotation=10.0)) / force(model(cells=cells))
        for cells in ((4, 2, 2), (6, 3, 4))
    )
    np.testing.assert_allclose(coarse, fine, rtol=2e-3)
    assert 1.01 < fine[-1] < 1.02


@pytest.mark.parametrize(
    ("geometry", "contact", "said"),
    [
        ({"pin_rotation": 10.0}, STUCK, ""),
        ({"pin_rotation": 45.0}, STUCK, f"{CROSSES}, and glue that ends inside elements stiffens"),
        ({"pin_rotation": 45.0}, SLIDING, CROSSES),
        ({"pin_rotation": 45.0, "pin_width": 40.0}, STUCK, ""),
        ({"pin_rotation": 45.0, "pin": "round"}, STUCK, ""),
    ],
)
def test_a_bar_that_no_grid_follows_is_told(geometry, contact, said):
    of = model(contact, (2, 1, 2), (0.05,), **geometry)
    message = fe.simulate(of, "neo-hookean", THETA).message
    assert (said in message) if said else (CROSSES not in message)
    assert edge_crosses_elements(of.specimen) == bool(said)


@pytest.mark.parametrize("rotation", [0.0, 20.0, 75.0])
def test_the_slope_of_lines_in_the_rotation_is_their_motion(rotation):
    block = BlockPin(pin_shift=(0.2, 0.1), pin_rotation=rotation)
    of = BlockPinModel(
        block,
        STUCK,
        (3, 1, 2),
        (0.05, 0.1),
        field_grid=(3, 2),
        newton=fe.NewtonOptions(tolerance=1e-10),
        sensitivities=("pin_rotation", "width", "pin_shift_z"),
        symmetry="full",
    )
    found = fe.simulate(of, "neo-hookean", THETA)
    for j, (name, h) in enumerate((("pin_rotation", 0.05), ("width", 1e-3), ("pin_shift_z", 1e-3))):
        ends = []
        for by in (h, -h):
            if name == "pin_shift_z":
                changed = replace(block, pin_shift=(0.2, 0.1 + by))
            else:
                changed = replace(block, **{name: getattr(block, name) + by})
            ends.append(fe.simulate(replace(of, specimen=changed), "neo-hookean", THETA))
        slope = (ends[0].force - ends[1].force) / (2.0 * h)
        scale = 1e-3 * np.abs(slope).max() + 1e-7
        np.testing.assert_allclose(found.force_gradient[:, j], slope, atol=scale, err_msg=name)
        moved = (ends[0].displacement - ends[1].displacement) / (2.0 * h)
        found_field = found.displacement_gradient[..., j]
        scale = 2e-3 * np.abs(moved).max() + 1e-7
        np.testing.assert_allclose(found_field, moved, atol=scale, err_msg=name)


@pytest.mark.parametrize(
    "pin", [{"pin_width": 40.0}, {"pin_width": 10.0}, {"pin_shift": (3.2, 0.0)}]
)
def test_a_straight_bar_keeps_its_lines_in_a_full_model_however_wide_or_near_a_face(pin):
    half, full = (block_mesh(BlockPin(**pin), s, (6, 3, 2), STUCK).p for s in ("half", "full"))
    for axis in (0, 1):
        np.testing.assert_array_equal(np.unique(full[axis]), np.unique(half[axis]))
