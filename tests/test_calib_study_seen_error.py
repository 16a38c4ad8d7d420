"""Errors that an emulator was seen to make move the posterior's mean as it is foretold."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib.data import thesis_forces
from calib.inference import Marginal, NoiseSettings, Posterior, Prior, build_likelihood
from calib.inference.forward import Jacobian, Prediction
from calib.inference.quadrature import integrate
from calib.study.seen_error import _Exact, _seen, _shares, _with_one
from fe.response import Array
from surrogate import Residuals

PRIOR = Prior(
    Marginal("log_uniform", 0.001, 0.1), Marginal("uniform", 0.0, 1.0), law="mooney-rivlin-2"
)
SHAPE = np.array([120.0, 180.0, 260.0, 370.0, 510.0])


@dataclass(frozen=True)
class Forces:
    """kappa times a shape that turns with r; `error` (2,) is relative: its value and slope in r."""

    error: tuple[float, float] = (0.0, 0.0)
    variance: float = 0.0

    field_basis: None = None

    def predict(self, theta: Array) -> Prediction:
        at = theta[:, 1:]
        turned = SHAPE * (1.0 + at * np.linspace(0.0, 0.4, 5))
        wrong = 1.0 + (self.error[0] + self.error[1] * (at - 0.5)) * np.linspace(-1.0, 1.0, 5)
        force = theta[:, :1] * turned * wrong
        covariance = self.variance * force[:, :, None] * force[:, None, :] * np.eye(5)
        return Prediction(force, covariance if self.variance else None)

    def jacobian(self, theta: Array) -> Jacobian:
        raise NotImplementedError


def draws_and_likelihood(forward: Forces) -> tuple[Array, Posterior, Array]:
    data = thesis_forces()
    model = Forces().predict(np.array([[0.012, 0.5]])).force[0]
    data = replace(data, force_mean=model, force_sd=0.02 * model)
    likelihood = build_likelihood(
        data,
        forward,
        NoiseSettings(load_cell_sd=0.0, sample_correlation=0.0, travel_zero_sd=0.0),
    )
    posterior = Posterior(PRIOR, likelihood)
    found = integrate(posterior)
    rng = np.random.default_rng(2)
    x = found.x[rng.choice(len(found.weights), 20_000, p=found.weights)]
    return x, posterior, found.mean


def residuals(places: Array, forward: Forces) -> Residuals:
    """Errors of an emulator at runs of ratio `places` (k,)."""
    theta = np.column_stack([np.ones(len(places)), places])
    force = Forces().predict(theta).force
    error = forward.predict(theta).force - force
    return Residuals(force, error, np.zeros((len(places), 5, 5)), None, None, None)


@pytest.mark.parametrize("error", [(0.001, 0.0), (0.001, 0.02)])
def test_errors_linear_over_the_posterior_are_foretold_to_move_its_mean_as_they_do(
    error: tuple[float, float],
) -> None:
    wrong = Forces(error)
    x, posterior, mean = draws_and_likelihood(wrong)
    _, _, right = draws_and_likelihood(Forces())
    centre, scale = x[:, 1].mean(), x[:, 1].std()
    z = np.linspace(-2.5, 2.5, 6)
    told = residuals(centre + scale * z, wrong)
    chosen = np.ones(6, dtype=np.bool_)
    exact = _Exact.of(posterior.likelihood, wrong, x, told, chosen)  # type: ignore[arg-type]
    weight = _shares(exact.base - posterior.likelihood.log_prob(exact.theta))
    np.testing.assert_allclose(weight, 1.0 / len(x), rtol=1e-6)  # no error is stated

    def moved(part: Array) -> Array:
        shift: Array = (exact.weight_without(part, weight) @ x - x.mean(axis=0)) / x.std(axis=0)
        return shift

    found = _seen(z[:, None], (x[:, 1:] - centre) / scale, moved, 2)
    expected = np.abs(right - mean) / x.std(axis=0)
    assert expected.max() > 0.05  # they matter
    np.testing.assert_allclose(found, expected, atol=0.03)


def test_errors_that_differ_from_run_to_run_count_less_the_more_there_are() -> None:
    rng = np.random.default_rng(3)
    draws = rng.normal(size=(2000, 1))

    def seen(k: int) -> float:
        errors = rng.normal(size=k)
        z = np.linspace(-2.0, 2.0, k)[:, None]
        return float(_seen(z, draws, lambda part: np.array([(part @ errors).mean()]), 1)[0])

    few, many = (np.mean([seen(k) for _ in range(40)]) for k in (6, 24))
    assert many < 0.65 * few
    assert few > 0.3


def test_where_no_run_is_near_nothing_is_said_and_few_runs_count_in_full() -> None:
    draws = np.zeros((10, 2))
    assert np.isnan(_seen(np.zeros((0, 2)), draws, lambda _: np.ones(3), 3)).all()
    found = _seen(np.zeros((2, 2)), draws, lambda part: np.array([3.0, 4.0]) @ part[0][:, None], 1)
    assert found == pytest.approx([np.sqrt(12.5)])
    assert _with_one(draws).shape == (10, 3)
