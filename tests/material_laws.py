"""Constants of every law with which the tests run, all terms at work at moderate stretches."""

from __future__ import annotations

import numpy as np

from fe.materials import LAWS, Material, material
from fe.materials.invariant import cofactor
from fe.materials.isochoric import isochoric_energy, isochoric_stress
from fe.materials.material import KernelMaterial

CONSTANTS: dict[str, tuple[float, ...]] = {
    "neo-hookean": (0.3,),
    "mooney-rivlin-2": (0.2, 0.15),
    "mooney-rivlin-3": (0.2, 0.1, 0.35),
    "mooney-rivlin-c20": (0.2, 0.1, 0.25),
    "yeoh": (0.3, -0.05, 0.02),
    "ogden-1": (0.4, 2.6),
    "ogden-2": (0.5, 1.7, -0.1, -2.3),
    "ogden-3": (0.63, 1.3, 0.0012, 5.0, -0.01, -2.0),
}
assert CONSTANTS.keys() == LAWS.keys()


def make(law: str, bulk: float = np.inf, volumetric: str = "quadratic") -> Material:
    return material(law, CONSTANTS[law], bulk, volumetric)  # type: ignore[arg-type]


def energy(F: np.ndarray, m: KernelMaterial) -> float:
    """Isochoric energy as the element kernels see it."""
    return isochoric_energy(m.law, F, float(np.linalg.det(F)), m.constants)


def stress(F: np.ndarray, m: KernelMaterial) -> tuple[np.ndarray, np.ndarray]:
    """Isochoric P and dP/dF as the element kernels see them."""
    cof, P, A = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3, 3, 3))
    F = np.ascontiguousarray(F)
    J = cofactor(F, cof)
    isochoric_stress(m.law, F, cof, J, m.constants, P, A, True)
    return P, A


def rotation(seed: int) -> np.ndarray:
    Q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return Q * np.sign(np.linalg.det(Q))
