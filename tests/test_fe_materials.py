"""The Mooney-Rivlin law and the chain rule against finite differences and invariance."""

from __future__ import annotations

import numpy as np
import pytest

from fe.materials.invariant import cofactor, isochoric_energy, isochoric_stress
from fe.materials.mooney_rivlin import RATIO_DERIVATIVES, from_ratios

CONSTANTS = [
    np.array([0.3, 0.0, 0.0]),
    np.array([0.0, 0.4, 0.0]),
    np.array([0.2, 0.1, 0.35]),
]


def random_F(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    F = np.eye(3) + 0.4 * rng.standard_normal((3, 3))
    return F if np.linalg.det(F) > 0.1 else random_F(seed + 1000)


def stress(F: np.ndarray, constants: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    cof, P, A = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3, 3, 3))
    J = cofactor(F, cof)
    isochoric_stress(F, cof, J, constants, P, A, True)
    return P, A


def central(f, F: np.ndarray, h: float) -> np.ndarray:
    columns = []
    for k in range(9):
        dF = np.zeros(9)
        dF[k] = h
        dF = dF.reshape(3, 3)
        columns.append((f(F + dF) - f(F - dF)) / (2 * h))
    return np.stack(columns, axis=-1).reshape(*np.shape(columns[0]), 3, 3)


@pytest.mark.parametrize("constants", CONSTANTS)
@pytest.mark.parametrize("seed", range(4))
def test_stress_is_the_derivative_of_the_energy(constants, seed):
    F = random_F(seed)
    P, _ = stress(F, constants)
    expected = central(lambda G: isochoric_energy(G, np.linalg.det(G), constants), F, 1e-6)
    np.testing.assert_allclose(P, expected, rtol=1e-7, atol=1e-7 * np.abs(P).max())


@pytest.mark.parametrize("constants", CONSTANTS)
@pytest.mark.parametrize("seed", range(4))
def test_tangent_is_the_derivative_of_the_stress_and_symmetric(constants, seed):
    F = random_F(seed)
    _, A = stress(F, constants)
    expected = central(lambda G: stress(G, constants)[0], F, 1e-6)
    np.testing.assert_allclose(A, expected, atol=2e-8 * np.abs(A).max())
    np.testing.assert_allclose(A, A.transpose(2, 3, 0, 1), atol=1e-12 * np.abs(A).max())


def test_cofactor_is_J_times_inverse_transpose():
    F = random_F(7)
    cof = np.empty((3, 3))
    J = cofactor(F, cof)
    np.testing.assert_allclose(J, np.linalg.det(F), rtol=1e-13)
    np.testing.assert_allclose(cof, J * np.linalg.inv(F).T, rtol=1e-12)


@pytest.mark.parametrize("constants", CONSTANTS)
def test_energy_does_not_feel_rotation_or_volume_change(constants):
    F = random_F(3)
    Q, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))
    Q *= np.sign(np.linalg.det(Q))
    W = isochoric_energy(F, np.linalg.det(F), constants)
    for G in (Q @ F, F @ Q, 1.7 * F):
        np.testing.assert_allclose(isochoric_energy(G, np.linalg.det(G), constants), W, rtol=1e-12)
    P, _ = stress(F, constants)
    np.testing.assert_allclose(stress(Q @ F, constants)[0], Q @ P, atol=1e-13)


@pytest.mark.parametrize("constants", CONSTANTS)
def test_uniaxial_stress_equals_the_incompressible_closed_form(constants):
    """Nominal stress 2 (lam - lam^-2)(W1 + W2 / lam), e.g. Treloar 1975, eq. 5.35."""
    lam = 0.6
    F = np.diag([lam, lam**-0.5, lam**-0.5])
    P, _ = stress(F, constants)
    pressure = -P[1, 1] * F[1, 1]  # lateral Cauchy stress vanishes
    nominal = P[0, 0] + pressure / lam
    I1, I2 = lam**2 + 2 / lam, 2 * lam + lam**-2
    W1 = constants[0] + constants[2] * (I2 - 3)
    W2 = constants[1] + constants[2] * (I1 - 3)
    np.testing.assert_allclose(nominal, 2 * (lam - lam**-2) * (W1 + W2 / lam), rtol=1e-12)


def test_ratio_derivatives_are_those_of_the_constants():
    for j, h in enumerate(np.eye(2) * 1e-6):
        ratios = np.array([0.3, 0.2])
        slope = (from_ratios(ratios + h) - from_ratios(ratios - h)) / 2e-6
        np.testing.assert_allclose(slope, RATIO_DERIVATIVES[j], atol=1e-9)
