"""Closed forms against textbook formulas, the stress of the FE kernels and small strains."""

from __future__ import annotations

import numpy as np
import pytest
from material_laws import CONSTANTS, make, stress
from scipy.optimize import root

from fe.closed_forms import equibiaxial, nominal_stress, pure_shear, simple_shear, uniaxial
from fe.materials import LAWS, Material, bulk_modulus, material
from fe.materials.volumetric import VOLUMETRIC_CODES, pressure

STRETCHES = np.array([0.6, 0.9, 1.0, 1.001, 1.4, 2.5, 6.0])
MODES = {
    "uniaxial": (uniaxial, lambda lam, t: (lam, t, t), -0.5),
    "equibiaxial": (equibiaxial, lambda lam, t: (lam, lam, t), -2.0),
    "pure shear": (pure_shear, lambda lam, t: (lam, 1.0, t), -1.0),
}
every_law = pytest.mark.parametrize("law", CONSTANTS)
every_mode = pytest.mark.parametrize("mode", MODES)


def total_stress(m: Material, F: np.ndarray) -> np.ndarray:
    """P of the element kernels with the volumetric law at each point, MPa."""
    J = float(np.linalg.det(F))
    volume = m.bulk * pressure(VOLUMETRIC_CODES[m.volumetric], J - 1.0) * J
    return stress(F, m.kernel())[0] + volume * np.linalg.inv(F).T


@every_mode
@every_law
def test_incompressible_stress_is_that_of_the_kernels_less_the_free_pressure(law, mode):
    m = make(law)
    form, stretches, power = MODES[mode]
    for lam, found in zip(STRETCHES, form(m, STRETCHES), strict=True):
        l1, l2, l3 = stretches(lam, lam**power)
        P = stress(np.diag([l1, l2, l3]), m.kernel())[0]
        expected = P[0, 0] - P[2, 2] * l3 / l1
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-14)


@every_mode
@every_law
@pytest.mark.parametrize("volumetric", VOLUMETRIC_CODES)
@pytest.mark.parametrize("ratio", [14 / 3, 2000.0])  # nu = 0.4 and 0.49975
def test_compressible_stress_is_that_of_the_kernels_at_the_free_stretch(
    law, mode, volumetric, ratio
):
    """The transverse stretch is found by another solver from the kernels' stress."""
    mu = make(law).shear_modulus
    m = make(law, ratio * mu, volumetric)
    form, stretches, power = MODES[mode]
    lam = STRETCHES[1:5]
    for one, found in zip(lam, form(m, lam), strict=True):

        def transverse(t: np.ndarray, one: float = one) -> float:
            return total_stress(m, np.diag(stretches(one, t[0])))[2, 2] / m.bulk

        t = root(transverse, [one**power], tol=1e-15).x[0]
        P = total_stress(m, np.diag(stretches(one, t)))
        assert abs(P[2, 2]) < 1e-12 * m.bulk
        expected = P[0, 0] - P[2, 2] * t / one  # what the root leaves, taken out
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * mu)


@pytest.mark.parametrize("lam", [0.5, 1.3, 3.0])
@pytest.mark.parametrize(
    ("law", "slopes"),
    [
        ("neo-hookean", lambda c, a, b: (c[0], 0.0)),
        ("mooney-rivlin-2", lambda c, a, b: (c[0], c[1])),
        ("mooney-rivlin-3", lambda c, a, b: (c[0] + c[2] * b, c[1] + c[2] * a)),
        ("mooney-rivlin-c20", lambda c, a, b: (c[0] + 2 * c[2] * a, c[1])),
        ("yeoh", lambda c, a, b: (c[0] + 2 * c[1] * a + 3 * c[2] * a**2, 0.0)),
    ],
)
def test_invariant_laws_have_the_formulas_of_the_textbook(law, slopes, lam):
    """Treloar, The Physics of Rubber Elasticity (1975), chapter 5, with W1 and W2 of each law."""
    m, c = make(law), CONSTANTS[law]

    def check(form, i1: float, i2: float, strain: float, weight: float) -> None:
        W1, W2 = slopes(c, i1 - 3, i2 - 3)
        expected = 2 * strain * (W1 + weight * W2)
        np.testing.assert_allclose(form(m, lam), [expected], rtol=1e-12)

    check(uniaxial, lam**2 + 2 / lam, 2 * lam + lam**-2, lam - lam**-2, 1 / lam)
    check(equibiaxial, 2 * lam**2 + lam**-4, lam**4 + 2 * lam**-2, lam - lam**-5, lam**2)
    planar = 1 + lam**2 + lam**-2
    check(pure_shear, planar, planar, lam - lam**-3, 1.0)


@pytest.mark.parametrize("lam", [0.5, 1.3, 3.0])
@pytest.mark.parametrize("law", ["ogden-1", "ogden-2", "ogden-3"])
def test_ogden_has_the_formulas_of_the_paper(law, lam):
    """Ogden 1972: sum mu (lam^(alpha - 1) - lam^-(1 + beta alpha)), beta = 1/2, 2, 1."""
    m, c = make(law), np.array(CONSTANTS[law])
    for form, beta in ((uniaxial, 0.5), (equibiaxial, 2.0), (pure_shear, 1.0)):
        terms = c[::2] * (lam ** (c[1::2] - 1) - lam ** -(1 + beta * c[1::2]))
        np.testing.assert_allclose(form(m, lam), [terms.sum()], rtol=1e-12)


@every_law
@pytest.mark.parametrize("shear", [-0.8, 1e-3, 0.5, 2.0])
def test_simple_shear_is_the_shear_stress_of_the_kernels(law, shear):
    m = make(law)
    F = np.eye(3)
    F[0, 1] = shear
    found = simple_shear(m, shear)[0]
    np.testing.assert_allclose(found, stress(F, m.kernel())[0][0, 1], rtol=1e-10)


@every_law
@pytest.mark.parametrize("nu", [0.4, 0.49])
@pytest.mark.parametrize("volumetric", VOLUMETRIC_CODES)
def test_small_strain_moduli_are_those_of_linear_elasticity(law, nu, volumetric):
    """E, E / (1 - nu), E / (1 - nu^2) and mu at a strain of 1e-6."""
    mu = make(law).shear_modulus
    m = make(law, bulk_modulus(mu, nu), volumetric)
    E, h = 2 * mu * (1 + nu), 1e-6
    for form, modulus in (
        (uniaxial, E),
        (equibiaxial, E / (1 - nu)),
        (pure_shear, E / (1 - nu**2)),
    ):
        np.testing.assert_allclose(
            np.diff(form(m, [1 - h, 1 + h]))[0] / (2 * h), modulus, rtol=1e-7
        )
    np.testing.assert_allclose(simple_shear(m, h)[0] / h, mu, rtol=1e-7)


def test_a_large_bulk_modulus_tends_to_incompressible():
    m = make("mooney-rivlin-3")
    lam = np.array([0.7, 1.8])
    for form, _, _ in MODES.values():
        gaps = [
            np.abs(form(make("mooney-rivlin-3", bulk), lam) - form(m, lam)).max()
            for bulk in (1e4, 1e5)
        ]
        assert gaps[1] == pytest.approx(gaps[0] / 10, rel=0.02)


def test_stress_is_linear_in_the_constants_of_linear_laws():
    law = LAWS["mooney-rivlin-3"]
    e = np.log([[1.4, 0.9, 1 / 1.26]])
    parts = [nominal_stress(law, unit, e, 0, 2) for unit in np.eye(3)]
    whole = nominal_stress(law, (0.2, 0.1, 0.35), e, 0, 2)
    np.testing.assert_allclose(np.array([0.2, 0.1, 0.35]) @ parts, whole, rtol=1e-13)


def test_impossible_stretches_are_refused_by_name():
    with pytest.raises(ValueError, match="stretch: expected numbers above 0"):
        uniaxial(make("yeoh"), [1.0, -1.0])
    soft = material("neo-hookean", (0.5,), 0.01)  # K/2 (J - 1)^2 cannot resist so much
    with pytest.raises(ValueError, match=r"stretch: expected .* equibiaxial of neo-hookean"):
        equibiaxial(soft, 0.01)
