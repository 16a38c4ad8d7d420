"""The field of one sample: lattice, masks, outliers, mapping, placement, rigid motion."""

from __future__ import annotations

import numpy as np
import pytest
from closed_form_laboratory import EDGE, Truth, field_at, frames

from calib.data.qc.experiment_file import Axes, Mask
from calib.data.qc.lattice import lattice_of
from calib.data.qc.mapping import map_field
from calib.data.qc.masks import inside
from calib.data.qc.outliers import without_outliers
from calib.data.qc.registration import place
from calib.data.qc.rigid_motion import folded, without_rigid_motion
from calib.data.readers import PointFrame

AXES = np.eye(3)
POINTS = np.array([[x, y] for x in np.arange(0.1, 4.4, 0.3) for y in np.arange(0.3, 2.0, 0.25)])
TRAVEL = [0.0, 0.4, 0.6, 0.8]


def of(truth: Truth, seed: int = 0):
    return lattice_of(frames(truth, TRAVEL, np.random.default_rng(seed)), AXES)


def mapped(truth: Truth, method="linear", rigid="none", seed: int = 0):
    lattice = of(truth, seed)
    at = place(lattice, [2, 3], 10.0)
    halves = []
    for sign in (1.0, -1.0):
        where = lattice.coordinates(at.points(POINTS * np.array([sign, 1.0])))
        halves.append(map_field(lattice.displacement[1:], where, method) @ at.rotation.T)
    right, left, motion = without_rigid_motion(*halves, POINTS, rigid)
    return folded(right, left), motion


@pytest.mark.parametrize(
    ("angle", "tilt", "roll", "x_shift"),
    [(0.0, 0.0, 0.0, 0.0), (1.4, 0.0, 0.0, -0.31), (-0.8, 0.6, 0.9, 0.22), (0.5, -1.0, -1.2, 0.1)],
)
def test_a_sample_is_found_where_it_was_put(angle, tilt, roll, x_shift):
    truth = Truth(angle, tilt, roll, x_shift, noise=0.005)
    found = place(of(truth), [2, 3], 10.0)
    assert found.angle_deg == pytest.approx(angle, abs=0.03)
    assert found.tilt_deg == pytest.approx(tilt, abs=0.05)
    assert found.roll_deg == pytest.approx(roll, abs=0.25)
    # a side lies up to a column of 0.14 mm beyond the last point: the middle is half of that off
    assert found.x_shift == pytest.approx(x_shift, abs=0.08)
    np.testing.assert_allclose(found.origin, truth.origin, atol=0.08)


def test_the_pin_is_found_to_a_tenth_of_the_points_distance():
    errors = []
    for seed, (shift, pin) in enumerate([(0.0, 0.03), (0.2, 0.11), (-0.3, 0.29), (0.1, -0.17)]):
        truth = Truth(x_shift=shift, origin=(pin, 0.0, 1.0), noise=0.01)
        errors.append(place(of(truth, seed), [2, 3], 10.0).origin[0] - pin)
    assert np.max(np.abs(errors)) < 0.014


def test_an_edge_that_is_given_replaces_the_one_found():
    lattice = of(Truth())
    low, high = (place(lattice, [2, 3], 10.0, edge=edge).origin[1] for edge in (0.3, 0.1))
    assert high - low == pytest.approx(0.2)
    assert place(lattice, [2, 3], 10.0, base=-1.3).origin[1] == pytest.approx(-1.3)


@pytest.mark.parametrize("method", ["linear", "cubic", "shape"])
def test_a_mapped_field_is_the_closed_form_at_the_points(method):
    field, _ = mapped(Truth(angle=0.6, tilt=0.3, x_shift=0.15), method)
    truth = np.stack([field_at(POINTS, t) for t in TRAVEL[1:]])
    known = np.isfinite(field).all(axis=(0, 2))
    assert known.mean() > 0.9
    rms = np.sqrt(np.mean((field - truth)[:, known] ** 2, axis=(0, 1)))
    # placement to 0.02 mm over slopes of 0.5, and what a line leaves of a curve
    assert rms.max() < 0.012


def test_rigid_motion_put_on_a_sample_is_taken_off_again():
    rigid = (0.06, 0.004, -0.005)
    field, motion = mapped(Truth(rigid=rigid), rigid="symmetry")
    still, _ = mapped(Truth())
    np.testing.assert_allclose(motion[-1], rigid, rtol=0.15, atol=0.003)
    known = np.isfinite(field) & np.isfinite(still)
    assert np.abs(field - still)[known].max() < 0.006
    with_it, _ = mapped(Truth(rigid=rigid), rigid="none")
    shift = folded(np.full((1, 1, 3), 0.06), np.full((1, 1, 3), 0.06))
    assert shift[0, 0, 0] == 0.0, "folding cancels a shift along x, and nothing else"
    assert np.nanmax(np.abs(with_it - still)) < 0.05


def test_rigid_motion_of_a_sticking_base_is_exact():
    x, y = POINTS.T
    still = np.zeros((1, len(x), 3))
    halves = []
    for along in (x, -x):
        moved = still.copy()
        moved[0] = np.stack([0.1 - 0.02 * y, 0.2 + 0.02 * along, -0.3 - 0.01 * along], axis=1)
        halves.append(moved)
    near = POINTS.copy()
    near[:, 1] -= 0.2  # so that some points are in the band at the base
    for half, along in zip(halves, (x, -x), strict=True):
        half[0, :, 0] = 0.1 - 0.02 * near[:, 1]
        half[0, :, 1] = 0.2 + 0.02 * along
    right, left, motion = without_rigid_motion(halves[0], halves[1], near, "base")
    np.testing.assert_allclose(motion[0], [0.1, 0.02, 0.01], atol=1e-12)
    np.testing.assert_allclose(right, 0.0, atol=1e-12)
    np.testing.assert_allclose(left, 0.0, atol=1e-12)


def linear_field(shape=(9, 11)):
    row, column = np.indices(shape)
    return np.stack([0.1 * column, 0.2 * row, 0.3 * column - 0.1 * row], axis=-1)[None]


@pytest.mark.parametrize("method", ["linear", "cubic", "shape"])
def test_every_mapping_gives_a_plane_back(method):
    at = np.array([[2.3, 4.7], [5.5, 1.5], [0.0, 0.0], [7.9, 7.2], [10.0, 8.0], [10.0, 2.5]])
    column, row = at.T
    expected = np.stack([0.1 * column, 0.2 * row, 0.3 * column - 0.1 * row], axis=-1)
    np.testing.assert_allclose(map_field(linear_field(), at, method)[0], expected, atol=1e-12)


@pytest.mark.parametrize("method", ["linear", "cubic", "shape"])
def test_three_neighbours_are_enough_and_two_are_not(method):
    values = linear_field()
    values[0, 4, 3] = np.nan
    at = np.array([[2.4, 3.6]])
    found = map_field(values, at, method)[0, 0]
    np.testing.assert_allclose(found, [0.24, 0.72, 0.36], atol=1e-12)
    values[0, 3, 2] = np.nan
    assert np.isnan(map_field(values, at, method)).all()


def test_cubic_mapping_of_a_quadratic_is_exact_and_linear_is_not():
    row, column = np.indices((8, 8)).astype(float)
    values = np.stack([column**2, row**2, column * row], axis=-1)[None]
    at = np.array([[3.4, 4.3]])
    expected = [3.4**2, 4.3**2, 3.4 * 4.3]
    np.testing.assert_allclose(map_field(values, at, "cubic")[0, 0], expected, atol=1e-12)
    # between whole numbers a line is too high by t (1 - t)
    off = map_field(values, at, "linear")[0, 0] - expected
    np.testing.assert_allclose(off, [0.4 * 0.6, 0.3 * 0.7, 0.0], atol=1e-12)


def test_points_beside_the_lattice_have_no_value():
    at = np.array([[-0.2, 1.0], [3.0, 8.3], [30.0, 2.0]])
    assert np.isnan(map_field(linear_field(), at, "linear")).all()


def test_outliers_are_found_and_replaced_and_little_else_is():
    rng = np.random.default_rng(0)
    row, column = np.indices((50, 120))
    field = np.stack([np.sin(column / 20), (row / 50.0) ** 2, np.cos(row / 20)], axis=-1)
    noisy = field + 0.005 * rng.standard_normal(field.shape)
    apart = np.flatnonzero((row % 6 == 0) & (column % 7 == 0))  # none next to another
    wild = rng.choice(apart, 60, replace=False)
    noisy.reshape(-1, 3)[wild, rng.integers(0, 3, 60)] += rng.choice((-0.2, 0.2), 60)
    found = without_outliers(noisy[None], 5.0, 0.005)
    flagged = np.flatnonzero(found.is_outlier)
    assert np.isin(wild, flagged).all()
    assert (flagged.size - np.isin(flagged, wild).sum()) / noisy[..., 0].size < 0.002
    assert np.abs(found.displacement[0] - field).max() < 0.03


@pytest.mark.parametrize("wrong", [(0, 7), (0, 0), (11, 19)])
def test_an_outlier_without_opposite_neighbours_is_left_out(wrong):
    """At a corner, and at an edge beside a lost point, there is no mean of opposite neighbours."""
    rng = np.random.default_rng(3)
    row, column = np.mgrid[0:12, 0:20]
    smooth = np.stack([0.02 * column, 0.001 * row**2, 0.01 * row], axis=-1)
    field = smooth + 0.002 * rng.standard_normal(smooth.shape)
    field[0, 8] = np.nan
    clean = without_outliers(field[None], 5.0, 0.005)
    assert not clean.is_outlier.any()
    field[wrong] += [0.02, 0.1, 0.0]
    found = without_outliers(field[None], 5.0, 0.005)
    assert [tuple(at) for at in np.argwhere(found.is_outlier[0])] == [wrong]
    assert np.isnan(found.displacement[0][wrong]).all()


def test_holes_and_steep_slopes_are_no_outliers():
    field = 10.0 * linear_field()
    field[0, 2:5, 6] = np.nan
    found = without_outliers(field, 5.0, 0.001)
    assert not found.is_outlier.any()
    np.testing.assert_array_equal(np.isnan(found.displacement), np.isnan(field))


def test_points_come_in_any_order_and_number_and_find_their_row_and_column():
    rng = np.random.default_rng(4)
    truth = Truth(angle=0.7, roll=0.8)
    taken = frames(truth, TRAVEL, np.random.default_rng(0))
    shuffled = []
    for frame in taken:
        order = rng.permutation(frame.valid.size)[: frame.valid.size - 7]
        order = order[frame.valid[order]] if frame is not taken[0] else order
        shuffled.append(
            PointFrame(
                frame.name, frame.position[order], frame.displacement[order], frame.valid[order]
            )
        )
    whole, parts = lattice_of(taken, AXES), lattice_of(shuffled, AXES)
    assert parts.spacing == pytest.approx(whole.spacing, rel=1e-6)
    at = lattice_places(whole), lattice_places(parts)
    both = set(at[0]) & set(at[1])
    assert len(both) > 0.97 * len(at[0])
    for key in both:
        np.testing.assert_array_equal(at[0][key], at[1][key])


def lattice_places(lattice):
    """Last displacement by rounded position, where there is one."""
    known = np.isfinite(lattice.displacement[-1, ..., 0])
    places = np.round(lattice.position[known][:, :2], 3)
    return {tuple(p): u for p, u in zip(places, lattice.displacement[-1][known], strict=True)}


def test_points_anywhere_are_no_lattice():
    rng = np.random.default_rng(0)
    position = rng.random((400, 3)) * 10
    frame = PointFrame("a", position, np.ones((400, 3)), np.ones(400, dtype=bool))
    with pytest.raises(ValueError, match="expected points in rows and columns"):
        lattice_of([frame, frame], AXES)


def test_a_point_far_from_the_others_is_refused_before_arrays_fill_the_memory():
    x, y = (c.ravel() for c in np.meshgrid(np.arange(40) * 0.05, np.arange(40) * 0.05))
    position = np.stack([np.append(x, 75.0), np.append(y, 75.0), np.zeros(1601)], axis=1)
    frame = PointFrame("a", position, np.ones((1601, 3)), np.ones(1601, dtype=bool))
    with pytest.raises(ValueError, match=r"found 1601 in 1501 rows and 1501 columns 0\.05 mm"):
        lattice_of([frame, frame], AXES)


def test_background_that_never_moves_is_not_the_sample():
    lattice = of(Truth())
    x = lattice.position[lattice.present()][:, 0] - Truth().origin[0]
    assert np.abs(x).max() <= 5.0 - EDGE + 1e-9


def test_masks_keep_what_is_inside():
    points = np.array([[0.5, 0.5], [1.5, 0.5], [0.9, 0.05], [0.5, 2.0]])
    box = Mask(rectangle_mm=(0.0, 0.0, 1.0, 1.0))
    assert inside(box, points).tolist() == [True, False, True, False]
    triangle = Mask(polygon_mm=((0.0, 0.0), (1.0, 1.0), (0.0, 1.0)))
    assert inside(triangle, points - [0.1, 0.0]).tolist() == [True, False, False, False]
    for corners in (triangle.polygon_mm, triangle.polygon_mm[::-1]):  # edges belong to it
        edges = np.array([[0.0, 0.0], [0.5, 0.5], [0.0, 0.5], [0.5, 1.0], [1.0, 1.0]])
        turned = Mask(polygon_mm=corners)
        assert inside(turned, edges).all()
        assert not inside(turned, edges + np.array([0.01, -0.01]))[[1, 4]].any()
    without_pin = Mask(pin_rectangle_mm=(0.4, 0.4, 0.6, 0.6))
    assert inside(without_pin, points).tolist() == [False, True, True, True]


def test_axes_of_the_file_are_turned_into_ours():
    # a program with y down and z away from the camera
    axes = Axes(x="+x", y="-y", z="-z")
    np.testing.assert_array_equal(axes.matrix @ [1.0, 2.0, 3.0], [1.0, -2.0, -3.0])
    np.testing.assert_array_equal(Axes(x="-z", z="+x").matrix @ [1.0, 2.0, 3.0], [-3.0, 2.0, 1.0])
    with pytest.raises(ValueError, match="each of x, y and z"):
        Axes(x="+z")
