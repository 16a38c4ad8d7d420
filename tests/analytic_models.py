"""Analytic stand-ins for the FE model, with exact derivatives, for tests of the inference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.inference.forward import FieldBasis, Jacobian, Prediction
from fe.response import Array, Response, Status

TRAVEL = np.array([0.6, 0.8, 1.0, 1.2, 1.4])
BASE = np.log(np.array([34.0, 53.0, 78.0, 113.0, 163.0]))
SLOPE_R = np.array([-0.05, -0.12, -0.22, -0.34, -0.48])
SLOPE_S = np.array([0.10, 0.28, 0.60, 1.10, 1.80])


@dataclass(frozen=True)
class AnalyticBlock:
    """Smooth log force and field of (r, s) in the shape of the thesis experiment.

    `bend` adds a curved difference, so that a block with another bend is a different model;
    solves fail where r > `r_fails`.
    """

    bend: float = 0.0
    r_fails: float = np.inf
    points: Array | None = None

    def __call__(self, ratios: Array) -> Response:
        r, s = float(ratios[0]), float(ratios[1])
        wave = np.sin(2 * r + np.arange(5)) + s * np.cos(3 * s)
        wave_r = 2 * np.cos(2 * r + np.arange(5))
        wave_s = np.cos(3 * s) - 3 * s * np.sin(3 * s)
        log_force = BASE + SLOPE_R * r * (1 + 0.3 * r) + SLOPE_S * s + self.bend * wave
        force = np.exp(log_force)
        by_r = SLOPE_R * (1 + 0.6 * r) + self.bend * wave_r
        by_s = SLOPE_S + self.bend * wave_s
        gradient = force[:, None] * np.column_stack([by_r, by_s])
        ok = r <= self.r_fails
        fill = 1.0 if ok else np.nan
        field, field_gradient = self._field(r, s)
        return Response(
            travel=TRAVEL,
            force=force * fill,
            displacement=field * fill,
            force_gradient=gradient * fill,
            displacement_gradient=field_gradient * fill,
            reached=1.4 if ok else 0.0,
            status=Status.CONVERGED if ok else Status.STOPPED,
            message="analytic",
            negative_pivots=np.zeros(5, dtype=np.int64),
            n_factorisations=0,
            seconds=0.0,
        )

    def _field(self, r: float, s: float) -> tuple[Array, Array]:
        modes = field_modes(self.points)
        w = np.array([1.0, r, r * r, s])
        by = np.array([[0.0, 0.0], [1.0, 0.0], [2 * r, 0.0], [0.0, 1.0]])
        bent = self.bend * np.array([0.0, np.sin(r), 0.0, r * s])
        by_bent = self.bend * np.array([[0, 0], [np.cos(r), 0], [0, 0], [s, r]])
        field = np.tensordot(w + bent, modes, 1)
        return field, np.einsum("kipc,kd->ipcd", modes, by + by_bent)


def field_modes(points: Array | None) -> Array:
    """(4, 5, n_point, 3) smooth shapes, mm."""
    if points is None:
        points = np.zeros((1, 2))
    x, y = points.T
    shapes = np.array([1 + x, x * y, np.sin(x), np.cos(2 * y)])
    component = np.array([[1.0, 0.4, 0.7], [0.02, 0.0, 0.01], [0.0, 0.01, 0.02], [0.03, 0.02, 0]])
    modes: Array = np.einsum("i,kp,kc->kipc", TRAVEL / 1.4, shapes, component)
    return modes


class AnalyticForward:
    """An AnalyticBlock as an emulator without or with a stated relative error of the force."""

    def __init__(self, block: AnalyticBlock, error: float = 0.0, field: bool = False) -> None:
        self.block = block
        self.error = error
        self.basis = None
        if field:
            modes = field_modes(block.points)
            self.basis = FieldBasis(np.zeros(modes.shape[1:]), modes, 1e-4 * modes[1:3])

    @property
    def field_basis(self) -> FieldBasis | None:
        return self.basis

    def predict(self, theta: Array) -> Prediction:
        kappa, r, s = theta.T
        step = np.arange(5)
        wave = np.sin(2 * r[:, None] + step) + (s * np.cos(3 * s))[:, None]
        log_force = (
            BASE
            + SLOPE_R * (r * (1 + 0.3 * r))[:, None]
            + SLOPE_S * s[:, None]
            + self.block.bend * wave
        )
        force = kappa[:, None] * np.exp(log_force)
        covariance = None
        if self.error:
            correlation = 0.5 + 0.5 * np.eye(5)
            scale = self.error * force * (1 + r[:, None])
            covariance = scale[:, :, None] * scale[:, None, :] * correlation
        if self.basis is None:
            return Prediction(force, covariance)
        weights = np.column_stack([np.ones_like(r), r, r * r, s])
        bend = self.block.bend
        weights = weights + bend * np.column_stack([0 * r, np.sin(r), 0 * r, r * s])
        variance = None
        if self.error:
            variance = np.column_stack([0 * r, 1e-3 + 0.01 * r, 2e-3 + 0 * r, 1e-3 * (1 + s)])
        return Prediction(force, covariance, weights, variance)

    def jacobian(self, theta: Array) -> Jacobian:
        runs = [self.block(ratios) for ratios in theta[:, 1:]]
        force = np.array([np.column_stack([run.force, run.force_gradient]) for run in runs])
        force = force * theta[:, 0, None, None]
        if self.basis is None:
            return Jacobian(force)
        bend = self.block.bend
        weights = []
        for r, s in theta[:, 1:]:
            by_r = [0.0, 1.0 + bend * np.cos(r), 2 * r, bend * s]
            by_s = [0.0, 0.0, 0.0, 1.0 + bend * r]
            weights.append(np.column_stack([np.zeros(4), by_r, by_s]))
        return Jacobian(force, np.array(weights))
