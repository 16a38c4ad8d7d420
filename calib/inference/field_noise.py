"""Covariance of the errors of a displacement field, never formed as one dense matrix.

With points P, increments I and components C the covariance is

    A (I x I)  (x)  S (P x P)  (x)  diag(noise_std^2)
      +  B_c (I x I)  (x)  L (P x P), for each component c
      +  patterns^T patterns.

S is the correlation of the measurement's noise over the points and L, with a length of its own and
larger where the model errs more, the covariance of the model's errors over them. Vectors V with
V^T S V = I and V^T L V diagonal turn the first two terms into P * C independent blocks of size
I x I; the few patterns enter by Woodbury's formula. Fields have shape (..., n_step, n_point, 3), in
mm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh
from scipy.spatial.distance import cdist

from calib.data.dataset import FieldData
from calib.data.noise_shape import correlation_at
from calib.inference.field_floor import FieldFloor
from calib.inference.point_weights import own_errors, point_weights
from fe.response import Array

# Smallest share of uncorrelated noise: smooth noise at points much closer than its length is
# singular in double precision.
NUGGET = 1e-6
FLOOR_LENGTH = 0.3
"""mm, over which the model's errors are stated as correlated: less than an element of a mesh"""
FLOOR_NUGGET = 0.1
"""share of the variance of the model's errors that is not correlated over the points"""
FLOOR_SHARED = 0.5
"""share of the variance of the model's errors that is common to all increments"""


def spatial_correlation(
    points: Array, length: float, smoothing: float = 0.0, nugget: float = NUGGET
) -> Array:
    """(n_point, n_point) correlation of the noise between points (n_point, 2), all in mm.

    `correlation_at` their distance; a share `nugget` of the variance is uncorrelated.
    """
    mixed: Array = (1.0 - nugget) * correlation_at(cdist(points, points), length, smoothing)
    mixed[np.diag_indices_from(mixed)] = 1.0
    return mixed


def step_correlation(n_step: int, reference_share: float) -> Array:
    """(n_step, n_step) correlation over increments, (1 - q) I + q 1 1^T.

    Every displacement is measured against the same reference image, whose noise is common.
    """
    if not 0 <= reference_share < 1:
        raise ValueError(f"reference_share: expected in [0, 1), got {reference_share}")
    return (1.0 - reference_share) * np.eye(n_step) + reference_share


@dataclass(frozen=True)
class FieldCovariance:
    """Covariance of field errors in factored form; build it with `field_covariance`."""

    step: Array
    """(n_step, n_step) correlation over increments"""
    vectors: Array
    """(n_point, n_point) V in columns: V^T S V = I"""
    floor_values: Array
    """(n_point,) diagonal of V^T L V"""
    correlation: Array
    """(n_point, n_point) S"""
    noise_variance: Array
    """(3,) variance of each component, mm^2"""
    floor: Array
    """(3, n_step, n_step) covariance of the model's errors over increments, mm^2"""
    patterns: Array
    """(q, n_step, n_point, 3) errors of known shape, each with a standard normal factor, mm"""

    @property
    def shape(self) -> tuple[int, int, int]:
        """(n_step, n_point, 3)"""
        return self.step.shape[0], self.floor_values.size, 3

    def with_patterns(self, patterns: Array) -> FieldCovariance:
        """The covariance with further errors of known shape (q, n_step, n_point, 3), mm."""
        if not len(patterns):
            return self
        return replace(self, patterns=np.concatenate([self.patterns, patterns]))

    def without_step(self, index: int) -> FieldCovariance:
        """The covariance of all increments but one: the marginal of the others."""
        keep = np.delete(np.arange(self.step.shape[0]), index)
        return replace(
            self,
            step=self.step[np.ix_(keep, keep)],
            floor=self.floor[:, keep[:, None], keep],
            patterns=self.patterns[:, keep],
        )

    @cached_property
    def _factors(self) -> Array:
        """(n_point, 3, n_step, n_step) lower Cholesky factors of the independent blocks."""
        noise = self.noise_variance[:, None, None] * self.step
        blocks = np.repeat(noise[None], self.floor_values.size, axis=0)
        blocks += np.multiply.outer(self.floor_values, self.floor)
        return np.asarray(np.linalg.cholesky(blocks), dtype=np.float64)

    @cached_property
    def _inverse_factors(self) -> Array:
        return np.asarray(np.linalg.inv(self._factors), dtype=np.float64)

    @cached_property
    def _whitened_patterns(self) -> Array:
        return self._whiten(self.patterns)

    @cached_property
    def _capacitance(self) -> tuple[Array, bool]:
        white = self._whitened_patterns
        factor: tuple[Array, bool] = cho_factor(np.eye(len(white)) + white @ white.T, lower=True)
        return factor

    def _whiten(self, fields: Array) -> Array:
        """(q, n_obs) fields (q, n_step, n_point, 3) in units of the block noise, uncorrelated."""
        return self.white_of(self.rotated(fields))

    def rotated(self, fields: Array) -> Array:
        """(n_point, 3, n_step, q) fields (q, n_step, n_point, 3) in the blocks' own directions.

        These depend on the correlations over the points alone, not on sizes.
        """
        q, n_step, n_point, n_component = fields.shape
        flat = fields.transpose(2, 3, 1, 0).reshape(n_point, n_component * n_step * q)
        rotated: Array = (self.vectors.T @ flat).reshape(n_point, n_component, n_step, q)
        return rotated

    def white_of(self, rotated: Array) -> Array:
        """(q, n_obs) what `rotated` gave, in units of the block noise, uncorrelated."""
        white: Array = np.matmul(self._inverse_factors, rotated)
        return white.reshape(self.step.shape[0] * self.floor_values.size * 3, rotated.shape[3]).T

    @staticmethod
    def _rotate(fields: Array, matrix: Array) -> Array:
        """Apply a (n_point, n_point) matrix over the points of (q, n_step, n_point, 3)."""
        rotated: Array = np.matmul(matrix, fields)
        return rotated

    def inner(self, left: Array, right: Array) -> Array:
        """(p, q) products left_p^T covariance^-1 right_q of fields (p, ...) and (q, ...)."""
        white_left = self._whiten(left)
        white_right = white_left if right is left else self._whiten(right)
        product: Array = white_left @ white_right.T
        if len(self.patterns):
            pattern = self._whitened_patterns
            product = product - (white_left @ pattern.T) @ cho_solve(
                self._capacitance, pattern @ white_right.T
            )
        return product

    def solve(self, fields: Array) -> Array:
        """(q, n_step, n_point, 3) covariance^-1 of fields (q, ...), 1/mm."""
        white = self._whiten(fields)
        if len(self.patterns):
            pattern = self._whitened_patterns
            white = white - (cho_solve(self._capacitance, pattern @ white.T)).T @ pattern
        blocks = white.reshape(len(fields), self.floor_values.size, 3, self.step.shape[0])
        back = np.einsum("pcji,qpcj->qipc", self._inverse_factors, blocks)
        return self._rotate(back, self.vectors)

    def applied(self, fields: Array) -> Array:
        """(q, n_step, n_point, 3) covariance times fields (q, ...), mm^3 for fields in mm."""
        noise = np.einsum("ij,qjpc,c->qipc", self.step, fields, self.noise_variance)
        found = self._rotate(noise, self.correlation)
        # L = S V diag(floor_values) V^T S
        both = self.vectors.T @ self.correlation
        smooth = both.T @ (self.floor_values[:, None] * both)
        found += self._rotate(np.einsum("cij,qjpc->qipc", self.floor, fields), smooth)
        sizes = np.tensordot(fields, self.patterns, ([1, 2, 3], [1, 2, 3]))
        total: Array = found + np.tensordot(sizes, self.patterns, 1)
        return total

    @cached_property
    def logdet(self) -> float:
        """Natural logarithm of the determinant of the covariance."""
        diagonal = np.diagonal(self._factors, axis1=2, axis2=3)
        total = 2.0 * np.log(diagonal).sum()
        # |V|^-2 = |S|, once for each increment and component.
        total -= 2.0 * np.linalg.slogdet(self.vectors)[1] * self.step.shape[0] * 3
        if len(self.patterns):
            total += 2.0 * np.log(np.diag(self._capacitance[0])).sum()
        return float(total)

    def sample(self, rng: np.random.Generator, n: int) -> Array:
        """(n, n_step, n_point, 3) independent draws, mm."""
        n_step, n_point, n_component = self.shape
        white = rng.standard_normal((n, n_point, n_component, n_step))
        blocks = np.einsum("pcij,qpcj->qipc", self._factors, white)
        weights = rng.standard_normal((n, len(self.patterns)))
        # V^-T = S V
        return self._rotate(blocks, self.correlation @ self.vectors) + np.tensordot(
            weights, self.patterns, 1
        )


def field_covariance(
    field: FieldData,
    *,
    floor: FieldFloor | float = 0.0,
    patterns: Array | None = None,
    freedom: float | None = None,
) -> FieldCovariance:
    """Covariance of the errors of `field`, without the emulator's.

    `patterns` (q, n_step, n_point, 3) are model errors of known shape [mm], to which come those of
    the field itself; `floor`, or one SD for all [mm], is for model errors of unknown shape,
    correlated over the points as exp(-d / `FLOOR_LENGTH`) and half common to all increments. Errors
    of a mesh are no smooth functions, those of stuck blocks least of all: rows of nodes that pass
    the pin's edge move it within one element. A squared exponential, which has nothing below its
    length, would take the constants from what is finer as if no mesh erred there, and so, in part,
    does a longer length; taken as independent the errors would average away.
    With `freedom` the noise is, approximately, Student-t of so many degrees: see
    `calib.inference.point_weights`.
    Raises ValueError when shapes disagree or a floor is negative.
    """
    n_step, n_point, _ = field.displacement.shape
    if patterns is None:
        patterns = np.zeros((0, n_step, n_point, 3))
    if field.patterns is not None:
        patterns = np.concatenate([field.patterns, patterns])
    if patterns.shape[1:] != (n_step, n_point, 3):
        expected = f"(q, {n_step}, {n_point}, 3)"
        raise ValueError(f"patterns: expected shape {expected}, found {patterns.shape}")
    correlation = spatial_correlation(
        field.points, field.correlation_length, field.smoothing, field.nugget
    )
    if freedom is not None:
        step = step_correlation(n_step, field.reference_share)
        weights = point_weights(field, correlation, step, freedom)
        correlation = correlation + np.diag(own_errors(weights))
    smooth = spatial_correlation(field.points, FLOOR_LENGTH, nugget=FLOOR_NUGGET)
    floors, smooth = _sized(floor, n_step, smooth)
    values, vectors = eigh(smooth, correlation)
    shared = step_correlation(n_step, FLOOR_SHARED)
    return FieldCovariance(
        step=step_correlation(n_step, field.reference_share),
        vectors=vectors,
        floor_values=values,
        correlation=correlation,
        noise_variance=field.noise_std**2,
        floor=floors.T[:, :, None] * floors.T[:, None, :] * shared,
        patterns=patterns,
    )


def _sized(floor: FieldFloor | float, n_step: int, smooth: Array) -> tuple[Array, Array]:
    """SDs (n_step, 3) mm, and the covariance over the points (n_point, n_point) in their units.

    `smooth` is the correlation over the points.
    """
    given = floor if isinstance(floor, FieldFloor) else FieldFloor(np.full((n_step, 3), floor))
    if given.sd.shape != (n_step, 3) or not np.all(given.sd >= 0):
        raise ValueError(
            f"floor: expected {n_step} x 3 SDs in mm, none of them negative, "
            f"found {given.sd.shape} of {given.sd.min()} and more"
        )
    if given.profile is None:
        return given.sd, smooth
    if given.profile.shape != (len(smooth),) or not np.all(given.profile >= 0):
        raise ValueError(
            f"floor: expected a profile of {len(smooth)} values, none of them negative, "
            f"found {given.profile.shape}"
        )
    return given.sd, given.profile[:, None] * smooth * given.profile
