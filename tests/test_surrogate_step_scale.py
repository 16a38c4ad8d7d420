"""Each load step is measured by how well it can be foretold: a rough one leaves others alone."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate.coordinates import Chosen
from surrogate.design import unit_design
from surrogate.modal import fit_modal
from surrogate.step_scale import step_scale

pytestmark = pytest.mark.lasting

ROUGH = 0.02
CHOSEN = Chosen(np.zeros(2), "rbf", np.arange(0))


def _steps(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n, 2, 30): a smooth step, and one of the same size that is rough from run to run."""
    place = np.linspace(0.0, 3.0, 30)
    smooth = np.sin(place + x[:, :1] + 0.5 * x[:, 1:]) + 0.1 * place * x[:, :1] ** 2
    shape = np.cos(np.outer(np.arange(1, 6), place))
    return np.stack([smooth, smooth + ROUGH * rng.normal(size=(len(x), 5)) @ shape], axis=1)


def test_scales_are_as_the_errors_that_steps_are_foretold_with() -> None:
    """The rough step of the second set is ten times as rough; the smooth one is what it was."""
    x = unit_design(24, 2, 0)
    once, much = _steps(x, np.random.default_rng(1)), _steps(x, np.random.default_rng(1))
    much[:, 1] += 9.0 * (much[:, 1] - much[:, 0])
    first, second = (step_scale(x, y, None, CHOSEN) for y in (once, much))
    assert first[1] == second[1] == 1.0 and first[0] < 0.01
    np.testing.assert_allclose(second[0], 0.1 * first[0], rtol=0.3)


def test_the_roughness_of_one_step_does_not_get_into_another() -> None:
    """Error of the smooth step at new points: below 1 % of what one scale for both leaves."""
    x, new = unit_design(24, 2, 0), np.random.default_rng(2).uniform(size=(40, 2))
    y = _steps(x, np.random.default_rng(1)).reshape(24, -1)
    truth = _steps(new, np.random.default_rng(3))[:, 0]
    errors = []
    for n_step in (1, 2):
        modal = fit_modal(x, y, 1, n_step=n_step, n_restarts=0)
        found = modal.pod.reconstruct(modal.processes.mean(new))[:, :30]
        errors.append(np.sqrt(np.mean((found - truth) ** 2)))
    assert errors[1] < 0.01 * errors[0]


def test_a_step_that_is_the_same_in_all_runs_is_left_as_it_is() -> None:
    x = unit_design(12, 2, 0)
    y = _steps(x, np.random.default_rng(1))
    y[:, 0] = 0.5
    assert step_scale(x, y, None, CHOSEN)[0] == 1.0
    modal = fit_modal(x, y.reshape(12, -1), 1, n_step=2, n_restarts=0, sharing="all")
    np.testing.assert_allclose(modal.predict(x)[0][:, :30], 0.5, atol=1e-12)


def test_a_step_that_is_foretold_to_rounding_keeps_a_share_of_its_variation() -> None:
    """Two steps in proportion to an input, one a thousandth of the other."""
    x = unit_design(24, 2, 0)
    shape = np.outer(x[:, 0], np.linspace(1.0, 2.0, 30))
    y = np.stack([shape, 1e-3 * shape], axis=1)
    np.testing.assert_allclose(step_scale(x, y, None, CHOSEN), [1.0, 1e-3], rtol=1e-6)
