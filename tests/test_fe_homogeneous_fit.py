"""Fits of homogeneous tests: constants come back, published ones hold, real data rank the laws."""

from __future__ import annotations

import numpy as np
import pytest
from material_laws import CONSTANTS

from benchmarks.rubber_multiaxial import MATERIALS, OGDEN_1972, folder, main, read_tests
from fe.homogeneous_fit import HomogeneousTests, fit, judge
from fe.materials import LAWS

needs_data = pytest.mark.skipif(
    not folder().exists(), reason=f"no rubber data in {folder()}; set SOFTCAL_RUBBER_DATA"
)


def made_up(law: str) -> HomogeneousTests:
    """Uniaxial, equibiaxial and pure-shear stresses of the law's constants."""
    lam = np.linspace(0.5, 3.0, 12)
    stretches = np.vstack(
        [
            np.stack([lam, lam**-0.5, lam**-0.5], axis=1),
            np.stack([lam, lam, lam**-2], axis=1),
            np.stack([lam, np.ones_like(lam), 1 / lam], axis=1),
        ]
    )
    empty = HomogeneousTests(stretches, np.zeros(len(stretches)))
    return HomogeneousTests(stretches, empty.predict(LAWS[law], np.array(CONSTANTS[law])))


@pytest.mark.parametrize("law", CONSTANTS)
def test_the_fit_gives_back_the_constants_that_made_the_data(law):
    found = fit(LAWS[law], made_up(law))
    assert found.relative < 1e-8
    terms = found.constants.reshape(-1, 2) if law.startswith("ogden") else found.constants
    expected = np.reshape(CONSTANTS[law], terms.shape)
    if law.startswith("ogden"):  # the order of the terms is free
        terms = terms[np.argsort(terms[:, 1])]
        expected = expected[np.argsort(expected[:, 1])]
    np.testing.assert_allclose(terms, expected, rtol=1e-5)


@pytest.mark.parametrize("law", ["mooney-rivlin-3", "ogden-2"])
def test_no_constants_nearby_fit_noisy_data_better(law):
    clean, rng = made_up(law), np.random.default_rng(0)
    tests = HomogeneousTests(
        clean.stretches, clean.stress * (1 + 0.05 * rng.standard_normal(clean.stress.size))
    )
    best = fit(LAWS[law], tests)
    for _ in range(20):
        near = best.constants * (1 + 1e-3 * rng.standard_normal(best.constants.size))
        assert judge(LAWS[law], near, tests).rms > best.rms


def test_what_cannot_be_fitted_is_refused_by_name():
    with pytest.raises(ValueError, match="tests: expected at least 3 points for yeoh, found 2"):
        fit(LAWS["yeoh"], HomogeneousTests(np.ones((2, 3)), np.ones(2)))
    with pytest.raises(ValueError, match=r"stretches: expected \(n, 3\) beside n = 2"):
        HomogeneousTests(np.ones((3, 3)), np.ones(2))
    with pytest.raises(ValueError, match="stretches: expected finite numbers above 0"):
        HomogeneousTests(-np.ones((2, 3)), np.ones(2))
    with pytest.raises(ValueError, match="stretches: expected finite numbers above 0, found nan"):
        HomogeneousTests(np.full((2, 3), np.nan), np.ones(2))
    with pytest.raises(ValueError, match="stress: expected finite numbers"):
        HomogeneousTests(np.ones((2, 3)), np.array([1.0, np.nan]))
    with pytest.raises(ValueError, match="stretches: expected a product of 1 in each row, found 2"):
        HomogeneousTests(np.array([[1.0, 1.0, 1.0], [2.0, 1.0, 1.0]]), np.ones(2))


@needs_data
@pytest.mark.parametrize("material", MATERIALS)
def test_ogden_with_three_terms_fits_real_rubber_better_than_mooney_rivlin(material):
    tests = read_tests(material)
    misfit = {name: fit(LAWS[name], tests).relative for name in LAWS}
    assert misfit["ogden-3"] < 0.06
    assert misfit["ogden-3"] < 0.9 * misfit["mooney-rivlin-3"]
    assert misfit["ogden-3"] <= misfit["ogden-2"] <= misfit["ogden-1"]
    # laws that contain others
    assert misfit["mooney-rivlin-3"] <= misfit["mooney-rivlin-2"] <= misfit["neo-hookean"]
    assert misfit["mooney-rivlin-c20"] <= misfit["mooney-rivlin-2"]
    assert misfit["yeoh"] <= misfit["neo-hookean"]


@needs_data
def test_the_constants_of_ogden_1972_hold_for_the_rubber_of_treloar():
    tests = read_tests("Treloar_1944", 7.0)
    published = judge(LAWS["ogden-3"], OGDEN_1972, tests)
    assert published.relative < 0.03
    assert fit(LAWS["ogden-3"], tests).relative < published.relative


@needs_data
@pytest.mark.parametrize(
    ("material", "C10", "C01", "rms"),
    [
        ("Meunier_2008", 0.147, 0.0232, 0.027),
        ("Kawamura_2001", 0.0327, 0.0027, 0.012),
        ("Treloar_1944", 0.172, 0.0102, 0.030),
    ],
)
def test_mooney_rivlin_constants_are_those_found_beside_the_data(material, C10, C01, rms):
    """README of the data: joint least squares for stretch < 2 by another code, three digits."""
    found = fit(LAWS["mooney-rivlin-2"], read_tests(material, 2.0))
    np.testing.assert_allclose(found.constants, [C10, C01], atol=6e-5, rtol=3e-3)
    assert found.rms == pytest.approx(rms, abs=6e-4)


@needs_data
def test_the_example_prints_a_row_for_every_law_and_rubber(capsys):
    main(["1.5"])
    text = capsys.readouterr().out
    for law in LAWS:
        assert text.count(f"| {law} |") == len(MATERIALS)
