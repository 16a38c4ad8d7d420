"""Points whose reference is renewed: region, deformation and variance of both steps."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from benchmarks.exact_speckle import exposed, speckle
from calib.dic import CorrelationSettings, correlate, follow, grid_points, prepare, rectangle_mask

W, H = 200, 160
X, Y = np.arange(float(W)), np.arange(float(H))
CENTRE = np.array([W / 2, H / 2])
GRID = np.stack(np.meshgrid(X, Y), axis=-1)


@pytest.fixture(scope="module")
def surfaces():
    """Two patterns, a surface that becomes another, and a third that stays behind it."""
    return [speckle(W, H, np.random.default_rng(seed)) for seed in (1, 2, 3)]


def deformed(brightness, F):
    """A brightness (h, w) deformed about the centre, by splines."""
    x, y = (np.linalg.inv(F) @ (GRID.reshape(-1, 2) - CENTRE).T) + CENTRE[:, None]
    return map_coordinates(brightness, [y, x], order=5, mode="mirror").reshape(H, W)


def seen(brightness, seed):
    return exposed(brightness, np.random.default_rng(seed), 2.0, spread=brightness.std())


def test_a_renewed_reference_sees_the_region_alone(surfaces):
    """A surface that slides over still ground and changes: points at its edge do not see that."""
    first, second, ground = (pattern(X, Y) for pattern in surfaces)
    region = rectangle_mask((H, W), (20, 20, 100, 140))
    points, _ = grid_points(region, 8)
    settings = CorrelationSettings(subset=31)

    def frame(angle, shift, seed):
        surface = np.cos(angle) * first + np.sin(angle) * second
        moved = np.roll(surface, shift, axis=1)
        return seen(np.where(100 + shift > X, moved, ground), seed)

    frames = [frame(np.radians(22.0 * k), 3 * k, k) for k in (1, 2, 3)]
    ready = prepare(frame(0.0, 0, 0), 5, region)
    *_, last = follow(ready, frames, points, settings)
    edge = points[:, 0] > 85
    assert last.valid[edge].mean() > 0.6
    error = (last.displacement - [9.0, 0.0])[edge & last.valid]
    assert abs(np.median(error[:, 0])) < 0.15  # -0.20 px, 47 % valid, where the ground counts


def test_two_steps_are_one_deformation_with_the_variance_of_both(surfaces):
    first, second, _ = (pattern(X, Y) for pattern in surfaces)
    turn = np.array([[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]])
    stretch = np.diag([1.2, 0.88])

    def frame(degrees, F, seed):
        angle = np.radians(degrees)
        return seen(deformed(np.cos(angle) * first + np.sin(angle) * second, F), seed)

    start, middle, end = (
        frame(0, np.eye(2), 0), frame(25, turn, 1), frame(50, stretch @ turn, 2)
    )  # fmt: skip
    points, _ = grid_points(rectangle_mask((H, W), (60, 50, 140, 110)), 10)
    settings = CorrelationSettings(subset=41, min_zncc=0.7)
    one, both = follow(prepare(start, 5), [middle, end], points, settings)
    assert one.valid.mean() > 0.8 and both.valid.mean() > 0.7
    assert correlate(start, end, points, settings).valid.mean() < 0.1
    F = np.eye(2) + np.median(both.gradient[both.valid], axis=0)
    # 0.064 off in the other order
    np.testing.assert_allclose(F, stretch @ turn, atol=0.02)
    has = one.valid
    step = correlate(middle, end, (points + one.displacement)[has], settings)
    kept = both.valid[has] & step.valid
    assert kept.mean() > 0.7
    expected = np.hypot(one.sigma[has], step.sigma)[kept]
    np.testing.assert_allclose(both.sigma[has][kept], expected, rtol=1e-6)
