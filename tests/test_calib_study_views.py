"""A planned block seen from its faces: the front as the model sees it, the side as it must be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.inference import theta_of, x_of
from calib.inference.planned import FirstOrderForward
from calib.study.views import FAR, GRID, run_with_views, similar, together
from fe import BlockPin, BlockPinModel, Contact

RATIOS = np.array([0.3, 0.1])
MODEL = BlockPinModel(BlockPin(), Contact("slide", "slide"), (5, 2, 2), (0.2, 0.4))


@pytest.fixture(scope="module")
def run():
    return run_with_views(MODEL, RATIOS)


def test_the_front_is_what_the_model_itself_reports(run) -> None:
    response = replace(MODEL, field_grid=GRID)(RATIOS)
    front = run.faces["front"]
    assert front.points == pytest.approx(response.points)
    assert front.displacement == pytest.approx(response.displacement, abs=1e-9)
    assert front.gradient == pytest.approx(response.displacement_gradient, abs=1e-7)
    assert run.force == pytest.approx(response.force, rel=1e-9)
    assert run.force_gradient == pytest.approx(response.force_gradient, rel=1e-6)


def test_the_side_bulges_towards_its_camera_and_moves_along_itself_from_the_middle(run) -> None:
    side = run.faces["side"]
    assert side.points[:, 0].max() < 5.0 and side.points[:, 1].max() < 2.5
    towards = side.displacement[-1, :, 2]
    assert towards.mean() > 0.0
    along = np.abs(side.displacement[-1, :, 0])
    assert along[side.points[:, 0] < 0.2].max() < 0.1 * along.max()


def test_a_similar_block_needs_no_run(run) -> None:
    scale = 0.4
    law = MODEL.penalty
    small = replace(
        MODEL,
        specimen=BlockPin(width=4.0, depth=4.0, height=1.0, pin_width=1.6, pin_fillet=0.3 * scale),
        travel=tuple(scale * t for t in MODEL.travel),
        penalty=replace(law, stiffness=law.stiffness / scale, ramp=law.ramp * scale),
    )
    expected, found = run_with_views(small, RATIOS), similar(run, scale)
    assert found.force == pytest.approx(expected.force, rel=2e-3)
    assert found.faces["front"].points == pytest.approx(expected.faces["front"].points)
    size = np.abs(expected.faces["front"].displacement).max()
    assert found.faces["front"].displacement == pytest.approx(
        expected.faces["front"].displacement, abs=5e-3 * size
    )


def test_two_cameras_share_no_noise(run) -> None:
    both = together(run, ("front", "side"))
    n = GRID[0] * GRID[1]
    assert both.displacement.shape == (2, 2 * n, 3) and both.gradient.shape == (2, 2 * n, 3, 2)
    assert both.points[n:, 0].min() - both.points[:n, 0].max() > FAR / 2


def test_a_law_without_c11_is_seen_at_s_zero_with_derivatives_by_r_alone() -> None:
    two, three = run_with_views(MODEL, RATIOS[:1]), run_with_views(MODEL, np.array([0.3, 0.0]))
    assert np.array_equal(two.force, three.force)
    assert np.array_equal(two.force_gradient, three.force_gradient[:, :1])
    front = two.faces["front"], three.faces["front"]
    assert np.array_equal(front[0].displacement, front[1].displacement)
    assert np.array_equal(front[0].gradient, front[1].gradient[..., :1])
    forward = FirstOrderForward(
        two.ratios, two.force, two.force_gradient, front[0].displacement, front[0].gradient
    )
    theta = np.array([[0.02, 0.31]])
    step = theta_of(x_of(theta) + np.array([[1e-5, 1e-5]])), theta_of(x_of(theta) - 1e-5)
    up, down = (forward.predict(at) for at in step)
    slope = forward.jacobian(theta)
    assert slope.force[0].sum(axis=1) == pytest.approx((up.force - down.force)[0] / 2e-5)
    assert up.weights is not None and down.weights is not None and slope.weights is not None
    assert slope.weights[0].sum(axis=1) == pytest.approx((up.weights - down.weights)[0] / 2e-5)
