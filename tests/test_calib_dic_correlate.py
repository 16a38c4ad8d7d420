"""Subset correlation against exact images: shifts, stretches, gradients, lost points, threads."""

import numpy as np
import pytest

from benchmarks.exact_speckle import exposed, speckle
from calib.dic import (
    CorrelationSettings,
    Reason,
    correlate,
    correlation_length,
    error_correlation,
    follow,
    grid_points,
    prepare,
    rectangle_mask,
    strain,
)
from calib.dic.interpolation import grid_slopes, spline_of, values_at
from calib.dic.noise_response import noise_of_spline
from calib.dic.progress import in_turn
from calib.dic.subset import FACTOR, POWER_A, POWER_B
from calib.dic.warp import compose_inverse

W, H = 160, 120
X, Y = np.arange(float(W)), np.arange(float(H))
NOISE = 2.55


@pytest.fixture(scope="module")
def pattern():
    return speckle(W, H, np.random.default_rng(1))


@pytest.fixture(scope="module")
def spread(pattern):
    return pattern(X, Y).std()


def image(pattern, spread, X=X, Y=Y, noise=NOISE, seed=0):
    return exposed(pattern(X, Y), np.random.default_rng(seed), noise, spread=spread)


def inner_points(step=6, margin=24):
    box = (margin, margin, W - margin, H - margin)
    return grid_points(rectangle_mask((H, W), box), step)[0]


@pytest.mark.parametrize("degree", [3, 5])
def test_spline_of_a_cubic_polynomial_is_the_polynomial(degree):
    rows, columns = np.mgrid[0:40, 0:50] / 10.0

    def polynomial(x, y):
        return 1 + x - 2 * y + 0.3 * x**3 - 0.2 * x**2 * y + 0.5 * y**3

    spline = spline_of(polynomial(columns, rows), degree)
    rng = np.random.default_rng(0)
    # the mirrored border is no polynomial; what it does falls off by 4 a px
    x, y = rng.uniform(18, 31, 200), rng.uniform(18, 21, 200)
    np.testing.assert_allclose(values_at(spline, x, y), polynomial(x / 10, y / 10), atol=2e-5)
    slope_x, slope_y = grid_slopes(spline)
    np.testing.assert_allclose(slope_x[20, 25], (1 + 0.9 * 2.5**2 - 0.4 * 2.5 * 2) / 10, atol=2e-5)
    np.testing.assert_allclose(slope_y[20, 25], (-2 - 0.2 * 2.5**2 + 1.5 * 4) / 10, atol=2e-5)
    assert np.isnan(values_at(spline, np.array([-0.1, 49.1]), np.array([3.0, 3.0]))).all()


@pytest.mark.parametrize("degree", [3, 5])
def test_spline_goes_through_the_pixels_up_to_the_corners(degree):
    grey = np.random.default_rng(0).normal(size=(12, 15))
    rows, columns = np.mgrid[0:12, 0:15].astype(float)
    values = values_at(spline_of(grey, degree), columns.ravel(), rows.ravel())
    np.testing.assert_allclose(values, grey.ravel(), atol=1e-12)


def test_stated_noise_of_the_spline_is_that_of_splined_noise():
    noise = np.random.default_rng(0).normal(size=(300, 300))
    spline = spline_of(noise, 5)
    stated = noise_of_spline(5)
    assert np.var(grid_slopes(spline)[0]) == pytest.approx(stated.slope, rel=0.02)
    rows, columns = (v.ravel() for v in np.mgrid[20:280, 20:280].astype(float))
    between = values_at(spline, columns + 0.5, rows + 0.25)
    assert np.var(between) == pytest.approx(stated.values[32] * stated.values[16], rel=0.02)


@pytest.mark.lasting
def test_step_is_minus_the_gradient_of_the_znssd_by_finite_differences(pattern, spread):
    """One Gauss-Newton step from truth plus a little leads back; the criterion is least there."""
    a = image(pattern, spread, noise=0.0)
    b = image(pattern, spread, X - 0.3, Y + 0.2, noise=0.0)
    point = np.array([[80.0, 60.0]])
    plain = CorrelationSettings(light="constant", glare=0.0)
    found = correlate(a, b, point, plain, guess=[[0.0, 0.0]])
    sub = np.mgrid[-15:16, -15:16].astype(float)
    spline = spline_of(b, 5)

    def znssd(p):
        x = (
            80
            + sub[1]
            + sum(FACTOR[k] * p[k] * sub[1] ** POWER_A[k] * sub[0] ** POWER_B[k] for k in (0, 2, 3))
        )
        y = (
            60
            + sub[0]
            + sum(FACTOR[k] * p[k] * sub[1] ** POWER_A[k] * sub[0] ** POWER_B[k] for k in (1, 4, 5))
        )
        g = values_at(spline, x.ravel(), y.ravel())
        f = a[45:76, 65:96].ravel()
        f, g = f - f.mean(), g - g.mean()
        return np.sum((f / np.linalg.norm(f) - g / np.linalg.norm(g)) ** 2)

    least = found.parameters[0]
    assert 1 - znssd(least) / 2 == pytest.approx(found.zncc[0], abs=1e-6)
    scale = np.array([1, 1, 1 / 15, 1 / 15, 1 / 15, 1 / 15])
    h = 1e-3
    for k in range(6):
        e = np.zeros(6)
        e[k] = h * scale[k]
        slope = (znssd(least + e) - znssd(least - e)) / (2 * h)
        bend = (znssd(least + e) - 2 * znssd(least) + znssd(least - e)) / h**2
        assert abs(slope / bend) < 2e-3


@pytest.mark.parametrize("order", [1, 2])
def test_rigid_shift_is_found_with_the_stated_deviation(pattern, spread, order):
    points = inner_points()
    shift = np.array([2.3, -1.6])
    found = correlate(
        image(pattern, spread),
        image(pattern, spread, X - shift[0], Y - shift[1], seed=1),
        points,
        CorrelationSettings(order=order),
    )
    assert found.valid.all()
    error = found.displacement - shift
    # some 15 independent subsets
    assert np.abs(error.mean(axis=0)).max() < 3 * found.sigma.mean() / np.sqrt(15)
    assert np.std(error / found.sigma) == pytest.approx(1.0, abs=0.2)


def test_stretch_is_found_with_its_gradient(pattern, spread):
    points = inner_points()
    stretch = np.array([1.05, 0.6])
    a = image(pattern, spread)
    b = image(pattern, spread, X / stretch[0], Y / stretch[1], seed=1)
    found = correlate(a, b, points)
    on = points * stretch
    inside = (on < [W - 17, H - 17]).all(axis=1)
    assert inside.sum() > 50
    assert found.valid[inside].all()
    error = (found.displacement - points * (stretch - 1))[inside]
    assert np.sqrt(np.mean(error**2)) < 0.02
    np.testing.assert_allclose(
        np.median(found.gradient[inside], axis=0), np.diag(stretch - 1), atol=2e-3
    )


def test_order_two_follows_a_bent_field_where_order_one_is_biased(pattern, spread):
    bend = 0.0008
    points = inner_points(step=10)
    a = image(pattern, spread)
    # x = X + bend (X - 80)² / 2, solved for X
    back = 80 + (np.sqrt(1 + 2 * bend * (X - 80)) - 1) / bend
    b = image(pattern, spread, back, Y, seed=1)
    truth = bend * (points[:, 0] - 80) ** 2 / 2
    bias = [
        np.nanmean(
            correlate(a, b, points, CorrelationSettings(order=order)).displacement[:, 0] - truth
        )
        for order in (1, 2)
    ]
    # the mean of the parabola over the subset, bend R²/6
    assert bias[0] == pytest.approx(bend * 15.5**2 / 6, rel=0.2)
    assert abs(bias[1]) < 0.005


def test_composition_with_the_inverse_of_a_map_gives_the_identity_back():
    p = np.array([0.4, -0.2, 0.1, 0.02, -0.03, -0.2, 1e-3, -2e-3, 5e-4, 0.0, 1e-3, 2e-3])
    same = p.copy()
    assert compose_inverse(same, p)
    # second-order terms of the inverse are exact about its zero, which is off by p[:2]
    np.testing.assert_allclose(same[2:6], 0.0, atol=2e-3)
    np.testing.assert_allclose(same[:2], 0.0, atol=1e-3)
    affine = np.append(p[:6], np.zeros(6))
    same = affine.copy()
    assert compose_inverse(same, affine)
    np.testing.assert_allclose(same, 0.0, atol=1e-15)


def test_same_bits_for_any_number_of_threads(pattern, spread):
    points = inner_points(step=4)
    a, b = image(pattern, spread), image(pattern, spread, X - 0.4, Y, seed=1)
    one, two = (correlate(a, b, points, CorrelationSettings(threads=threads)) for threads in (1, 3))
    for name in ("displacement", "gradient", "zncc", "sigma", "reason", "iterations"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_points_between_pixels_are_on_the_field_of_those_around(pattern, spread):
    points = inner_points(step=9) + np.array([0.37, -0.44])
    a = image(pattern, spread, noise=0.0)
    b = image(pattern, spread, X / 1.02, Y, noise=0.0, seed=1)
    found = correlate(a, b, points, guess=points * [0.02, 0.0])
    np.testing.assert_allclose(found.displacement, points * [0.02, 0.0], atol=5e-3)


def test_lost_points_say_why(pattern, spread):
    a = image(pattern, spread)
    b = image(pattern, spread, X - 8.0, Y, seed=1)
    a[:, 100:] = 128.0  # without speckle, and without noise
    b[:60, :70] = np.random.default_rng(3).normal(128, 40, (60, 70))  # covered
    points = np.array([[40.0, 30], [130, 60], [60, 90], [156, 100], [500, 50]])
    found = correlate(a, b, points, guess=np.tile([8.0, 0.0], (5, 1)))
    assert [Reason(code) for code in found.reason] == [
        Reason.LOW_CORRELATION,
        Reason.NO_SPECKLE,
        Reason.VALID,
        Reason.NO_SPECKLE,
        Reason.OUTSIDE_REGION,
    ]
    assert np.isnan(found.displacement[~found.valid]).all()
    away = correlate(image(pattern, spread), b, [[150.0, 90.0]], guess=[[8.0, 0.0]])
    assert Reason(away.reason[0]) == Reason.LEFT_IMAGE


@pytest.mark.parametrize("threads", [1, 2])
def test_parts_of_a_region_that_no_neighbour_leads_to_are_found_too(pattern, spread, threads):
    """A bar, and three patches away from it, each of another place in the order of points."""
    a, b = image(pattern, spread), image(pattern, spread, X - 6.5, Y + 3.2, seed=1)
    mask = np.zeros((H, W), dtype=bool)
    mask[10:45, 10:150] = True
    for left in (10, 62, 114):
        mask[74:110, left : left + 36] = True
    points, _ = grid_points(mask, 6)
    settings = CorrelationSettings(threads=threads)
    found = correlate(a, b, points, settings, mask=mask)
    x, y = points.astype(int).T
    assert set(found.reason[~mask[y, x]]) == {Reason.OUTSIDE_REGION}
    assert Reason.NOT_REACHED not in found.reason
    for left in (10, 62, 114):
        part = (y >= 74) & (x >= left) & (x < left + 36) & mask[y, x]
        assert found.valid[part].mean() > 0.9
        assert found.displacement[part & found.valid] == pytest.approx(
            np.tile([6.5, -3.2], (np.count_nonzero(part & found.valid), 1)), abs=0.2
        )


def test_a_point_outside_the_mask_is_lost_however_much_of_its_subset_is_inside(pattern, spread):
    a, b = image(pattern, spread), image(pattern, spread, X - 1.5, seed=1)
    mask = rectangle_mask((H, W), (0, 0, 80, H))
    points = np.array([[78.0, 60], [79, 60], [80, 60], [84, 60]])
    found = correlate(a, b, points, mask=mask)
    assert list(found.reason) == [0, 0, Reason.OUTSIDE_REGION, Reason.OUTSIDE_REGION]


def test_points_with_a_wrong_guess_are_reached_from_their_neighbours_all_the_same(pattern, spread):
    """As in a series, where every point has a guess from the frame before."""
    a, b = image(pattern, spread), image(pattern, spread, X - 1.5, seed=1)
    points = inner_points(step=12)
    guess = np.tile([1.5, 0.0], (len(points), 1))
    guess[[8, 20]] = [-12.0, 9.0]
    found = correlate(a, b, points, guess=guess)
    assert found.valid.all()
    assert np.abs(found.displacement - [1.5, 0.0]).max() < 0.1


def test_uneven_light_and_a_bright_scratch_do_not_move_points(pattern, spread):
    points = inner_points()
    a = image(pattern, spread)
    b = image(pattern, spread, X - 0.3, Y, seed=1) * 0.7 + 0.25 * X
    b[50:75, 78:81] = 255.0
    found = correlate(a, b, points)
    assert found.valid.all()
    error = found.displacement - [0.3, 0.0]
    assert np.std(error / found.sigma) < 1.3
    plain = correlate(a, b, points, CorrelationSettings(light="constant", glare=0.0))
    assert np.nanstd(plain.displacement - [0.3, 0.0]) > 2 * np.std(error)


def test_block_is_followed_to_sixty_per_cent_compression(pattern, spread):
    points = inner_points(step=12)
    a = image(pattern, spread)
    frames, truth = [], []
    for share in (0.2, 0.4, 0.6):
        flat = 1 - share
        frames.append(image(pattern, spread, X, (Y - H) / flat + H, seed=int(10 * share)))
        truth.append(np.column_stack([np.zeros(len(points)), (points[:, 1] - H) * (flat - 1)]))
    results = list(follow(prepare(a, 5), frames, points, CorrelationSettings()))
    for found, moved in zip(results, truth, strict=True):
        # the subsets of the lowest row may hang out of the image
        assert found.valid.mean() > 0.8
        assert np.sqrt(np.nanmean((found.displacement - moved) ** 2)) < 0.03


@pytest.mark.lasting
def test_points_lost_by_the_first_image_go_on_from_a_later_one(pattern, spread):
    other = speckle(W, H, np.random.default_rng(9))
    points = inner_points(step=12)

    def seen(share, shift, seed):
        brightness = (1 - share) * pattern(X - shift, Y) + share * other(X - shift, Y)
        return exposed(brightness, np.random.default_rng(seed), NOISE, spread=spread)

    # the surface changes little by little into another
    frames = [seen(share, 0.25 * k, k) for k, share in enumerate(np.linspace(0.125, 1, 8), 1)]
    *_, last = follow(prepare(seen(0, 0, 0), 5), frames, points, CorrelationSettings())
    assert last.valid.mean() > 0.95
    # what is new of the surface pulls, the more the longer: a fraction of a speckle of 5 px
    assert np.sqrt(np.nanmean((last.displacement - [2.0, 0.0]) ** 2)) < 0.5
    direct = correlate(seen(0, 0, 0), frames[-1], points, guess=np.tile([2.0, 0], (len(points), 1)))
    assert direct.valid.mean() < 0.05


def test_errors_of_overlapping_subsets_correlate_as_stated(pattern, spread):
    points = inner_points(step=1, margin=40)[:400]
    settings = CorrelationSettings(subset=21, glare=0.0)
    first, shape = [], (10, 40)
    points = np.stack(np.meshgrid(np.arange(40.0, 80.0), np.arange(40.0, 50.0)), -1).reshape(-1, 2)
    clean = image(pattern, spread, noise=0.0)
    guess = np.zeros((400, 2))
    for seed in range(40):
        rng = np.random.default_rng(100 + seed)
        a, b = (clean + rng.normal(0, NOISE, clean.shape) for _ in range(2))
        first.append(correlate(a, b, points, settings, guess).displacement[:, 0].reshape(shape))
    errors = np.array(first) - np.mean(first, axis=0)
    for distance in (5, 10, 15):
        pairs = errors[:, :, :-distance] * errors[:, :, distance:]
        measured = pairs.mean() / np.mean(errors**2)
        stated = error_correlation(settings, np.array(float(distance)), np.array(0.0))
        assert stated == pytest.approx(1 - distance / 21)
        assert measured == pytest.approx(stated, abs=0.12)


@pytest.mark.parametrize(("order", "subset"), [(1, 21), (2, 31)])
def test_the_length_of_an_exponential_holds_as_much_correlation_as_overlapping_subsets(
    order, subset
):
    settings = CorrelationSettings(subset=subset, order=order)
    apart = np.arange(-subset, subset + 1.0)
    held = error_correlation(settings, apart, apart[:, None]).sum()
    assert 2 * np.pi * correlation_length(settings) ** 2 == pytest.approx(held, rel=1e-9)
    if order == 1:
        assert correlation_length(settings) == pytest.approx(subset / np.sqrt(2 * np.pi))


def test_strain_of_a_linear_field_is_exact():
    points = inner_points(step=5)
    gradient = np.array([[0.2, 0.1], [-0.05, -0.3]])
    u = points @ gradient.T + [3.0, 4.0]
    u[7] = np.nan
    F = gradient + np.eye(2)
    green = strain(points, u, 12.0)
    np.testing.assert_allclose(green.gradient[8], gradient, atol=1e-12)
    assert np.isnan([green.xx[7], green.yy[7], green.xy[7]]).all()  # as on a surface in space
    E = (F.T @ F - np.eye(2)) / 2
    np.testing.assert_allclose(
        [green.xx[9], green.yy[9], green.xy[9]], [E[0, 0], E[1, 1], E[0, 1]], atol=1e-12
    )
    log = strain(points, u, 12.0, order=2, measure="log")
    assert log.xx[9] + log.yy[9] == pytest.approx(np.log(np.linalg.det(F)))


def test_progress_of_correlations_in_turn_is_that_of_one():
    told = []
    following = in_turn(lambda done, total: told.append((done, total)), least=8)
    first = following()
    first(0, 4)
    first(4, 4)
    second = following()
    second(0, 4)
    second(3, 6)
    assert told == [(0, 8), (4, 8), (4, 8), (7, 10)]
    assert in_turn(None)() is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"subset": 30}, "subset: expected an odd number of px, 7 to 255, found 30"),
        ({"order": 3}, "order: expected 1 or 2, found 3"),
        ({"degree": 4}, "degree: expected 3 or 5, found 4"),
        ({"min_zncc": 1.0}, "min_zncc: expected 0 or more and below 1, found 1.0"),
        ({"glare": 1.0}, "glare: expected 0, or 2 or more, found 1.0"),
    ],
)
def test_settings_out_of_range_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        CorrelationSettings(**change)


def test_arrays_of_wrong_shape_are_refused():
    grey = np.zeros((50, 60))
    with pytest.raises(ValueError, match=r"points: expected shape \(n, 2\)"):
        correlate(grey, grey, np.zeros((3, 3)))
    with pytest.raises(
        ValueError, match=r"guess: expected shape \(2, 2, 6 or 12\), found \(2, 3\)"
    ):
        correlate(grey, grey, np.zeros((2, 2)), guess=np.zeros((2, 3)))
    with pytest.raises(ValueError, match="reference: expected a grey image"):
        correlate(np.zeros((5, 5, 3)), grey, np.zeros((1, 2)))
    with pytest.raises(ValueError, match="deformed: expected finite grey values"):
        correlate(grey, grey * np.nan, np.zeros((1, 2)))


@pytest.mark.parametrize("cut", [(1, 1), (60, 0)], ids=["a pixel less", "half as high"])
def test_the_deformed_image_may_be_smaller_than_the_reference(pattern, spread, cut):
    reference = image(pattern, spread)
    small = image(pattern, spread, X=X - 1.5, seed=1)[: H - cut[0], : W - cut[1]]
    points = inner_points(step=12)
    found = correlate(reference, small, points)
    inside = points[:, 1] < H - cut[0] - 30
    assert inside.any() and found.valid[inside].all()
    assert found.displacement[inside] == pytest.approx(
        np.array([[1.5, 0.0]] * inside.sum()), abs=0.1
    )


def test_strains_and_grids_that_are_none_are_refused():
    points = np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    with pytest.raises(ValueError, match="measure: expected one of green, log, engineering"):
        strain(points, points, 2.5, measure="Green")
    with pytest.raises(ValueError, match="order: expected 1 or 2, found 3"):
        strain(points, points, 2.5, order=3)
    with pytest.raises(ValueError, match="mask: expected one pixel or more"):
        grid_points(np.zeros((4, 4), dtype=bool), 2)
    with pytest.raises(ValueError, match="step: expected 1 px or more, found -3"):
        grid_points(np.ones((4, 4), dtype=bool), -3)
