"""Mesh lines of the block under a pin: similar meshes, the flat's edge, the parts of the block."""

from __future__ import annotations

import itertools
import math
from functools import cache

import numpy as np
import pytest

from benchmarks.grid_convergence import CASES
from benchmarks.mesh_convergence import similar
from fe import BlockPin, BlockPinModel, Contact
from fe.specimens.block_lines import GLUED_EDGE, SIDE
from fe.specimens.block_pin_mesh import block_mesh
from fe.specimens.block_pin_parameters import by_geometry
from fe.specimens.mesh_lines import N_DENSITY, bump, lines_of_density

BAR, ROUND = BlockPin(), BlockPin(pin="round")


STUCK, SLIDING = Contact("stick", "stick"), Contact("slide", "slide")
CONTACTS = pytest.mark.parametrize(
    "contact", [STUCK, SLIDING, Contact(0.3, "stick"), Contact("stick", 0.3)], ids=str
)


def lines(
    specimen: BlockPin, cells: tuple[int, int, int], symmetry="quarter", contact=STUCK
) -> list[np.ndarray]:
    """The mesh lines along x, y, z of a tensor-product mesh, mm."""
    return [np.unique(x) for x in block_mesh(specimen, symmetry, cells, contact).p]


@pytest.mark.parametrize("case", [case for case in CASES if case.pin == "bar"], ids=str)
def test_meshes_of_the_convergence_study_are_similar(case):
    """Lines that any two of them should share, they share."""
    contact = Contact(case.interface, case.interface)
    for one, other in itertools.combinations([mesh.cells for mesh in similar(case)], 2):
        found = (lines(BAR, cells, contact=contact) for cells in (one, other))
        for a, b, m, n in zip(*found, one, other, strict=True):
            common = math.gcd(m, n)
            np.testing.assert_allclose(a[:: m // common], b[:: n // common], rtol=0, atol=1e-12)


@pytest.mark.parametrize("nx", [5, 8, 12, 15])
def test_lines_move_smoothly_with_the_fillet(nx):
    """Also where the edge of the flat comes nearer to another line."""
    fillets = np.linspace(0.2, 0.5, 301)
    x = np.array([lines(BlockPin(pin_fillet=f), (nx, 1, 1))[0] for f in fillets])
    assert np.abs(np.diff(x, axis=0)).max() < 0.003


@CONTACTS
@pytest.mark.parametrize("specimen", [BAR, BlockPin(height=2.7, width=10.2), ROUND])
def test_meshes_of_proportional_cells_are_similar(specimen, contact):
    meshes = [lines(specimen, (6 * n, 3 * n, 2 * n), contact=contact) for n in (2, 3, 4)]
    for a, b, c, common in zip(*meshes, (6, 3, 2), strict=True):
        np.testing.assert_allclose(c[::2], a, rtol=0, atol=1e-12)
        np.testing.assert_allclose(b[::3], a[::2], rtol=0, atol=1e-12)
        assert len(a) == 2 * common + 1


@pytest.mark.parametrize("contact", [SLIDING, Contact(0.3, 0.3)], ids=str)
def test_one_or_two_elements_along_a_bar_keep_the_lines_of_design_samples(contact):
    _, y, z = lines(BAR, (12, 4, 2), contact=contact)
    np.testing.assert_array_equal(y, np.linspace(0.0, 2.5, 5))
    np.testing.assert_allclose(z, [0.0, 3.25, 5.0], rtol=1e-15)


def test_friction_thins_finer_meshes_towards_the_front_and_at_the_edge_of_the_flat():
    sliding, rubbing = (lines(BAR, (12, 4, 4), contact=c) for c in (SLIDING, Contact(0.3, 0.3)))
    np.testing.assert_array_equal(sliding[1], rubbing[1])
    assert (rubbing[2][1:-1] > sliding[2][1:-1]).all()
    wide, thin = np.diff(sliding[0]), np.diff(rubbing[0])
    assert abs(rubbing[0][thin.argmin()] - 1.7) < thin.min()
    assert thin.min() < 0.8 * wide.min()


def test_lines_under_a_round_pin_are_closer_at_the_top_and_most_so_if_it_sticks():
    stuck, sliding = (np.diff(lines(ROUND, (6, 4, 6), contact=c)[1]) for c in (STUCK, SLIDING))
    assert (np.diff(stuck) < 0.0).all()
    assert (np.diff(sliding) < 0.0).all()
    assert stuck[-1] < sliding[-1]


@pytest.mark.parametrize("fillet", [0.2, 0.3, 0.5])
@pytest.mark.parametrize("nx", [2, 3, 5, 8, 12, 13, 24])
def test_a_mesh_line_is_the_edge_of_the_flat_of_a_bar(fillet, nx):
    x = lines(BlockPin(pin_fillet=fillet), (nx, 2, 2))[0]
    assert len(x) == nx + 1
    assert np.abs(x - (2.0 - fillet)).min() < 1e-12


@pytest.mark.parametrize("fillet", [0.2, 0.3, 0.5])
@pytest.mark.parametrize("nx", [2, 3, 5, 8, 12, 13, 24])
def test_the_usual_pin_has_its_edge_on_the_middle_line_to_the_bit(fillet, nx):
    """The lines of a density with the middle one moved, written out."""
    at = np.linspace(0.0, 5.0, N_DENSITY)
    density = 1.0 + bump(5.0 - at, SIDE, 5.0) + bump(at - 0.85 * 2.0, GLUED_EDGE.dense, 2.0)
    share = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
    share /= share[-1]
    edge = float(np.interp(2.0 - fillet, at, share))
    places = np.interp(np.linspace(0.0, 1.0, nx + 1), [0.0, (nx // 2) / nx, 1.0], [0.0, edge, 1.0])
    expected = np.interp(places, share, at)
    expected[[0, -1]] = 0.0, 5.0
    found = lines(BlockPin(pin_fillet=fillet), (nx, 2, 2))[0]
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("nx", [3, 6, 12, 24])
@pytest.mark.parametrize(
    ("specimen", "flat"),
    [
        (BlockPin(pin_fillet=1.9), 0.1),
        (BlockPin(pin_fillet=1.2), 0.8),
        (BlockPin(pin_width=10.4), 4.9),
        (BlockPin(pin_width=9.6), 4.5),
    ],
    ids=["fillet", "wide fillet", "platen", "wide"],
)
def test_a_flat_that_is_narrow_or_wide_leaves_the_other_lines_where_they_are(specimen, flat, nx):
    """A line is its edge; on either side is no more than an element beyond their share."""
    for symmetry in ("quarter", "half"):
        x = lines(specimen, (nx, 2, 2), symmetry)[0]
        x = x[x >= 0.0]
        assert len(x) == nx + 1
        assert np.abs(x - flat).min() < 1e-12
        free = lines_of_density(*_density(specimen), nx)
        before = np.count_nonzero(x[1:] < flat + 1e-9)
        assert abs(before - np.count_nonzero(free[1:] < flat)) <= 1
        assert np.diff(x).max() < 1.5 * np.diff(free).max()


def _density(specimen: BlockPin) -> tuple[np.ndarray, np.ndarray]:
    """Of lines over half the width of a block that sticks to a bar and its base."""
    at, unit = np.linspace(0.0, 5.0, N_DENSITY), specimen.pin_width / 2.0
    bumps = bump(5.0 - at, SIDE, 5.0) + bump(at - GLUED_EDGE.at * unit, GLUED_EDGE.dense, unit)
    return at, 1.0 + bumps


@cache
def _turning() -> tuple[float, float]:
    """Neighbouring fillets, mm, on either side of where another line becomes the flat's edge."""
    low, high = 0.5, 1.0
    while high - low > 1e-13:
        middle = 0.5 * (low + high)
        x = lines(BlockPin(pin_fillet=middle), (12, 1, 1))[0]
        low, high = (middle, high) if abs(x[6] - (2.0 - middle)) < 1e-9 else (low, middle)
    return low, high


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("name", ["pin_fillet", "pin_width", "width"])
def test_lines_do_not_jump_where_a_dimension_is_differenced(name, side):
    """Lines over an mm of what is differenced: at most by some mm, not by a step over 1e-6 mm."""
    specimen = BlockPin(pin_fillet=_turning()[side])
    model = BlockPinModel(specimen, STUCK, (12, 1, 1), (0.1,))
    slope = by_geometry(name, specimen, lambda block: model._mesh_of(block).p)
    assert 0.0 < np.abs(slope).max() < 3.0


@pytest.mark.parametrize(
    "specimen",
    [BAR, ROUND, BlockPin(pin_width=40.0), BlockPin(pin_width=9.9), BlockPin(pin_shift=(4.0, 0.0))],
    ids=["bar", "round", "platen", "wide", "shifted"],
)
@CONTACTS
@pytest.mark.parametrize("cells", [(1, 1, 1), (3, 2, 2), (12, 6, 2)])
def test_lines_are_distinct_and_end_at_the_faces(specimen, cells, contact):
    for symmetry in ("half", "full") if specimen.pin_shift[0] else ("quarter", "half", "full"):
        sides = {"quarter": (1, 1), "half": (2, 1), "full": (2, 2)}[symmetry]
        x, y, z = lines(specimen, cells, symmetry, contact)
        found = [len(line) - 1 for line in (x, y, z)]
        assert found == [cells[0] * sides[0], cells[1], cells[2] * sides[1]]
        assert (x[-1], y[0], y[-1], z[-1]) == (5.0, 0.0, 2.5, 5.0)
        assert (x[0], z[0]) == (-5.0 if sides[0] == 2 else 0.0, -5.0 if sides[1] == 2 else 0.0)
        assert min(np.diff(line).min() for line in (x, y, z)) > 0.01


@pytest.mark.parametrize("specimen", [BAR, ROUND])
def test_a_half_and_a_full_mesh_have_the_lines_of_the_quarter_on_both_sides(specimen):
    x, _, z = lines(specimen, (6, 3, 2))
    half, full = (lines(specimen, (6, 3, 2), symmetry) for symmetry in ("half", "full"))
    mirrored = [np.concatenate([-line[:0:-1], line]) for line in (x, z)]
    np.testing.assert_allclose(half[0], mirrored[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(full[0], mirrored[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(full[2], mirrored[1], rtol=0, atol=1e-12)


def test_elements_are_thinner_where_glue_ends_and_nowhere_else():
    stuck, sliding = lines(BAR, (12, 6, 3)), lines(BAR, (12, 6, 3), contact=SLIDING)
    base = lines(BAR, (12, 6, 3), contact=Contact(0.3, "stick"))
    assert np.ptp(np.diff(sliding[1])) < 1e-12
    height = [np.diff(found[1]) for found in (stuck, base)]
    assert height[0][0] < height[0][2] > height[0][-1]
    assert height[1][0] < height[1][2] < height[1][-1] + 1e-9
    assert np.diff(stuck[2])[-1] < np.diff(sliding[2])[-1]
