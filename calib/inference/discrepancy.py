"""What a forward model may err by beyond its mesh: another law, another contact.

Kennedy & O'Hagan, J. R. Stat. Soc. B 63 (2001) 425: a Gaussian error of the model, smooth over the
increments and the front face, apart from the parameters. Its size is relative, one number for
forces and field: the field, of many values, tells by its misfit how wrong the model is, and the
forces, which carry the stiffness, are believed that much less. Were the two sizes free of each
other, a wrong model that fits five forces by a wrong stiffness would be taken for right.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.distance import cdist

from calib.inference.forward import FieldBasis, ForwardModel, Jacobian, Prediction
from calib.inference.likelihood import Likelihood
from fe.response import Array

LENGTH = 1.5
"""mm over the front face, over which a model's error is correlated: parts of the pin's width"""
TRAVEL_LENGTH = 0.8
"""mm of travel, likewise: the range of the increments"""
KEPT = 0.99
"""share of the variance over the front face that the patterns hold"""


def step_discrepancy(travel: Array, length: float = TRAVEL_LENGTH) -> Array:
    """(n_step, n_step) correlation of a model's error over travels (n_step,), mm."""
    off = (travel[:, None] - travel[None, :]) / length
    correlation: Array = np.exp(-0.5 * off**2)
    return correlation


def field_discrepancy(points: Array, travel: Array, size: Array, length: float = LENGTH) -> Array:
    """(q, n_step, n_point, 3) patterns of a field's error, each of one SD, mm.

    `size` (n_step, 3) is the SD of each component at each increment, mm. Squared exponential over
    the points (n_point, 2) and the travels (n_step,) mm, each component by itself; patterns are the
    products of the leading directions over points and all over travels.
    """
    space = np.exp(-0.5 * (cdist(points, points) / length) ** 2)
    values, vectors = np.linalg.eigh(space)
    values, vectors = values[::-1], vectors[:, ::-1]
    n = int(np.searchsorted(np.cumsum(values) / values.sum(), KEPT)) + 1
    over_points = vectors[:, :n] * np.sqrt(values[:n])
    over_travel = _root(step_discrepancy(travel))
    parts = np.einsum("it,pn,ic,cd->tncipd", over_travel, over_points, size, np.eye(3))
    patterns: Array = parts.reshape(-1, len(travel), len(points), 3)
    return patterns


def _root(matrix: Array) -> Array:
    """Symmetric square root: of a smooth correlation a Cholesky factor may not exist."""
    values, vectors = np.linalg.eigh(matrix)
    root: Array = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return root


class DiscrepantForward:
    """A forward model whose forces err by a relative SD of `share`, smoothly over the travel."""

    def __init__(
        self, model: ForwardModel, share: float, travel: Array, length: float = TRAVEL_LENGTH
    ) -> None:
        self._model = model
        self._relative = share**2 * step_discrepancy(travel, length)

    @property
    def field_basis(self) -> FieldBasis | None:
        """That of the model."""
        return self._model.field_basis

    def predict(self, theta: Array) -> Prediction:
        """Prediction at theta (m, 3), the error in the covariance of the forces."""
        stated = self._model.predict(theta)
        force = stated.force
        covariance = force[:, :, None] * force[:, None, :] * self._relative
        if stated.force_covariance is not None:
            covariance = covariance + stated.force_covariance
        return replace(stated, force_covariance=covariance)

    def jacobian(self, theta: Array) -> Jacobian:
        """That of the model's means."""
        return self._model.jacobian(theta)


def with_discrepancy(
    likelihood: Likelihood,
    travel: Array,
    points: Array,
    share: float,
    *,
    force_length: float = TRAVEL_LENGTH,
) -> Likelihood:
    """The likelihood of a model that errs by a relative SD of `share`.

    `force_length` is the travel, mm, over which the error of the forces is correlated.

    In the field it is that share of the root mean square over the points of the predicted
    displacement's offset, at each increment; the larger of the components counts for all, since a
    wrong contact moves material sideways where the model has it move down.
    Raises ValueError for a share that is not positive.
    """
    if not share > 0:
        raise ValueError(f"share: expected a positive relative SD, got {share}")
    forward = DiscrepantForward(likelihood.forward, share, travel, force_length)
    field = likelihood.field
    if field is None:
        return likelihood.with_forward(forward)
    rms = np.sqrt(np.mean(field.basis.offset**2, axis=1))
    size = share * np.repeat(rms.max(axis=1)[:, None], 3, axis=1)
    patterns = field_discrepancy(points, travel, size)
    covariance = field.covariance.with_patterns(patterns)
    return replace(likelihood, forward=forward, field=replace(field, covariance=covariance))
