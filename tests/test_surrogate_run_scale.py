"""The factor that all errors of a run share is found from runs left out."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate import Emulator, TrainingSet, held_out_residuals, leave_one_out_residuals
from surrogate.coverage import LEVELS
from surrogate.design import sobol_design
from surrogate.run_scale import FEWEST, RunScale, RunScales, fit_run_scale, mahalanobis_sizes

N_DIM = 5


def _sizes(scale: RunScale, n: int, seed: int) -> np.ndarray:
    """Mahalanobis distances (n,) of errors whose runs have factors of that scale."""
    rng = np.random.default_rng(seed)
    normal = np.linalg.norm(rng.standard_normal((n, N_DIM)), axis=1)
    return normal * np.exp(scale.log_mean + scale.log_std * rng.standard_normal(n))


@pytest.mark.parametrize("scale", [RunScale(0.4, 0.7), RunScale(-0.5, 0.3)], ids=str)
def test_the_scale_that_made_the_errors_is_found(scale: RunScale) -> None:
    """4000 runs: standard errors of 0.013 and 0.011; bounds at five of them."""
    found = fit_run_scale(_sizes(scale, 4000, 1), mahalanobis_sizes(N_DIM))
    assert abs(found.log_mean - scale.log_mean) < 0.065
    assert abs(found.log_std - scale.log_std) < 0.055


def test_normal_errors_have_next_to_no_scale() -> None:
    found = fit_run_scale(_sizes(RunScale(), 4000, 2), mahalanobis_sizes(N_DIM))
    assert abs(found.log_mean) < 0.03 and found.log_std < 0.15


def test_ranks_are_uniform_where_the_scale_is_right() -> None:
    """Largest distance of 4000 ranks from uniform; 1.63 / sqrt(4000) has a false alarm of 1 %."""
    scale = RunScale(0.3, 0.6)
    rank = np.sort(scale.rank(_sizes(scale, 4000, 3), mahalanobis_sizes(N_DIM)))
    assert np.abs(rank - (np.arange(4000) + 0.5) / 4000).max() < 1.63 / np.sqrt(4000)
    wrong = np.sort(RunScale().rank(_sizes(scale, 4000, 3), mahalanobis_sizes(N_DIM)))
    assert np.abs(wrong - (np.arange(4000) + 0.5) / 4000).max() > 0.1


@pytest.mark.parametrize("scale", [RunScale(), RunScale(0.2, 0.5)], ids=str)
@pytest.mark.parametrize("level", [0.5, 0.8, 0.95])
def test_level_is_the_inverse_of_rank(scale: RunScale, level: float) -> None:
    normal = mahalanobis_sizes(N_DIM)
    size = np.array([scale.level(normal[0], level)])
    assert scale.rank(size, normal)[0] == pytest.approx(level, abs=0.006)


def test_few_runs_leave_errors_as_stated() -> None:
    sizes = _sizes(RunScale(1.0, 1.0), FEWEST - 1, 4)
    assert fit_run_scale(sizes, mahalanobis_sizes(N_DIM)) == RunScale()
    assert fit_run_scale(np.zeros(40), mahalanobis_sizes(N_DIM)) == RunScale()


def _runs(x: np.ndarray) -> TrainingSet:
    """Forces and fields that are smooth but for a step of some runs along a line."""
    travel = np.array([0.6, 1.0, 1.4])
    snapped = 0.02 * np.tanh(80.0 * (x[:, :1] + 0.3 * x[:, 1:] - 0.7)) * (travel > 1.2)
    force = 20.0 * np.exp(travel * (1.0 + 0.3 * x[:, :1] + 0.2 * x[:, 1:] ** 2) + snapped)
    shape = np.sin(np.arange(36.0)).reshape(12, 3)
    field = (0.1 * np.log(force) + snapped)[:, :, None, None] * (1.0 + 0.2 * shape)
    return TrainingSet.from_runs(x, force, field, np.ones(len(x), dtype=bool))


def test_left_out_runs_make_the_joint_regions_of_unseen_ones_honest() -> None:
    """Of 300 unseen runs a tenth or so lies at the step, where errors are far from normal."""
    box = np.array([[0.0, 1.0], [0.0, 1.0]])
    train, unseen = _runs(sobol_design(40, box, 5)), _runs(sobol_design(300, box, 6, n_corners=0))
    emulator = Emulator.fit(train, 1)
    left_out = leave_one_out_residuals(emulator, train)
    assert isinstance(left_out.scales, RunScales) and left_out.scales.field.log_std > 0.3
    plain = held_out_residuals(emulator, unseen).errors()
    scaled = held_out_residuals(emulator, unseen, left_out.scales).errors()
    for before, after, share in (
        (plain.force_coverage, scaled.force_coverage, 0.9),
        (plain.field_coverage, scaled.field_coverage, 0.5),
    ):
        assert before is not None and before.joint is not None
        assert after is not None and after.joint is not None
        off = [np.abs(np.subtract(found.joint, LEVELS)).sum() for found in (before, after)]
        assert off[1] < share * off[0]
        assert after.overall == before.overall  # of single values as stated
