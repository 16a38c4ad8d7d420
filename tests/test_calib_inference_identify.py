"""What data say of which combination: Fisher information, profiles, evidence by nested sampling."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward

from calib.data import FieldData, thesis_forces
from calib.inference import (
    Marginal,
    NoiseSettings,
    Posterior,
    Prior,
    build_likelihood,
    integrate,
    theta_of,
    x_of,
)
from calib.inference.data_parts import given, log_likelihood, parts_of
from calib.inference.fisher import (
    fisher_information,
    laplace_covariance,
    observed_information,
    spectrum,
)
from calib.inference.knowledge import _percent, knowledge, n_pieces
from calib.inference.likelihood import Likelihood
from calib.inference.nested import nested
from calib.inference.profile import Profile, profile_likelihood
from fe.response import Array

PRIOR = Prior(
    Marginal("log_uniform", 0.003, 0.3), Marginal("uniform", 0, 1), Marginal("uniform", 0, 0.5)
)
POINTS = np.random.default_rng(1).random((6, 2)) * 3
THETA = np.array([[0.025, 0.4, 0.1]])


def posterior(field: bool = False, error: float = 0.005) -> Posterior:
    forward = AnalyticForward(AnalyticBlock(points=POINTS), error, field)
    data = replace(thesis_forces(), force_mean=forward.predict(THETA).force[0])
    if field:
        clean = forward.block(THETA[0, 1:]).displacement
        noise = np.array([0.01, 0.01, 0.02])
        data = replace(data, field=FieldData(POINTS, clean, noise, 0.5, 0.3))
    return Posterior(
        PRIOR, build_likelihood(data, forward, NoiseSettings(), force_discretisation=0.02)
    )


FORCE, BOTH = posterior(), posterior(True)


def second_differences(post: Posterior, x: np.ndarray) -> np.ndarray:
    """Negative Hessian of the ln likelihood at x."""
    h = 1e-3
    d = x.size
    hessian = np.empty((d, d))
    for i in range(d):
        for j in range(d):
            corners = []
            for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                moved = x.copy()
                moved[i] += a * h
                moved[j] += b * h
                corners.append(moved)
            f = log_likelihood(post, np.array(corners))
            hessian[i, j] = -(f[0] - f[1] - f[2] + f[3]) / (4 * h * h)
    return hessian


@pytest.mark.parametrize("part", ["force", "field", "both"])
def test_fisher_information_is_the_curvature_of_the_likelihood_of_clean_data(part: str) -> None:
    """With errors that do not depend on x; the emulator's and the mesh's do, so they are off."""
    forward = AnalyticForward(AnalyticBlock(points=POINTS), 0.0, True)
    # A zero shift that depends on theta is left: at clean data it only adds its own determinant.
    noise = NoiseSettings(travel_zero_sd=1e-4)
    clean = forward.block(THETA[0, 1:]).displacement
    field = FieldData(POINTS, clean, np.array([0.01, 0.01, 0.02]), 0.5, 0.3)
    data = replace(thesis_forces(), force_mean=forward.predict(THETA).force[0], field=field)
    like = build_likelihood(data, forward, noise)
    x = x_of(THETA)[0]
    post = given(Posterior(PRIOR, like), part)
    curvature = second_differences(post, x)
    expected = fisher_information(like, x, part)
    scale = np.abs(expected).max()
    assert curvature == pytest.approx(expected, abs=2e-3 * scale)
    sd = 1.0 / np.sqrt(np.maximum(np.diag(expected), 1.0))
    observed = observed_information(post, x, sd)
    assert observed == pytest.approx(expected, abs=2e-2 * scale)
    assert np.linalg.eigvalsh(observed).min() > -1e-9 * scale


def test_curvature_next_to_a_wall_across_the_coordinates_is_taken_inside_of_it() -> None:
    """Priors of the constants end along curves in kappa and r, not at bounds."""
    curvature, at = np.array([[4.0, 1.0], [1.0, 9.0]]), np.array([0.5, 0.5])

    def prior(x: np.ndarray) -> np.ndarray:
        return np.where(x.sum(axis=1) < 1.01, 0.0, -np.inf)

    def log_prob(x: np.ndarray) -> np.ndarray:
        return prior(x) - 0.5 * np.einsum("ni,ij,nj->n", x - 0.4, curvature, x - 0.4)

    bounds = np.array([[0.0, 1.0], [0.0, 1.0]])
    walled: Any = SimpleNamespace(
        prior=SimpleNamespace(bounds=bounds, log_prob=prior), log_prob=log_prob
    )
    sd = np.array([0.5, 0.3])
    assert observed_information(walled, at, sd) == pytest.approx(curvature, rel=1e-6)
    with pytest.raises(ValueError, match="expected a point inside of the prior's support"):
        observed_information(walled, at + 0.3, sd)


def test_shared_zero_takes_information_away_exactly_as_by_the_dense_covariance() -> None:
    like = posterior(True, 0.01).likelihood
    x = x_of(THETA)[0]
    prediction, slope = like.forward.predict(THETA), like.forward.jacobian(THETA)
    force = prediction.force.T
    top = like.errors.covariance(force, prediction.force_covariance)[:, :, 0]
    basis = like.forward.field_basis
    n_mode = len(basis.modes)
    modes = basis.modes.reshape(n_mode, -1)
    measured = like.field.covariance.with_patterns(basis.truncation)
    n = modes.shape[1]
    unit = np.eye(n).reshape(n, *basis.offset.shape)
    field_covariance = np.linalg.inv(measured.inner(unit, unit))
    field_covariance += modes.T * prediction.weight_variance[0] @ modes
    u = basis.fields(prediction.weights)[0]
    shift = np.concatenate(
        [
            like.errors.shifts(force)[0, :, 0],
            np.einsum("ij,jpc->ipc", like.field.shifts[0], u).ravel(),
        ]
    )
    dense = np.zeros((5 + n, 5 + n))
    dense[:5, :5], dense[5:, 5:] = top, field_covariance
    dense += np.outer(shift, shift)
    jacobian = np.vstack([slope.force[0], modes.T @ slope.weights[0]])
    rows = {"force": slice(0, 5), "field": slice(5, None), "both": slice(None)}
    for part, chosen in rows.items():
        expected = jacobian[chosen].T @ np.linalg.solve(dense[chosen, chosen], jacobian[chosen])
        found = fisher_information(like, x, part)
        assert found == pytest.approx(expected, rel=1e-7, abs=1e-7 * np.abs(expected).max())


def test_the_field_knows_nothing_of_kappa() -> None:
    field = fisher_information(BOTH.likelihood, x_of(THETA)[0], "field")
    assert np.abs(field[0]).max() < 1e-9 * np.abs(field).max()
    force = fisher_information(BOTH.likelihood, x_of(THETA)[0], "force")
    both = fisher_information(BOTH.likelihood, x_of(THETA)[0], "both")
    # Sharing the zero, force and field together know no less than either, in every direction.
    assert np.linalg.eigvalsh(both - force).min() > -1e-9 * np.abs(both).max()
    assert np.linalg.eigvalsh(both - field).min() > -1e-9 * np.abs(both).max()


def test_spectrum_orders_combinations_of_prior_units() -> None:
    information = np.diag([100.0, 0.01])
    found = spectrum(information, np.array([1.0, 10.0]))
    assert found.information == pytest.approx([100.0, 1.0])
    assert found.directions == pytest.approx(np.eye(2))
    assert found.sd_ratio == pytest.approx([1 / np.sqrt(101), 1 / np.sqrt(2)])


def test_parts_of_data() -> None:
    assert parts_of(FORCE) == ("force",) and parts_of(BOTH) == ("force", "field", "both")
    x = x_of(THETA)
    assert given(BOTH, "force").log_prob(x) != BOTH.log_prob(x)
    moved = x + np.array([1.0, 0, 0])
    field = given(BOTH, "field")
    assert log_likelihood(field, moved) == pytest.approx(log_likelihood(field, x), rel=1e-12)
    with pytest.raises(ValueError, match="no field"):
        given(FORCE, "field")
    with pytest.raises(ValueError, match="no field"):
        fisher_information(FORCE.likelihood, x[0], "field")


def test_profile_is_the_maximum_over_the_other_coordinates() -> None:
    quadrature = integrate(FORCE, 24)
    profile = profile_likelihood(FORCE, 1, quadrature.mean, quadrature.sd, n=9)
    rng = np.random.default_rng(6)
    for value, height in zip(profile.values[::6], profile.log_likelihood[::6], strict=True):
        x = rng.normal(quadrature.mean, 2 * quadrature.sd, size=(20_000, 3))
        x = np.clip(x, *PRIOR.bounds.T)
        x[:, 1] = value
        best = log_likelihood(FORCE, x).max()
        assert height >= best - 1e-6
        assert height <= best + 0.5
    assert profile.drop.min() == 0.0
    low, high = profile.interval
    assert low < THETA[0, 1] < high


def test_interval_of_a_parabola_is_that_of_the_normal() -> None:
    values = np.linspace(-5, 5, 401)
    found = Profile(values, -0.5 * values**2)
    assert found.interval == pytest.approx((-1.96, 1.96), abs=1e-3)
    assert found.open_ends == (False, False)
    flat = Profile(values, 0.0 * values)
    assert flat.open_ends == (True, True)
    assert flat.interval == (-5.0, 5.0)


def test_nested_sampling_agrees_with_quadrature() -> None:
    """Within 4 of its SDs, false alarm 6e-5 (fixed seed); SDs within 25 % (80 live points)."""
    quadrature = integrate(FORCE, 24)
    found = nested(FORCE, np.random.default_rng(0), n_live=80, dlogz=0.1)
    assert abs(found.log_evidence - quadrature.log_evidence) < 4 * found.log_evidence_error
    assert found.log_evidence_error < 0.6
    moments = found.moments
    assert np.all(np.abs(moments.mean - quadrature.mean) < 0.3 * quadrature.sd)
    assert moments.sd == pytest.approx(quadrature.sd, rel=0.25)
    draws = moments.draws(np.random.default_rng(1), 50)
    assert np.isfinite(log_likelihood(FORCE, draws)).all()
    with pytest.raises(ValueError, match="n_live"):
        nested(FORCE, np.random.default_rng(0), n_live=3)


@pytest.mark.lasting
def test_nested_sampling_takes_priors_of_constants_that_a_box_cuts_off() -> None:
    """Within 4 of its SDs of the likelihood's mean over a million draws: false alarm 6e-5."""
    of = (Marginal("uniform", 0.004, 0.012), Marginal("uniform", -0.002, 0.006))
    kappa = Marginal("uniform", 0.002, 0.018)
    cut = Prior(kappa, Marginal("uniform", 0.1, 0.35), law="mooney-rivlin-2", of=of)
    assert cut.log_mass < -0.5

    class Peak:
        def log_prob(self, theta: np.ndarray) -> np.ndarray:
            off = (np.log(theta[:, 0]) - np.log(0.0095)) / 0.1, (theta[:, 1] - 0.3) / 0.1
            return -0.5 * (off[0] ** 2 + off[1] ** 2)

    posterior = Posterior(cut, cast("Likelihood", Peak()))
    found = nested(posterior, np.random.default_rng(2), n_live=100, dlogz=0.05)
    x = cut.sample(np.random.default_rng(3), 1_000_000)
    exact = np.log(np.mean(np.exp(Peak().log_prob(theta_of(x)))))
    assert abs(found.log_evidence - exact) < 4 * found.log_evidence_error
    assert found.log_evidence_error < 0.3
    low, high = cut.bounds.T
    assert ((found.moments.x >= low) & (found.moments.x <= high))[found.moments.weights > 0].all()


def test_laplace_covariance_of_a_normal_density_is_its_own_and_none_where_it_does_not_fall() -> (
    None
):
    covariance = np.array([[4.0, 1.2, 0.0], [1.2, 0.9, 1e-3], [0.0, 1e-3, 1e-4]])
    mean, precision = np.array([-4.0, 0.5, 0.2]), np.linalg.inv(covariance)

    def of(curvature: Array) -> Any:
        def log_prob(x: Array) -> Array:
            return np.asarray(-0.5 * np.einsum("mi,ij,mj->m", x - mean, curvature, x - mean))

        bounds = np.column_stack([mean - 1e3, mean + 1e3])
        return SimpleNamespace(prior=SimpleNamespace(bounds=bounds), log_prob=log_prob)

    sd = np.sqrt(np.diag(covariance))
    found = laplace_covariance(of(precision), mean, sd)
    assert found == pytest.approx(covariance, rel=1e-6)
    ridge = precision.copy()
    ridge[0, 0] = -1.0
    assert laplace_covariance(of(ridge), mean, sd) is None
    assert laplace_covariance(of(np.zeros((3, 3))), mean, sd) is None


@pytest.mark.lasting
def test_all_data_are_told_by_the_posterior_that_was_sampled_and_their_parts_by_the_wide_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The same numbers are compared, whatever the nodes: few are enough."""
    monkeypatch.setattr("calib.inference.knowledge.N_NODES", 12)
    wide, narrow = posterior(True, error=0.05), BOTH
    plain, other, local = (
        knowledge(post, np.random.default_rng(3), 5, sampled)
        for post, sampled in ((wide, None), (wide, narrow), (narrow, None))
    )
    for entry, expected in zip(other.parts, (*plain.parts[:2], local.parts[2]), strict=True):
        np.testing.assert_array_equal(entry.moments.mean, expected.moments.mean)
        np.testing.assert_array_equal(entry.contraction, expected.contraction)
    assert not np.allclose(other.whole.moments.sd, plain.whole.moments.sd, rtol=0.02)
    for k in (0, 1, 2):
        np.testing.assert_array_equal(other.profiles[k].values, local.profiles[k].values)


@pytest.mark.lasting
def test_a_profile_that_leaves_the_box_of_what_was_sampled_is_the_wide_ones() -> None:
    moments = integrate(BOTH)
    box = np.array([[moments.mean[1] - 0.5 * moments.sd[1], 1.0], [0.0, 0.5]])
    cut = replace(BOTH, prior=PRIOR.within(box))
    pieces: list[int] = []
    known = knowledge(BOTH, np.random.default_rng(3), 9, cut, lambda: pieces.append(1))
    assert len(pieces) == n_pieces(BOTH) == 6  # three parts of the data, three profiles
    found = known.profiles[1]
    assert found.values[0] == 0.0 and not found.open_ends[0]


@pytest.mark.parametrize(
    ("ratio", "said"),
    [
        (0.0123, "1.2 %"),
        (0.0996, "10 %"),
        (0.213, "21 %"),
        (0.996, "100 %"),
        (1.02, "no better than 102 %"),
    ],
)
def test_shares_are_told_without_powers_of_ten(ratio: float, said: str) -> None:
    assert _percent(ratio) == said
