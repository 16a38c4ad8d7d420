"""Likelihood of a field whose errors have unknown sizes: noise by a factor, a discrepancy.

    Sigma(b, a) = b^2 noise + model errors + patterns^T patterns + a^2 D^T D

All that the likelihood needs of Sigma^-1 are its products with a few fields, and ln |Sigma|. As
functions of ln b and ln a these are analytic within pi / 2 of the real axis (Sigma is singular for
negative b^2 or a^2 alone), so that Chebyshev polynomials in the two meet them to rounding
(Trefethen, Approximation Theory and Approximation Practice, theorem 8.2). They are computed at the
polynomials' nodes once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve

from calib.inference.field_noise import FieldCovariance
from calib.inference.gaussian import LOG_2PI, gram_and_logdet
from calib.inference.shared_error import AlongError
from fe.response import Array

Range = tuple[float, float]

DIGITS = 11
"""decimal digits to which the polynomials meet the products, relative to the largest"""


class FieldSizes(NamedTuple):
    """Unknown sizes of the field's errors, (m,) each, or None where they are known."""

    noise: Array | None
    """factor of the SD of the noise"""
    discrepancy: Array | None
    """share by which the model errs"""


@dataclass(frozen=True)
class FieldScales:
    """Between which bounds sizes of the field's errors are unknown."""

    noise: Range | None
    """of the factor of the noise's SD; None where it is 1"""
    discrepancy: Range | None
    """of the share by which the model errs; None where it is known"""
    patterns: Array
    """(q, n_step, n_point, 3) shapes of the discrepancy at a share of 1, mm"""

    def without_step(self, index: int | None) -> FieldScales:
        """The same of all increments but one."""
        if index is None:
            return self
        return replace(self, patterns=np.delete(self.patterns, index, axis=1))

    def covariance(self, known: FieldCovariance, sizes: FieldSizes, row: int) -> FieldCovariance:
        """The covariance at the sizes of one row."""
        found = known
        if sizes.noise is not None:
            found = replace(found, noise_variance=found.noise_variance * sizes.noise[row] ** 2)
        if sizes.discrepancy is not None:
            found = found.with_patterns(sizes.discrepancy[row] * self.patterns)
        return found


def rigid_patterns(points: Array, n_step: int, translation: float, rotation: float) -> Array:
    """(q, n_step, n_point, 3) rigid motions of the front face, each increment by itself, mm.

    One SD each: `translation` mm along x, y, z; `rotation` degrees about these, small, about the
    middle of the points (n_point, 2).
    """
    x, y = (points - points.mean(axis=0)).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    motions = []
    if translation > 0:
        motions += [translation * np.outer(one, axis) for axis in np.eye(3)]
    if rotation > 0:
        turned = ((zero, zero, y), (zero, zero, -x), (-y, x, zero))  # axis x position
        motions += [np.radians(rotation) * np.stack(motion, axis=1) for motion in turned]
    if not motions:
        return np.zeros((0, n_step, len(points), 3))
    single = np.einsum("ts,kpc->ktspc", np.eye(n_step), np.array(motions))
    patterns: Array = single.reshape(-1, n_step, len(points), 3)
    return patterns


@dataclass(frozen=True)
class TabledField:
    """Products of a few fields with the inverse covariance, as polynomials of the sizes.

    The fields are k modes, q (k + 1) changes by the shared errors, and the measured field.
    """

    scales: FieldScales
    coefficients: Array
    """(n, s (s + 1) / 2 + 1) of b^2 times the upper triangle, and of ln |Sigma| - 2 n_obs ln b"""
    degrees: tuple[int, int]
    """numbers of polynomials in ln b and ln a"""
    k: int
    q: int
    n_obs: int

    @cached_property
    def _places(self) -> npt.NDArray[np.int64]:
        """(s, s) where the triangle holds each product."""
        s = self.k + self.q * (self.k + 1) + 1
        places = np.zeros((s, s), dtype=np.int64)
        upper = np.triu_indices(s)
        places[upper] = np.arange(len(upper[0]))
        places.T[upper] = places[upper]
        return places

    def along(self, weights: Array, variance: Array | None, sizes: FieldSizes) -> AlongError:
        """Log-likelihood along the shared errors, weights ~ N(weights, diag variance) integrated.

        As `ProjectedField.along`, whose products are constant.
        """
        products, logdet = self._at(sizes, len(weights))
        k, m = self.k, len(weights)
        residual = np.zeros((m, products.shape[1]))
        residual[:, :k], residual[:, -1] = -weights, 1.0
        moved = np.column_stack([np.ones(m), weights])
        ends = [residual]
        for error in range(self.q):
            end = np.zeros_like(residual)
            first = k + error * (k + 1)
            end[:, first : first + k + 1] = moved
            ends.append(end)
        solved = [np.matmul(products, end[:, :, None])[:, :, 0] for end in ends]
        gram = np.array([[np.einsum("ms,ms->m", a, b) for b in solved] for a in ends])
        if variance is not None:
            root = np.sqrt(variance).T
            matrix = root[:, None] * products[:, :k, :k].transpose(1, 2, 0) * root[None, :]
            diagonal = np.arange(k)
            matrix[diagonal, diagonal] += 1.0
            gained, extra = gram_and_logdet(matrix, np.stack([root * e[:, :k].T for e in solved]))
            gram = gram - gained
            logdet = logdet + extra
        value = -0.5 * (gram[0, 0] + logdet + self.n_obs * LOG_2PI)
        return AlongError(value, gram[0, 1:], gram[1:, 1:])

    def _at(self, sizes: FieldSizes, m: int) -> tuple[Array, Array]:
        """Products (m, s, s) and ln |Sigma| (m,) at the sizes."""
        basis = np.ones((m, 1))
        pairs = zip((self.scales.noise, self.scales.discrepancy), sizes, self.degrees, strict=True)
        for bounds, size, degree in pairs:
            if bounds is not None and size is not None:
                own = np.polynomial.chebyshev.chebvander(_unit(np.log(size), bounds), degree - 1)
                basis = (basis[:, :, None] * own[:, None]).reshape(m, -1)
        found = basis @ self.coefficients
        factor = np.ones(m) if sizes.noise is None else sizes.noise
        products = found[:, :-1][:, self._places] / (factor**2)[:, None, None]
        return products, found[:, -1] + 2.0 * self.n_obs * np.log(factor)


def tabled(
    difference: Array, covariance: FieldCovariance, modes: Array, shared: Array, scales: FieldScales
) -> TabledField:
    """Tables for a measured field minus the offset (n_step, n_point, 3).

    `covariance` with a noise of factor 1 and without the discrepancy; `modes` (k, ...) and `shared`
    (q, k + 1, ...) as in `calib.inference.field_likelihood.project`.
    """
    fields = np.concatenate([modes, shared.reshape(-1, *difference.shape), difference[None]])
    s, n_known = len(fields), len(covariance.patterns)
    rotated = covariance.rotated(np.concatenate([fields, covariance.patterns, scales.patterns]))
    factors, sizes = (_nodes(bounds) for bounds in (scales.noise, scales.discrepancy))
    upper = np.triu_indices(s)
    rows = []
    for factor in factors:
        noise = covariance.noise_variance * factor**2
        blocks = replace(covariance, noise_variance=noise, patterns=covariance.patterns[:0])
        white = blocks.white_of(rotated)
        gram, logdet = _eliminated(white @ white.T, s, n_known)
        for products, more in _with_discrepancy(gram, s, sizes):
            found = factor**2 * products[upper]
            constant = blocks.logdet + logdet + more - 2.0 * difference.size * np.log(factor)
            rows.append(np.append(found, constant))
    table = np.array(rows).reshape(len(factors), len(sizes), -1)
    table = np.einsum("in,nkv->ikv", _to_coefficients(len(factors)), table)
    table = np.einsum("jk,ikv->ijv", _to_coefficients(len(sizes)), table)
    return TabledField(
        scales,
        np.ascontiguousarray(table.reshape(-1, table.shape[-1])),
        (len(factors), len(sizes)),
        len(modes),
        len(shared),
        difference.size,
    )


def _eliminated(gram: Array, s: int, n: int) -> tuple[Array, float]:
    """Products of all but the n known patterns that follow the first s, and their ln |I + K|."""
    if not n:
        return gram, 0.0
    own = slice(s, s + n)
    factor = cho_factor(np.eye(n) + gram[own, own], lower=True)
    kept = np.delete(np.arange(len(gram)), np.arange(s, s + n))
    cross = gram[own][:, kept]
    logdet = 2.0 * float(np.log(np.diag(factor[0])).sum())
    return gram[np.ix_(kept, kept)] - cross.T @ cho_solve(factor, cross), logdet


def _with_discrepancy(gram: Array, s: int, sizes: Array) -> list[tuple[Array, float]]:
    """Products of the first s fields and ln |I + a^2 K| at each SD a, by the eigenvalues of K."""
    if len(gram) == s:
        return [(gram, 0.0)] * len(sizes)
    values, vectors = np.linalg.eigh(gram[s:, s:])
    values = np.maximum(values, 0.0)
    seen = gram[:s, s:] @ vectors
    found = []
    for size in sizes:
        weight = size**2 / (1.0 + size**2 * values)
        found.append(
            (gram[:s, :s] - (seen * weight) @ seen.T, float(np.log1p(size**2 * values).sum()))
        )
    return found


def _nodes(bounds: Range | None) -> Array:
    """Sizes at the Chebyshev points of their logarithm; one, of 1, where the size is known."""
    if bounds is None:
        return np.ones(1)
    half = 0.5 * float(np.log(bounds[1] / bounds[0]))
    pole = 0.5 * np.pi / half
    n = int(np.ceil(DIGITS * np.log(10.0) / np.arcsinh(pole))) + 2
    points = np.polynomial.chebyshev.chebpts1(n)
    sizes: Array = np.sqrt(bounds[0] * bounds[1]) * np.exp(half * points)
    return sizes


def _unit(log_size: Array, bounds: Range) -> Array:
    """Place in [-1, 1] of a logarithm between those of the bounds."""
    low, high = np.log(bounds)
    unit: Array = np.clip((2.0 * log_size - low - high) / (high - low), -1.0, 1.0)
    return unit


def _to_coefficients(n: int) -> Array:
    """(n, n) takes values at n Chebyshev points to coefficients."""
    points = np.polynomial.chebyshev.chebpts1(n) if n > 1 else np.zeros(1)
    values = np.polynomial.chebyshev.chebvander(points, n - 1)
    return np.asarray(np.linalg.inv(values), dtype=np.float64)
