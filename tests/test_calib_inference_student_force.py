"""Student-t forces: equal to SciPy's multivariate t and to dense integrals, robust to outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward
from scipy.integrate import quad
from scipy.special import logsumexp
from scipy.stats import gamma, multivariate_normal, multivariate_t

from calib.data import FieldData, thesis_forces
from calib.inference import Likelihood, NoiseSettings, build_likelihood
from calib.inference.prediction import predictive_forces
from calib.inference.shared_error import AlongError
from calib.inference.student_force import ForceDensity, information_share, student_marginal
from fe.response import Array

POINTS = np.random.default_rng(20).random((7, 2)) * 3.0
BLOCK = AnalyticBlock(points=POINTS)
THETA = np.array([[0.012, 0.1, 0.05], [0.02, 0.6, 0.3], [0.05, 0.9, 0.01]])


def likelihood(freedom: float | None, zero_sd: float, with_field: bool = False) -> Likelihood:
    clean = BLOCK(np.array([0.4, 0.1])).displacement
    field = FieldData(POINTS, clean + 0.01, np.array([0.01, 0.02, 0.03]), 0.8, 0.4)
    return build_likelihood(
        replace(thesis_forces(), field=field if with_field else None),
        AnalyticForward(BLOCK, 0.02, with_field),
        NoiseSettings(travel_zero_sd=zero_sd, force_freedom=freedom),
        force_discretisation=0.02,
    )


@pytest.mark.parametrize("freedom", [1.0, 4.0, 30.0])
def test_without_shared_errors_it_is_scipys_multivariate_t(freedom: float) -> None:
    like = likelihood(freedom, 0.0)
    prediction = like.predict(THETA)
    scale = like.force_covariance(prediction)
    known = [
        multivariate_t.logpdf(like.force, loc=f, shape=c, df=freedom)
        for f, c in zip(prediction.force, scale, strict=True)
    ]
    np.testing.assert_allclose(like.log_prob(THETA), known, rtol=0, atol=1e-8)


def dense(like: Likelihood, theta: Array, freedom: float, others: Array) -> float:
    """Integral over the weight of the joint normal of forces and others, by adaptive quadrature.

    `others` (n,) of them are forces; the joint covariance is written out in `pieces`.
    """
    own, rest, residual = pieces(like, theta, others)

    def integrand(u: float) -> float:
        w = np.exp(u)
        density = multivariate_normal.logpdf(residual, cov=own / w + rest)
        return float(np.exp(density - offset) * gamma.pdf(w, freedom / 2, scale=2 / freedom) * w)

    offset = multivariate_normal.logpdf(residual, cov=own + rest)
    value, _ = quad(integrand, -25.0, 4.0, epsabs=0.0, epsrel=1e-11, limit=400)
    return float(np.log(value) + offset)


def pieces(like: Likelihood, theta: Array, steps: Array) -> tuple[Array, Array, Array]:
    prediction = like.predict(theta[None])
    force = np.ascontiguousarray(prediction.force.T)
    own = like.errors.covariance(force, prediction.force_covariance)[:, :, 0]
    [shift] = like.errors.shifts(force)[:, :, 0]
    chosen = np.ix_(steps, steps)
    return own[chosen], np.outer(shift, shift)[chosen], (like.force - force[:, 0])[steps]


def test_with_a_shared_error_it_is_the_integral_over_the_weight() -> None:
    like, steps = likelihood(3.0, 0.05), np.arange(5)
    known = [dense(like, theta, 3.0, steps) for theta in THETA]
    np.testing.assert_allclose(like.log_prob(THETA), known, rtol=0, atol=1e-8)


def pinned(zero: float, freedom: float) -> tuple[float, float]:
    """Ln density of five forces beside a field that says where the zero is, and the same densely.

    Forces and their change by an SD of the zero are constant, with covariance I: given the weight w
    forces and field are a parabola of the zero, whose integral is written out here.
    """
    residual, shift, known = np.array([1.0, -0.5, 0.3, 0.8, -1.1]), np.arange(1.0, 6.0), 1e4
    at_none, slope, bend = residual @ residual, shift @ residual, shift @ shift
    none = np.zeros((1,))
    force = ForceDensity(
        AlongError(none - 0.5 * at_none, np.full((1, 1), slope), np.full((1, 1, 1), bend)),
        none + at_none,
        5,
    )
    field = AlongError(
        none - 0.5 * known * zero**2, np.full((1, 1), known * zero), np.full((1, 1, 1), known)
    )
    u = np.linspace(-25.0, 4.0, 200_001)
    w = np.exp(u)
    pivot = 1.0 + known + w * bend
    parabola = 0.5 * ((known * zero + w * slope) ** 2 / pivot - np.log(pivot))
    given = 2.5 * u - 0.5 * w * at_none - 0.5 * known * zero**2 + parabola
    terms = given + gamma.logpdf(w, freedom / 2, scale=2 / freedom) + u
    dense = float(logsumexp(terms) + np.log(u[1] - u[0]))
    return float(student_marginal(force, [field], freedom)[0]), dense


@pytest.mark.parametrize("freedom", [1.0, 10.0, 30.0, 100.0])
@pytest.mark.parametrize("zero", [0.0, 0.2, -2.8, 5.3, 10.6])
def test_a_field_may_hold_the_zero_where_forces_fit_worse_than_at_none(
    zero: float, freedom: float
) -> None:
    found, dense = pinned(zero, freedom)
    assert found == pytest.approx(dense, abs=1e-8)


def test_an_increment_given_the_others_is_the_quotient_of_two_integrals() -> None:
    like = likelihood(3.0, 0.05)
    without = [dense(like, THETA[1], 3.0, np.delete(np.arange(5), i)) for i in range(5)]
    known = dense(like, THETA[1], 3.0, np.arange(5)) - np.array(without)
    np.testing.assert_allclose(like.pointwise(THETA[1:2])[0], known, rtol=0, atol=1e-7)


@pytest.mark.parametrize("with_field", [False, True])
def test_many_degrees_of_freedom_are_the_normal_likelihood(with_field: bool) -> None:
    normal, student = (likelihood(f, 0.02, with_field) for f in (None, 1e9))
    np.testing.assert_allclose(student.log_prob(THETA), normal.log_prob(THETA), rtol=2e-5)
    of_normal, of_student = (each.shared_posterior(THETA) for each in (normal, student))
    np.testing.assert_allclose(of_student.mean, of_normal.mean, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(of_student.covariance, of_normal.covariance, rtol=1e-4, atol=1e-6)


def test_a_force_that_is_off_costs_the_logarithm_of_its_square() -> None:
    like = likelihood(4.0, 0.0)
    far = [replace(like, force=like.force + off).log_prob(THETA[:1])[0] for off in (1e3, 1e4)]
    # (nu + n) / 2 ln of the misfit's ratio, which is 100 far out
    assert far[0] - far[1] == pytest.approx(0.5 * (4 + 5) * np.log(100.0), rel=1e-2)


def test_replicates_have_the_covariance_of_the_t_and_the_nuisances() -> None:
    like = likelihood(8.0, 0.05)
    x = np.tile([np.log(0.02), 0.6, 0.3], (40_000, 1))
    drawn = predictive_forces(like, x, np.random.default_rng(1))
    own, rest, _ = pieces(like, THETA[1], np.arange(5))
    known = own * 8.0 / 6.0 + rest
    np.testing.assert_allclose(np.cov(drawn.T), known, rtol=0.08)


def test_fisher_information_is_that_of_the_score() -> None:
    # E[(d ln p / d mu)^2] of a t of 5 degrees in one dimension by a sum over its density
    y = np.linspace(-400.0, 400.0, 2_000_001)
    density = (1 + y**2 / 5.0) ** -3.0
    score = 6.0 * y / (5.0 + y**2)
    information = (score**2 * density).sum() / density.sum()
    assert information_share(5.0, 1) == pytest.approx(information, rel=1e-6)
    assert information_share(None, 5) == 1.0


def test_degrees_below_one_are_refused_and_a_discrepancy_beside_them() -> None:
    with pytest.raises(ValueError, match="force_freedom: expected 1 or more"):
        NoiseSettings(force_freedom=0.5)
    with pytest.raises(ValueError, match="expected one of the two"):
        replace(likelihood(4.0, 0.0), unknown=("discrepancy",))
