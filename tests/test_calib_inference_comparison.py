"""Comparison of hypotheses, predictive draws and the study of assumptions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward

from calib.data import PUBLISHED_CONSTANTS, FieldData, thesis_forces
from calib.inference import (
    HypothesisFit,
    Marginal,
    NoiseSettings,
    Posterior,
    Prior,
    assumption_study,
    build_likelihood,
    check_published,
    compare,
    expected_forces,
    fit_of,
    integrate,
    predictive_forces,
    theta_of,
    theta_of_constants,
)
from calib.inference.comparison import predictive_p_value
from calib.inference.identifiability import with_noise
from calib.inference.verdict import NONE_EXPLAINS

PRIOR = Prior(
    Marginal("log_uniform", 0.003, 0.3), Marginal("uniform", 0, 1), Marginal("uniform", 0, 0.5)
)


def posterior(bend: float = 0.0) -> Posterior:
    forward = AnalyticForward(AnalyticBlock(bend), 0.005)
    like = build_likelihood(thesis_forces(), forward, NoiseSettings(), force_discretisation=0.02)
    return Posterior(PRIOR, like)


POST = posterior()
QUAD = integrate(POST)


def fit(
    name: str, log_evidence: float, p_value: float = 0.5, max_log_likelihood: float = 8.0
) -> HypothesisFit:
    return HypothesisFit(
        name, log_evidence, 0.0, p_value, 0.03, 0.002, max_log_likelihood, best_misfit=5.0
    )


def test_an_evidence_that_is_not_a_number_is_refused() -> None:
    with pytest.raises(ValueError, match="fits: stuck: expected an evidence, found NaN"):
        compare([fit("sliding", 3.0), fit("stuck", float("nan"))])


def test_close_evidences_cannot_be_separated() -> None:
    close = compare([fit("stuck", 1.0), fit("sliding", 3.0)])
    assert "cannot separate sliding, stuck" in close.verdict
    assert close.log_bayes_factors == pytest.approx([0.0, 2.0])
    assert "fits better" not in close.verdict
    split = compare([fit("stuck", 1.0, 0.5, 20.0), fit("sliding", 3.0)])
    assert "stuck fits better than sliding" in split.verdict


def test_forces_that_no_hypothesis_explains_raise_the_question_of_units() -> None:
    assert NONE_EXPLAINS in compare([fit("stuck", 1.0, 1e-90), fit("sliding", 3.0, 1e-14)]).verdict
    assert NONE_EXPLAINS not in compare([fit("stuck", 1.0, 1e-4), fit("sliding", 3.0, 0.0)]).verdict


def test_support_takes_evidence_and_fit() -> None:
    far = compare([fit("stuck", 1.0, 1e-4), fit("sliding", 9.0)])
    assert "data support sliding over stuck" in far.verdict
    assert "contradict stuck" in far.verdict
    assert "compatible with sliding" in far.verdict
    better = compare([fit("stuck", 1.0), fit("sliding", 9.0, 0.5, 12.0)])
    assert "data support sliding over stuck" in better.verdict


@pytest.mark.parametrize(
    ("p_value", "word"),
    [
        (0.0099, "contradict"),
        (0.01, "are hardly compatible with"),
        (0.049, "are hardly compatible with"),
        (0.05, "are compatible with"),
    ],
)
def test_how_well_forces_fit_is_said_by_degrees(p_value: float, word: str) -> None:
    verdict = compare([fit("stuck", 1.0, p_value), fit("sliding", 3.0)]).verdict
    assert f"The forces {word} stuck (predictive p = {p_value:.3g})" in verdict


def test_a_factor_that_the_fit_makes_is_not_called_one_of_the_prior() -> None:
    """Both fit well; all but 0.1 of the ln factor of 3.0 is of the best fits."""
    found = compare([fit("stuck", -3.0, 0.5, -2.9), fit("sliding", 0.0, 0.5, 0.0)])
    assert "only through the prior" not in found.verdict and "equally well" not in found.verdict
    assert "prefer sliding to stuck by a Bayes factor of 20.1" in found.verdict
    assert "18.2 by the best fit, and 1.11 as stuck fits over a smaller share" in found.verdict


def test_a_factor_that_the_prior_makes_is_said_to_be_its_however_small() -> None:
    found = compare([fit("stuck", -3.0, 0.5, -0.1), fit("sliding", 0.05, 0.5, 0.0)])
    assert "equally well" in found.verdict and "only through the prior" in found.verdict


def test_a_large_bayes_factor_at_equal_fit_is_no_support_by_the_data() -> None:
    equal = compare([fit("stuck", -6.47, 0.11, 8.52), fit("sliding", 0.19, 0.17, 8.69)])
    assert "support" not in equal.verdict
    assert "fit sliding and stuck equally well (ln Bayes factor 6.66 ± 0.00" in equal.verdict
    assert "best ln L 8.69 and 8.52)" in equal.verdict
    assert "Bayes factor of 781 only through the prior" in equal.verdict


def test_bayes_factors_beyond_the_range_of_numbers_are_told_by_their_power_of_ten() -> None:
    far = compare([fit("stuck", -6358.9, 1e-4, -6300.0), fit("sliding", 0.0)])
    assert "by a Bayes factor of 10^2762 (ln Bayes factor 6358.90 ± 0.00 numerical" in far.verdict


def test_a_rival_that_fits_better_than_the_best_evidence_is_named() -> None:
    other = compare([fit("stuck", 1.0, 0.5, 14.0), fit("sliding", 9.0)])
    assert "support" not in other.verdict
    assert "The data fit stuck better than sliding" in other.verdict


def test_every_rival_of_the_best_evidence_has_its_sentence() -> None:
    three = compare([fit("a", 9.0), fit("b", 8.0), fit("c", 1.0), fit("d", 0.0, 1e-5)])
    assert "cannot separate a, b" in three.verdict
    assert "fit a and c equally well" in three.verdict
    assert "support a over d" in three.verdict


def test_the_best_likelihood_is_reached_also_in_a_corner_of_the_box() -> None:
    """Against a fine search of the whole box: no point is better, and a corner is reached."""
    like = POST.likelihood
    corner = np.array([[0.03, 0.0, 0.5]])
    force = like.forward.predict(corner).force[0]
    post = replace(POST, likelihood=replace(like, force=force))
    found = fit_of("corner", post, integrate(post))
    rng = np.random.default_rng(4)
    random = theta_of(post.prior.sample(rng, 50_000))
    assert found.max_log_likelihood >= post.likelihood.log_prob(random).max()
    assert found.max_log_likelihood >= post.likelihood.log_prob(corner)[0]


def test_bayes_factor_prefers_the_model_that_made_the_forces() -> None:
    truth = np.array([[0.027, 0.5, 0.1]])
    force = AnalyticForward(AnalyticBlock()).predict(truth).force[0]
    fits = []
    for name, bend in (("right", 0.0), ("wrong", 0.3)):
        post = posterior(bend)
        post = replace(post, likelihood=replace(post.likelihood, force=force))
        fits.append(fit_of(name, post, integrate(post)))
    result = compare(fits)
    assert result.fits[0].name == "right"
    assert not result.fits[0].contradicted
    assert result.fits[1].contradicted
    assert "right: mu" in result.trade_off


def test_p_value_is_that_of_simulated_replicates() -> None:
    """One proportion of 20,000 within 5 SD: false alarm 6e-7 (fixed seed)."""
    rng = np.random.default_rng(0)
    n = 20_000
    weights = QUAD.weights / QUAD.weights.sum()
    theta = theta_of(QUAD.x[rng.choice(len(weights), n, p=weights)])
    like = POST.likelihood
    prediction = like.forward.predict(theta)
    covariance = like.force_covariance(prediction)
    factor = np.linalg.cholesky(covariance)
    noise = np.einsum("mij,mj->mi", factor, rng.standard_normal((n, 5)))
    replicate = np.einsum("mi,mi->m", noise, np.linalg.solve(covariance, noise[:, :, None])[..., 0])
    share = np.mean(replicate > like.force_misfit(theta))
    exact = predictive_p_value(POST, QUAD)
    assert abs(share - exact) < 5 * np.sqrt(exact * (1 - exact) / n)


def test_p_value_of_student_t_forces_is_that_of_simulated_replicates() -> None:
    """One proportion of 20,000 within 5 SD: false alarm 6e-7 (fixed seed).

    Given theta a replicate is normal over the root of chi-square over its freedom.
    """
    rng, n, freedom = np.random.default_rng(1), 20_000, 4.0
    noise = NoiseSettings(force_freedom=freedom)
    forward = AnalyticForward(AnalyticBlock(), 0.005)
    like = build_likelihood(thesis_forces(), forward, noise, force_discretisation=0.02)
    posterior = Posterior(POST.prior, like)
    quadrature = integrate(posterior, 24)
    weights = quadrature.weights / quadrature.weights.sum()
    theta = theta_of(quadrature.x[rng.choice(len(weights), n, p=weights)])
    squares = rng.chisquare(5, n) / (rng.chisquare(freedom, n) / freedom)
    share = np.mean(squares > like.force_misfit(theta))
    exact = predictive_p_value(posterior, quadrature)
    assert abs(share - exact) < 5 * np.sqrt(exact * (1 - exact) / n)


def test_predictive_draws_have_the_covariance_of_the_likelihood() -> None:
    """Five variances within 5 SD: false alarm 3e-6 (fixed seed)."""
    n = 40_000
    x = np.tile([-3.6, 0.4, 0.1], (n, 1))
    draws = predictive_forces(POST.likelihood, x, np.random.default_rng(1))
    prediction = POST.likelihood.forward.predict(theta_of(x[:1]))
    variance = np.diag(POST.likelihood.force_covariance(prediction)[0])
    ratio = draws.var(axis=0) / variance
    assert np.abs(ratio - 1).max() < 5 * np.sqrt(2 / n)
    assert expected_forces(POST.likelihood, x)[-1] == pytest.approx(prediction.force[0])


def test_published_constants_at_the_posterior_mean_are_not_out() -> None:
    c10, c01, c11, _ = QUAD.constants_mean
    check = check_published({"C10": c10, "C01": c01, "C11": c11}, POST, QUAD)
    assert np.abs(list(check.z.values())).max() < 1e-9
    assert check.mahalanobis < 1.0


def test_published_constants_of_the_thesis_lie_far_out_of_a_posterior_near_mu_0_05() -> None:
    check = check_published(PUBLISHED_CONSTANTS, POST, QUAD)
    assert check.constants["mu"] == pytest.approx(2 * (0.02974 + 0.02254))
    assert check.z["mu"] > 5
    assert check.mahalanobis > 5
    assert np.all(check.force > thesis_forces().force_mean)
    assert not check.extrapolated


def test_theta_of_constants_inverts_constants() -> None:
    theta = theta_of_constants(0.03, 0.01, 0.002)
    assert theta == pytest.approx([0.04, 0.25, 0.05])
    with pytest.raises(ValueError, match="positive sum"):
        theta_of_constants(0.01, -0.02, 0.0)


def test_another_zero_of_the_travel_is_that_of_forces_and_field() -> None:
    points = np.random.default_rng(1).random((6, 2)) * 3
    block = AnalyticBlock(points=points)
    clean = block(np.array([0.4, 0.1])).displacement
    field = FieldData(points, clean, np.array([0.01, 0.01, 0.02]), 0.5, 0.3)
    data, forward = replace(thesis_forces(), field=field), AnalyticForward(block, 0.01, True)
    narrow, wide = NoiseSettings(travel_zero_sd=0.0), NoiseSettings(travel_zero_sd=0.05)
    first, second = (build_likelihood(data, forward, noise) for noise in (narrow, wide))
    theta = np.array([[0.02, 0.4, 0.1], [0.03, 0.5, 0.2]])
    changed = with_noise(data, replace(POST, likelihood=first), wide).likelihood
    assert changed.log_prob(theta) == pytest.approx(second.log_prob(theta), rel=1e-12)
    assert np.abs(first.log_prob(theta) - second.log_prob(theta)).min() > 0.1


def test_a_case_s_zero_of_the_travel_takes_the_place_of_the_one_that_the_data_state() -> None:
    stated, smaller = replace(thesis_forces(), travel_zero_sd=0.06), NoiseSettings()
    forward = POST.likelihood.forward
    posterior = replace(POST, likelihood=build_likelihood(stated, forward, smaller))
    case = replace(smaller, travel_zero_sd=0.02)
    known = build_likelihood(thesis_forces(), forward, case)
    theta = np.array([[0.02, 0.4, 0.1], [0.03, 0.5, 0.2]])
    changed = with_noise(stated, posterior, case).likelihood
    assert changed.log_prob(theta) == pytest.approx(known.log_prob(theta), rel=1e-12)


def test_an_unknown_discrepancy_stays_under_other_noise() -> None:
    noise, wide = NoiseSettings(), NoiseSettings(sample_correlation=0.5)
    forward = AnalyticForward(AnalyticBlock(), 0.005)
    unknown = {"force_noise": (0.5, 2.0), "discrepancy": (0.01, 0.3)}
    first, second = (
        build_likelihood(thesis_forces(), forward, settings, unknown=unknown)
        for settings in (noise, wide)
    )
    theta = np.array([[0.02, 0.4, 0.1, 1.2, 0.05], [0.03, 0.5, 0.2, 0.8, 0.2]])
    for settings, like in ((noise, first), (wide, second)):
        changed = with_noise(thesis_forces(), replace(POST, likelihood=first), settings)
        assert changed.likelihood.log_prob(theta) == pytest.approx(like.log_prob(theta), rel=1e-12)


def test_the_base_row_has_the_zero_of_the_travel_that_the_data_state_where_larger() -> None:
    stated = replace(thesis_forces(), travel_zero_sd=0.06)
    settings = NoiseSettings()
    posterior = replace(
        POST, likelihood=build_likelihood(stated, POST.likelihood.forward, settings)
    )
    [row] = assumption_study(stated, posterior, settings, [settings.sample_correlation])
    assert row.travel_zero_sd == 0.06
    found = integrate(posterior, 30)
    assert row.log_evidence == pytest.approx(found.log_evidence, abs=1e-9)
    assert row.constants_sd == pytest.approx(found.constants_sd, rel=1e-9)


@pytest.mark.lasting
def test_study_of_assumptions_has_a_row_each_and_its_base_row_is_the_posterior() -> None:
    settings = NoiseSettings()
    rows = assumption_study(
        thesis_forces(), POST, settings, [0.0, settings.sample_correlation], [0.0, 0.05]
    )
    assert [row.sample_correlation for row in rows] == [0.0, 0.9, 0.9, 0.9]
    assert [row.travel_zero_sd for row in rows] == [0.02, 0.02, 0.0, 0.05]
    assert rows[1].constants_mean == pytest.approx(QUAD.constants_mean, rel=1e-4)
    # An unknown zero of the travel can only widen the posterior of the stiffness.
    assert rows[2].constants_sd[3] < rows[1].constants_sd[3] < rows[3].constants_sd[3]
