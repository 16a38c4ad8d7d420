"""The index of one coordinate at a time on made-up errors whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from benchmarks import directional_index, mesh_convergence
from benchmarks.coordinate_refinement import share
from benchmarks.directional_index import index, neighbours, total
from benchmarks.grid_convergence import CASES
from benchmarks.mesh_convergence import Case, Mesh, fitting
from benchmarks.meshes import name_of
from fe import Rings

NUMBERS = ((8, 16, 32), (3, 5, 10), (1, 2, 4))
"""of elements in three coordinates, with halves that are rounded up"""
TRUTH = 50.0
N = 4000


@dataclass(frozen=True)
class Simple:
    """What is read of a response."""

    force: np.ndarray
    displacement: np.ndarray


def made(orders, sizes, noise=0.0, seed=0):
    """Errors (N,) of a mesh whose coordinates have errors `sizes` (3, N), and its three shares.

    All seven meshes scatter with a standard deviation of `noise`, each on its own.
    """
    random = np.random.default_rng(seed)
    scatter = noise * random.standard_normal((7, N))
    own = TRUTH + sizes.sum(axis=0) + scatter[0]
    shares = []
    for axis, (coarse, n, fine) in enumerate(NUMBERS):
        changes = [sizes[axis] * ((n / m) ** orders[axis] - 1.0) for m in (coarse, fine)]
        beside = [
            own - scatter[0] + c + s for c, s in zip(changes, scatter[2 * axis + 1 :], strict=False)
        ]
        values = np.stack([beside[0], own, beside[1]])[..., None]
        shares.append(share(values, (coarse, n, fine)))
    return own - TRUTH, shares


def held(error, shares, measure):
    """Share of the errors that the sum of the shares holds."""
    return float(np.mean(np.abs(error) <= sum(getattr(one, measure) for one in shares)))


@pytest.mark.parametrize("orders", [(1.0, 1.0, 1.0), (2.0, 2.0, 2.0), (1.0, 1.5, 2.0)])
def test_without_scatter_each_share_is_the_error_of_its_coordinate_times_the_factor(orders):
    sizes = np.random.default_rng(1).standard_normal((3, N))
    _, shares = made(orders, sizes)
    for one, order, size in zip(shares, orders, sizes, strict=True):
        np.testing.assert_allclose(one.order, order, atol=1e-6)
        np.testing.assert_allclose(one.index, 1.25 * np.abs(size), rtol=1e-6)
        assert (one.first_order >= 0.999999 * one.index).all()


def test_an_order_above_two_is_not_believed_and_the_share_is_too_large():
    sizes = np.ones((3, N))
    for one in made((3.0, 3.0, 3.0), sizes)[1]:
        np.testing.assert_allclose(one.order, 2.0)
        np.testing.assert_allclose(one.index, 1.25 * (1.0 - 1.0 / 8.0) * 4.0 / 3.0)


@pytest.mark.parametrize("finer", [0.0, 0.9, 0.5, 2.0])
def test_meshes_that_part_or_turn_back_get_order_one(finer):
    """From 0 over 1: back below 1, no further than before, or further."""
    values = np.array([0.0, 1.0, finer if finer < 1.0 else 1.0 + finer])[:, None, None]
    one = share(values, (4, 8, 16))
    assert one.order == 1.0
    np.testing.assert_allclose(one.index, 1.25 * 2.0 * abs(values[2, 0] - 1.0))
    np.testing.assert_array_equal(one.index, one.first_order)


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.2, 0.3, 1.0, 10.0])
@pytest.mark.parametrize(("order", "least"), [(1.0, 0.9), (1.5, 0.93), (2.0, 0.95), (3.0, 0.97)])
def test_the_sum_of_the_shares_holds_the_error_beside_scatter(order, least, noise):
    """Errors of either sign; scatter of a mesh in units of the error of one coordinate.

    At worst 91.5, 95, 96.5 and 98 %, and with order 1 in all 94.5 %, at a scatter of 0.1 to 0.3.
    """
    sizes = np.random.default_rng(2).standard_normal((3, N))
    error, shares = made((order,) * 3, sizes, noise, seed=3)
    assert held(error, shares, "index") > least
    assert held(error, shares, "first_order") > 0.932


def test_the_root_of_the_sum_of_squares_does_not_hold_the_error():
    sizes = np.random.default_rng(4).standard_normal((3, N))
    error, shares = made((1.5,) * 3, sizes)
    root = np.sqrt(sum(one.index**2 for one in shares))
    assert 0.65 < np.mean(np.abs(error) <= root) < 0.8
    assert held(error, shares, "index") == 1.0


@pytest.mark.parametrize("mixed", [-0.3, 0.5, 2.0])
def test_a_mixed_term_is_counted_in_each_of_its_coordinates(mixed):
    """Errors h_x + h_y + c h_x h_y: with c > 0 the bound counts c twice, with c < 0 it is close."""

    def value(hx, hy):
        return np.full((1, 1), TRUTH + hx + hy + mixed * hx * hy)

    own = value(1.0, 1.0)
    by_x = share(np.stack([value(2.0, 1.0), own, value(0.5, 1.0)]), (4, 8, 16))
    by_y = share(np.stack([value(1.0, 2.0), own, value(1.0, 0.5)]), (4, 8, 16))
    found = by_x.index + by_y.index
    np.testing.assert_allclose(found, 1.25 * (2.0 + 2.0 * mixed))
    assert (own - TRUTH)[:, 0] <= found


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.5])
def test_of_a_field_the_rms_is_held(noise):
    random = np.random.default_rng(5)
    holds = []
    for _ in range(200):
        sizes = random.standard_normal((3, 60))
        scatter = noise * random.standard_normal((7, 60))
        own = sizes.sum(axis=0) + scatter[0]
        bound = 0.0
        for axis, (coarse, n, fine) in enumerate(NUMBERS):
            values = [
                own - scatter[0] + sizes[axis] * ((n / m) ** 1.5 - 1.0) + scatter[2 * axis + k]
                for m, k in ((coarse, 1), (fine, 2))
            ]
            bound += share(np.stack([values[0], own, values[1]])[:, None], (coarse, n, fine)).index[
                0
            ]
        holds.append(np.sqrt(np.mean(own**2)) <= bound)
    assert np.mean(holds) >= 0.95


def test_without_one_neighbour_the_other_tells_with_order_one():
    h = np.array([5 / 3, 1.0, 0.5])
    values = (TRUTH + 0.3 * h)[:, None, None]
    for missing in (0, 2):
        known = values.copy()
        known[missing] = np.nan
        one = share(known, (3, 5, 10))
        np.testing.assert_allclose([one.index, one.first_order], 1.25 * 0.3)
        assert one.order == 1.0
    values[[0, 2]] = np.nan
    assert np.isnan(share(values, (3, 5, 10)).index)


def test_equal_meshes_have_no_share_and_numbers_must_grow():
    one = share(np.ones((3, 2, 4)), (1, 2, 4))
    assert not one.index.any()
    assert not one.first_order.any()
    with pytest.raises(ValueError, match="three that grow"):
        share(np.ones((3, 1, 1)), (1, 1, 2))


@pytest.mark.parametrize("case", CASES, ids=str)
def test_neighbours_differ_from_a_fitting_mesh_in_one_coordinate(case):
    own = fitting(case)
    found = neighbours(case, own)
    assert len(found) == 3
    for axis, of in enumerate(found):
        coarse, n, fine = of.numbers
        assert fine == 2 * n
        assert 1.25 < n / coarse <= 2.0
        for mesh, number in ((of.coarse, coarse), (of.fine, fine)):
            expected = [*own.numbers]
            expected[axis] = number
            assert ([*mesh.numbers], mesh.step) == (expected, own.step)


def test_the_index_of_a_case_is_that_of_the_errors_of_its_coordinates(tmp_path, monkeypatch):
    """Of order 2 in the numbers of elements: also with two coordinates from the mesh before, and
    with a coordinate refined by less than twice."""

    def error(mesh):
        return 0.01 * float(np.sum(1.0 / np.array(mesh.numbers) ** 2))

    def simulate(folder, case, mesh, ratios):
        field = 0.4 + error(mesh) * np.ones((5, 7, 3))
        return Simple(force=100.0 + 100.0 * error(mesh) * np.ones(5), displacement=field)

    monkeypatch.setattr(directional_index, "simulate", simulate)
    monkeypatch.setattr(mesh_convergence, "FOLLOWED", {})
    found = directional_index.figures(tmp_path)
    meshes = {str(case): fitting(case) for case in CASES} | {
        f"{case}, {name_of(mesh.cells)}": mesh for case, mesh in directional_index.BEFORE.items()
    }
    for case, finer in directional_index.LESS_FINE.items():
        to = ", ".join(f"{name} to {number}" for name, number in finer.items())
        meshes[f"{case}, {to}"] = meshes[case]
    assert set(found["force_directional_percent"]) == set(meshes)
    for name, mesh in meshes.items():
        force = found["force_directional_percent"][name]
        np.testing.assert_allclose(list(force.values()), 125.0 * error(mesh), rtol=5e-3)
        field = found["field_directional_mm"][name]
        np.testing.assert_allclose(list(field.values()), 1.25 * error(mesh), rtol=1e-5)


def test_a_mesh_that_is_not_followed_is_not_run_and_its_opposite_tells(tmp_path, monkeypatch):
    case, mesh = Case("bar", "stick"), Mesh((4, 4, 2), 0.05)
    run = []

    def simulate(folder, case, mesh, ratios):
        run.append(mesh.cells)
        size = float(np.sum(1.0 / np.array(mesh.numbers)))
        return Simple(force=100.0 + size * np.ones(5), displacement=size * np.ones((5, 7, 3)))

    monkeypatch.setattr(directional_index, "simulate", simulate)
    monkeypatch.setitem(mesh_convergence.FOLLOWED, "stick, 4 x 8 x 2, 0.05", 0.0)
    found = directional_index.study(tmp_path, case, mesh)
    assert (4, 8, 2) not in run
    np.testing.assert_allclose(found.field["y"].index, 1.25 / 4)
    np.testing.assert_allclose(total(found.field, "index"), 1.25 * (1 / 4 + 1 / 4 + 1 / 2))


def test_a_run_that_stopped_short_leaves_the_later_travels_to_its_opposite():
    case, mesh = Case("round", "slide"), Mesh(Rings(4, 4, 2), 0.05)
    own = Simple(force=np.array([10.0, 20.0]), displacement=np.ones((2, 3, 3)))
    stopped = Simple(
        force=np.array([10.1, np.nan]),
        displacement=np.array([[[1.1]], [[np.nan]]]) + np.zeros((2, 3, 3)),
    )
    coarse = Simple(force=np.array([9.8, 19.0]), displacement=0.8 * np.ones((2, 3, 3)))
    triples = {of.name: (of.numbers, (coarse, own, stopped)) for of in neighbours(case, mesh)}
    found = index(triples)
    np.testing.assert_allclose(total(found.force, "first_order"), [3 * 2.5, 3 * 1.25 * 5.0])
    np.testing.assert_allclose(total(found.field, "first_order"), [3 * 0.25, 3 * 0.25])
