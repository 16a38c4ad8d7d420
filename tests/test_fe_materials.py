"""Every law and both chain rules against finite differences, invariance and small-strain moduli."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from material_laws import CONSTANTS, energy, make, rotation, stress

from fe.materials import LAWS, KernelMaterial, Material, bulk_modulus, material
from fe.materials.eigen import symmetric_eigen
from fe.materials.invariant import cofactor
from fe.materials.material import mooney_rivlin_of_ratios
from fe.materials.mooney_rivlin import RATIO_DERIVATIVES, from_ratios
from fe.materials.volumetric import VOLUMETRIC_CODES, deviation, pressure

EXTRA = {
    "only C01": material("mooney-rivlin-3", (0.0, 0.4, 0.0)).kernel(),
    "slope of ogden-2": make("ogden-2").slope(np.array([0.3, 0.2, -0.4, 0.5])),
}
KERNELS: dict[str, KernelMaterial] = {name: make(name).kernel() for name in CONSTANTS} | EXTRA
every_kernel = pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS.keys())
every_law = pytest.mark.parametrize("law", CONSTANTS)


def random_F(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    F = np.eye(3) + 0.4 * rng.standard_normal((3, 3))
    return F if np.linalg.det(F) > 0.1 else random_F(seed + 1000)


def of_stretches(*lam: float) -> np.ndarray:
    return rotation(5) @ np.diag(lam) @ rotation(6)


def central(f, F: np.ndarray, h: float) -> np.ndarray:
    columns = []
    for k in range(9):
        dF = np.zeros(9)
        dF[k] = h
        dF = dF.reshape(3, 3)
        columns.append((f(F + dF) - f(F - dF)) / (2 * h))
    return np.stack(columns, axis=-1).reshape(*np.shape(columns[0]), 3, 3)


SPECIAL = {
    "undeformed": np.eye(3),
    "turned": rotation(4),
    "two equal": of_stretches(1.3, 1.3, 0.7),
    "two equal on the axes": np.diag([0.8, 1.2, 1.2]),
    "all equal": of_stretches(1.2, 1.2, 1.2),
} | {f"{d:g} apart": of_stretches(1.1, 1.1 + d, 0.9) for d in (1e-4, 1e-8, 1e-12, 1e-15)}
STATES = {f"seed {seed}": random_F(seed) for seed in range(4)} | SPECIAL
every_state = pytest.mark.parametrize("F", STATES.values(), ids=STATES.keys())


@every_kernel
@every_state
def test_stress_is_the_derivative_of_the_energy(kernel, F):
    P, _ = stress(F, kernel)
    expected = central(lambda G: energy(G, kernel), F, 1e-6)
    np.testing.assert_allclose(P, expected, rtol=1e-7, atol=1e-7 * max(np.abs(P).max(), 0.01))


@every_kernel
@every_state
def test_tangent_is_the_derivative_of_the_stress_and_symmetric(kernel, F):
    _, A = stress(F, kernel)
    expected = central(lambda G: stress(G, kernel)[0], F, 1e-6)
    np.testing.assert_allclose(A, expected, atol=2e-8 * np.abs(A).max())
    np.testing.assert_allclose(A, A.transpose(2, 3, 0, 1), atol=1e-12 * np.abs(A).max())


@every_law
@pytest.mark.parametrize("gap", [1e-5, 1e-8, 1e-11, 1e-14])
def test_the_tangent_does_not_jump_where_two_stretches_become_equal(law, gap):
    kernel = make(law).kernel()
    at, near = (stress(of_stretches(1.3, 1.3 + d, 0.7), kernel)[1] for d in (0.0, gap))
    np.testing.assert_allclose(near, at, rtol=0, atol=(1e-13 + 20 * gap) * np.abs(at).max())


def test_the_two_chain_rules_agree_where_laws_coincide():
    """Ogden with exponents 2 and -2 is Mooney-Rivlin: mu1 = 2 C10, mu2 = -2 C01."""
    ogden = material("ogden-2", (0.4, 2.0, -0.2, -2.0)).kernel()
    mooney = material("mooney-rivlin-2", (0.2, 0.1)).kernel()
    for F in STATES.values():
        np.testing.assert_allclose(energy(F, ogden), energy(F, mooney), rtol=1e-11, atol=1e-14)
        for a, b in zip(stress(F, ogden), stress(F, mooney), strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=2e-12 * max(np.abs(b).max(), 0.1))


@pytest.mark.parametrize(
    ("law", "constants", "same"),
    [
        ("mooney-rivlin-2", (0.2, 0.1), (0.2, 0.1, 0.0)),
        ("neo-hookean", (0.2,), (0.2, 0.0, 0.0)),
    ],
)
def test_a_law_with_fewer_constants_is_the_larger_one_with_zeros(law, constants, same):
    F = random_F(2)
    small, large = material(law, constants).kernel(), material("mooney-rivlin-3", same).kernel()
    for a, b in zip(stress(F, small), stress(F, large), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-14 * np.abs(b).max())


def test_eigenvectors_stay_orthonormal_whatever_the_gaps():
    rng = np.random.default_rng(8)
    for gap in (0.0, 1e-16, 1e-12, 1e-6, 1.0):
        Q = rotation(int(rng.integers(1000)))
        C = Q @ np.diag([1.0, 1.0 + gap, 0.01]) @ Q.T
        C = (C + C.T) / 2
        D, V = C.copy(), np.empty((3, 3))
        symmetric_eigen(D, V)
        np.testing.assert_allclose(V.T @ V, np.eye(3), atol=5e-15)
        np.testing.assert_allclose(V @ np.diag(np.diag(D)) @ V.T, C, atol=5e-15)
        np.testing.assert_allclose(np.sort(np.diag(D)), np.linalg.eigvalsh(C), atol=5e-15)


def test_cofactor_is_J_times_inverse_transpose():
    F = random_F(7)
    cof = np.empty((3, 3))
    J = cofactor(F, cof)
    np.testing.assert_allclose(J, np.linalg.det(F), rtol=1e-13)
    np.testing.assert_allclose(cof, J * np.linalg.inv(F).T, rtol=1e-12)


@every_kernel
@pytest.mark.parametrize("seed", [3, 5])
def test_energy_does_not_feel_rotation_or_volume_change(kernel, seed):
    F = random_F(seed)
    Q = rotation(1)
    W = energy(F, kernel)
    for G in (Q @ F, F @ Q, 1.7 * F):
        np.testing.assert_allclose(energy(G, kernel), W, rtol=1e-12)
    P, A = stress(F, kernel)
    turned_P, turned_A = stress(Q @ F, kernel)
    np.testing.assert_allclose(turned_P, Q @ P, atol=5e-13 * np.abs(P).max())
    expected = np.einsum("ai,ijkm,bk->ajbm", Q, A, Q)
    np.testing.assert_allclose(turned_A, expected, atol=5e-13 * np.abs(A).max())


@every_law
def test_small_strain_tangent_is_that_of_the_shear_modulus(law):
    m = make(law)
    P, A = stress(np.eye(3), m.kernel())
    d = np.eye(3)
    deviator = (
        np.einsum("ik,jm->ijkm", d, d)
        + np.einsum("im,jk->ijkm", d, d)
        - 2 / 3 * np.einsum("ij,km->ijkm", d, d)
    )
    np.testing.assert_allclose(P, 0.0, atol=1e-15)
    np.testing.assert_allclose(A, m.shear_modulus * deviator, atol=1e-13)


@every_law
def test_energy_and_stress_scale_with_the_constants_that_are_stresses(law):
    m, F = make(law), random_F(6)
    factors = np.where(m.law.scales_stress, 0.037, 1.0)
    scaled = dataclasses.replace(m, constants=tuple(factors * m.constants))
    assert energy(F, scaled.kernel()) == pytest.approx(0.037 * energy(F, m.kernel()), rel=1e-13)
    for a, b in zip(stress(F, scaled.kernel()), stress(F, m.kernel()), strict=True):
        np.testing.assert_allclose(a, 0.037 * b, rtol=0, atol=1e-13 * np.abs(a).max())


@every_law
def test_the_slope_of_a_law_is_its_difference_quotient_in_the_constants(law):
    m, F, h = make(law), random_F(1), 1e-6
    direction = np.random.default_rng(2).standard_normal(len(m.constants))
    slope = m.slope(direction)
    plus, minus = (
        dataclasses.replace(m, constants=tuple(np.array(m.constants) + k * h * direction)).kernel()
        for k in (1, -1)
    )
    np.testing.assert_allclose(
        energy(F, slope), (energy(F, plus) - energy(F, minus)) / (2 * h), rtol=1e-7
    )
    for a, b, c in zip(stress(F, slope), stress(F, plus), stress(F, minus), strict=True):
        np.testing.assert_allclose(a, (b - c) / (2 * h), atol=1e-7 * np.abs(a).max())


def test_ratio_derivatives_are_those_of_the_constants():
    for j, h in enumerate(np.eye(2) * 1e-6):
        ratios = np.array([0.3, 0.2])
        slope = (from_ratios(ratios + h) - from_ratios(ratios - h)) / 2e-6
        np.testing.assert_allclose(slope, RATIO_DERIVATIVES[j], atol=1e-9)


@pytest.mark.parametrize("volumetric", VOLUMETRIC_CODES)
@pytest.mark.parametrize("J", [0.4, 0.9, 1.0, 1.001, 1.6])
def test_volumetric_laws_are_their_formulas_with_unit_modulus_at_rest(volumetric, J):
    u = {
        "quadratic": lambda J: (J - 1) ** 2 / 2,
        "logarithmic": lambda J: np.log(J) ** 2 / 2,
        "simo-miehe": lambda J: (J**2 - 1 - 2 * np.log(J)) / 4,
    }[volumetric]
    code, h = VOLUMETRIC_CODES[volumetric], 1e-4
    v, v1, v2 = deviation(code, J - 1)
    assert v + (J - 1) ** 2 / 2 == pytest.approx(u(J), abs=1e-15)
    first = (u(J - 2 * h) - 8 * u(J - h) + 8 * u(J + h) - u(J + 2 * h)) / (12 * h)
    assert v1 + J - 1 == pytest.approx(first, abs=1e-10)
    assert pressure(code, J - 1) == (J - 1) + v1
    second = (u(J + h) - 2 * u(J) + u(J - h)) / h**2
    assert v2 + 1 == pytest.approx(second, abs=1e-5)
    assert deviation(code, 0.0) == (0.0, 0.0, 0.0)


def test_every_law_is_registered_under_its_name_with_its_constants():
    for name, law in LAWS.items():
        assert law.name == name
        assert len(law.constant_names) == len(law.scales_stress) == len(CONSTANTS[name])
    assert LAWS["ogden-2"].constant_names == ("mu1", "alpha1", "mu2", "alpha2")


def test_ratios_give_the_three_constants():
    m = mooney_rivlin_of_ratios(np.array([0.4, 0.1]), 2.0, 300.0)
    assert m == Material(LAWS["mooney-rivlin-3"], (1.2, 0.8, 0.2), 300.0)
    assert m.shear_modulus == 4.0


def test_bulk_modulus_is_that_of_the_poisson_ratio():
    mu, nu = 0.3, 0.4
    K = bulk_modulus(mu, nu)
    assert (3 * K - 2 * mu) / (2 * (3 * K + mu)) == pytest.approx(nu, rel=1e-14)
    assert bulk_modulus(mu, 0.5) == np.inf
    with pytest.raises(ValueError, match=r"poisson: expected .* found 0\.6"):
        bulk_modulus(mu, 0.6)
    for wrong in (-1.0, 0.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="shear_modulus: expected a finite modulus above 0"):
            bulk_modulus(wrong, 0.3)


@pytest.mark.parametrize(
    ("law", "constants", "more", "message"),
    [
        ("gent", (1.0,), {}, "law: expected one of neo-hookean, .* found 'gent'"),
        ("yeoh", (1.0,), {}, r"constants: expected 3 finite numbers \(C10, C20, C30\)"),
        ("neo-hookean", (np.nan,), {}, "constants: expected 1 finite numbers"),
        ("neo-hookean", (-1.0,), {}, "shear modulus above 0 MPa, found -2.0"),
        (
            "neo-hookean",
            (1e150,),
            {},
            r"shear modulus between 1e-100 and 1e\+100 MPa, found 2e\+150",
        ),
        ("neo-hookean", (1e-150,), {}, "shear modulus between 1e-100 and .* found 2e-150"),
        ("ogden-1", (1.0, 0.0), {}, "alpha1: expected an exponent other than 0"),
        ("neo-hookean", (1.0,), {"bulk": 0.0}, "bulk: expected a modulus above 0 MPa, found 0.0"),
        ("neo-hookean", (1.0,), {"volumetric": "cubic"}, "volumetric: expected .* found 'cubic'"),
    ],
)
def test_wrong_materials_are_refused_by_name(law, constants, more, message):
    with pytest.raises(ValueError, match=message):
        material(law, constants, **more)


def test_a_material_is_the_same_of_any_kind_of_numbers():
    law = LAWS["mooney-rivlin-2"]
    kinds = [(0.25, 0.5), [0.25, 0.5], np.array([0.25, 0.5]), np.array([0.25, 0.5], np.float32)]
    same = {Material(law, kind, np.float32(8.0)) for kind in kinds}  # type: ignore[arg-type]
    assert same == {material("mooney-rivlin-2", (0.25, 0.5), 8)}
    assert type(next(iter(same)).bulk) is float
