"""Laws by kappa and ratios, priors of constants with their Jacobian, integrals in many unknowns."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import expit
from scipy.stats import gaussian_kde, multivariate_normal

from calib.inference.coordinates import Space, Unknown, theta_of
from calib.inference.importance import Weighed, importance_sample
from calib.inference.laws import RATIOS, LawCoordinates
from calib.inference.prior import Marginal, Prior, hull_of
from fe.materials import material

C10, C01 = Marginal("normal", 0.004, 0.012, 0.008, 0.002), Marginal("uniform", -0.001, 0.006)
C11 = Marginal("log_uniform", 0.0005, 0.004)
POINTS = {
    "neo-hookean": [],
    "mooney-rivlin-2": [0.3],
    "mooney-rivlin-3": [0.3, 0.1],
    "yeoh": [0.1, 0.02],
    "ogden-1": [2.3],
    "ogden-2": [1.5, -2.0, 0.2],
    "ogden-3": [1.3, -2.0, 0.2, 5.0, 0.1],
}


def test_every_law_has_a_point_here() -> None:
    assert set(POINTS) == set(RATIOS)


@pytest.mark.parametrize("law", POINTS)
def test_kappa_is_half_the_shear_modulus_of_every_law(law: str) -> None:
    coordinates = LawCoordinates(law)
    theta = np.array([0.02, *POINTS[law]])
    *constants, mu = coordinates.constants_of(theta)
    assert mu == pytest.approx(0.04)
    assert material(law, constants, 1.0).shear_modulus == pytest.approx(0.04, rel=1e-12)
    assert len(coordinates.constants) == len(coordinates.units) == len(constants) + 1


@pytest.mark.parametrize("law", POINTS)
def test_slopes_of_the_constants_are_their_differences(law: str) -> None:
    coordinates, at = LawCoordinates(law), np.array(POINTS[law])
    slopes = coordinates.slopes(at)
    for row, unit in zip(slopes, np.eye(len(at)), strict=True):
        up, down = (np.array(coordinates.at_unit(at + h * unit)) for h in (1e-6, -1e-6))
        assert row == pytest.approx((up - down) / 2e-6, abs=1e-8)


def test_an_unknown_law_is_refused() -> None:
    with pytest.raises(ValueError, match="law: expected one of neo-hookean"):
        LawCoordinates("gent")


def prior_of_constants(*constants: Marginal, **changes: object) -> Prior:
    box = hull_of(constants)
    law = "mooney-rivlin-2" if len(constants) == 2 else "mooney-rivlin-3"
    fields = dict(zip(("kappa", "r", "s"), box, strict=False)) | changes
    return Prior(**fields, law=law, of=constants)  # type: ignore[arg-type]


def test_a_prior_of_constants_is_a_density_in_the_sampling_coordinates() -> None:
    # Integrated over r and ln kappa by an independent rule it has the mass 1.
    prior = prior_of_constants(C10, C01)
    low, high = prior.bounds.T
    x = low + (high - low) * np.random.default_rng(5).random((400_000, 2))
    mass = np.exp(prior.log_prob(x)).mean() * np.prod(high - low)
    assert mass == pytest.approx(1.0, abs=0.01)


def test_transformed_draws_of_constants_have_the_density_of_the_prior() -> None:
    rng = np.random.default_rng(6)
    prior = prior_of_constants(C10, C01, C11)
    x = prior.sample(rng, 20_000)
    constants = LawCoordinates("mooney-rivlin-3").constants_of(theta_of(x))
    for column, marginal in enumerate((C10, C01, C11)):
        for p in (0.1, 0.5, 0.9):
            share = np.mean(constants[:, column] < marginal.quantile(np.array(p)))
            assert share == pytest.approx(p, abs=0.012)
    # and a kernel estimate of the draws agrees with the density in the middle
    middle = x[:4000][np.abs(x[:4000] - np.median(x, axis=0)).max(axis=1) < 0.3][:40]
    estimate = gaussian_kde(x.T, bw_method=0.15)(middle.T)
    exact = np.exp(prior.log_prob(middle))
    assert np.median(estimate / exact) == pytest.approx(1.0, abs=0.1)


def test_a_posterior_by_constants_is_the_one_by_ratios_weighed_again() -> None:
    # One and the same likelihood under both priors: expectations by importance weights agree.
    rng = np.random.default_rng(8)
    ratios = Prior(
        Marginal("log_uniform", 0.003, 0.018),
        Marginal("uniform", -0.25, 0.6),
        law="mooney-rivlin-2",
    )
    constants = prior_of_constants(C10, C01)
    x, y = ratios.sample(rng, 200_000), constants.sample(rng, 200_000)

    def log_likelihood(at: np.ndarray) -> np.ndarray:
        return multivariate_normal.logpdf(at, [np.log(0.0095), 0.2], np.diag([0.03, 0.1]) ** 2)

    weights = np.exp(log_likelihood(x) + constants.log_prob(x) - ratios.log_prob(x))
    direct = np.exp(log_likelihood(y))
    assert (weights @ x) / weights.sum() == pytest.approx(direct @ y / direct.sum(), abs=3e-3)
    assert np.log(weights.mean()) == pytest.approx(np.log(direct.mean()), abs=0.03)


def test_a_narrower_box_cuts_the_prior_of_constants_and_keeps_its_mass() -> None:
    whole = prior_of_constants(C10, C01)
    cut = prior_of_constants(C10, C01, r=Marginal("uniform", 0.0, 0.3))
    x = whole.sample(np.random.default_rng(9), 50_000)
    share = np.mean((x[:, 1] >= 0.0) & (x[:, 1] <= 0.3))
    assert np.exp(cut.log_mass) == pytest.approx(share, abs=0.01)
    drawn = cut.sample(np.random.default_rng(10), 1000)
    assert drawn[:, 1].min() >= 0.0 and drawn[:, 1].max() <= 0.3
    assert np.isfinite(cut.log_prob(drawn)).all()
    with pytest.raises(ValueError, match="quantile: not known"):
        cut.quantile(np.full((1, 2), 0.5))


def test_constants_whose_sum_may_vanish_are_refused() -> None:
    with pytest.raises(ValueError, match=r"C10 \+ C01 above 0 MPa"):
        hull_of((Marginal("uniform", 0.0, 0.01), C01))


def test_the_density_of_a_logarithm_integrates_to_one() -> None:
    bulk = (
        Unknown("bulk_ratio", "1", "", log=True),
        Marginal("lognormal", 50.0, 900.0, 200.0, 90.0),
    )
    prior = Prior(
        Marginal("log_uniform", 0.001, 0.1),
        Marginal("uniform", 0.0, 1.0),
        Marginal("uniform", 0.0, 0.5),
        inputs=(bulk,),
    )
    assert prior.space.names == ("kappa", "r", "s", "bulk_ratio")
    base = np.array([np.log(0.01), 0.5, 0.2])
    own = Prior(prior.kappa, prior.r, prior.s).log_prob(base[None])[0]

    def density(at: float) -> float:
        return float(np.exp(prior.log_prob(np.array([[*base, at]]))[0] - own))

    low, high = prior.bounds[3]
    assert quad(density, low, high)[0] == pytest.approx(1.0, rel=1e-8)
    natural = prior.space.natural(prior.sample(np.random.default_rng(1), 2000))
    assert natural[:, 3].min() >= 50.0 and natural[:, 3].max() <= 900.0


def test_a_space_tells_inputs_of_the_model_from_those_of_the_errors() -> None:
    height, noise = Unknown("height", "mm", ""), Unknown("force_noise", "1", "", log=True)
    space = Space(inputs=(height,), errors=(noise,))
    assert space.x_names == ("ln kappa [MPa]", "r", "s", "height", "ln force_noise")
    assert (space.size, space.n_forward) == (5, 4)


@pytest.mark.parametrize("d", [4, 6])
def test_importance_sampling_meets_a_known_evidence_within_its_error(d: int) -> None:
    # A normal bent along a parabola: its integral is that of the normal.
    rng = np.random.default_rng(d)
    scales = np.geomspace(0.05, 1.0, d)

    def log_density(y: np.ndarray) -> np.ndarray:
        bent = y.copy()
        bent[:, 1] -= 0.5 * (y[:, -1] ** 2 - 1.0)
        return -0.5 * np.sum((bent / scales) ** 2, axis=1) + 3.0

    first = 3.0 * rng.standard_normal((8192, d))
    log_first = -0.5 * np.sum((first / 3.0) ** 2, axis=1) - d * np.log(3.0 * np.sqrt(2 * np.pi))
    found = importance_sample(log_density, first, log_first, rng)
    exact = 3.0 + 0.5 * d * np.log(2 * np.pi) + np.log(scales).sum()
    evidence = np.log(np.sum(np.exp(found.log_weights)))
    assert found.error < 0.05
    assert abs(evidence - exact) < 4.0 * found.error
    weights = np.exp(found.log_weights - found.log_weights.max())
    mean = weights @ found.y / weights.sum()
    assert mean == pytest.approx(np.zeros(d), abs=0.05)


def test_importance_sampling_refuses_a_density_that_is_zero_at_the_start() -> None:
    y = np.zeros((10, 2))
    with pytest.raises(ValueError, match="zero at all of 10 prior draws"):
        importance_sample(
            lambda at: np.full(len(at), -np.inf), y, np.zeros(10), np.random.default_rng(0)
        )


def ridge(d: int, sd: float, correlation: float) -> Weighed:
    """Draws of a normal in a unit box, which its first draws fill; its integral is 1."""
    rng = np.random.default_rng(0)
    covariance = sd**2 * ((1.0 - correlation) * np.eye(d) + correlation)
    normal = multivariate_normal(np.full(d, 0.45), covariance)

    def log_slope(y: np.ndarray) -> np.ndarray:
        """Ln dx/dy of the logit that opens the box"""
        slope: np.ndarray = -np.sum(np.logaddexp(0.0, y) + np.logaddexp(0.0, -y), axis=1)
        return slope

    first = rng.logistic(size=(8192, d))
    return importance_sample(
        lambda y: normal.logpdf(expit(y)) + log_slope(y), first, log_slope(first), rng
    )


@pytest.mark.parametrize(("d", "correlation"), [(4, 0.999), (6, 0.999)])
def test_importance_sampling_goes_on_while_weights_are_tempered(d: int, correlation: float) -> None:
    """20 rounds left ln evidence off by 5 and more, and stated 1."""
    found = ridge(d, 0.05, correlation)
    evidence = np.log(np.sum(np.exp(found.log_weights)))
    assert found.error < 0.02 and abs(evidence) < 4.0 * found.error


def test_importance_sampling_that_did_not_reach_the_density_says_so() -> None:
    """One draw had all of the weight: ln evidence was off by 72, and stated 1."""
    with pytest.raises(ValueError, match="not reached from the prior in 60 rounds"):
        ridge(5, 0.02, 0.99)
