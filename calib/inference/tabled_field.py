"""Likelihood of a field whose errors have unknown sizes, by tables of products."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from calib.inference.field_noise import FieldCovariance
from calib.inference.field_scales import FieldScales, FieldSizes
from calib.inference.field_table import FieldTable
from calib.inference.gaussian import LOG_2PI, gram_and_logdet
from calib.inference.shared_error import AlongError
from fe.response import Array

SAME = 1e-10
"""share of the largest change by a shared error below which a direction of it is left out"""
LEAST = 1e-3
"""share of a direction of the modes, each of length 1, in the largest below which it is not met"""
AT_ONCE = 2**19
"""products of all parameter vectors at once: more leave the cache"""


@dataclass(frozen=True)
class TabledField:
    """Products of a few fields with the inverse covariance, at any sizes of the errors.

    The fields are k modes, the measured field less `near` of these, and what else the changes by
    shared errors are made of.
    """

    table: FieldTable
    near: Array
    """(k,) weights with which the modes come nearest to the measured field"""
    shared: Array
    """(q, k + 1, s) change of the offset and the modes by one SD of each shared error, in fields"""
    n_obs: int

    @property
    def rows(self) -> int:
        """Number of parameter vectors that are worked on at once."""
        return max(AT_ONCE // self.table.s**2, 1)

    @cached_property
    def _places(self) -> npt.NDArray[np.int64]:
        """(s, s) where the triangle holds each product."""
        s = self.table.s
        places = np.zeros((s, s), dtype=np.int64)
        upper = np.triu_indices(s)
        places[upper] = np.arange(len(upper[0]))
        places.T[upper] = places[upper]
        return places

    def along(self, weights: Array, variance: Array | None, sizes: FieldSizes) -> AlongError:
        """Log-likelihood along the shared errors, weights ~ N(weights, diag variance) integrated.

        As `ProjectedField.along`, whose products are constant.
        """
        m, parts = len(weights), []
        order = np.arange(m)
        if m > self.rows:  # those of one tile together, so that it is read once
            order = np.argsort(self.table.tiles(*self._sizes(sizes, m)), kind="stable")
        for start in range(0, max(m, 1), self.rows):
            rows = order[start : start + self.rows]
            own = FieldSizes(*(None if size is None else size[rows] for size in sizes))
            seen = None if variance is None else variance[rows]
            parts.append(self._along(weights[rows], seen, own))
        back = np.argsort(order)
        return AlongError(
            np.concatenate([part.value for part in parts])[back],
            np.concatenate([part.slope for part in parts], axis=-1)[..., back],
            np.concatenate([part.curvature for part in parts], axis=-1)[..., back],
        )

    def _along(self, weights: Array, variance: Array | None, sizes: FieldSizes) -> AlongError:
        """Of a few parameter vectors, whose products are held all at once."""
        m, k = weights.shape
        products, logdet = self._at(sizes, m)
        ends = np.zeros((1 + len(self.shared), m, self.table.s))
        ends[0, :, :k], ends[0, :, k] = self.near - weights, 1.0
        moved = np.column_stack([np.ones(m), weights])
        np.matmul(moved, self.shared, out=ends[1:])
        solved = np.matmul(products, ends.transpose(1, 2, 0))
        gram = np.einsum("ums,msv->uvm", ends, solved)
        if variance is not None:
            root = np.sqrt(variance).T
            matrix = root[:, None] * products[:, :k, :k].transpose(1, 2, 0) * root[None, :]
            diagonal = np.arange(k)
            matrix[diagonal, diagonal] += 1.0
            vectors = root * solved[:, :k].transpose(2, 1, 0)
            gained, extra = gram_and_logdet(matrix, vectors)
            gram = gram - gained
            logdet = logdet + extra
        value = -0.5 * (gram[0, 0] + logdet + self.n_obs * LOG_2PI)
        return AlongError(value, gram[0, 1:], gram[1:, 1:])

    @staticmethod
    def _sizes(sizes: FieldSizes, m: int) -> tuple[Array, Array]:
        """Noise and discrepancy (m,), 1 where one is known."""
        one = np.ones(m)
        return (
            one if sizes.noise is None else sizes.noise,
            one if sizes.discrepancy is None else sizes.discrepancy,
        )

    def _at(self, sizes: FieldSizes, m: int) -> tuple[Array, Array]:
        """Products (m, s, s) and ln |Sigma| (m,) at the sizes."""
        noise, discrepancy = self._sizes(sizes, m)
        found = self.table.at(noise, discrepancy)
        products = found[:, self._places] / (noise**2)[:, None, None]
        return products, found[:, -1] + 2.0 * self.n_obs * np.log(noise)


def tabled(
    difference: Array, covariance: FieldCovariance, modes: Array, shared: Array, scales: FieldScales
) -> TabledField:
    """Tables for a measured field minus the offset (n_step, n_point, 3).

    `covariance` with a noise of factor 1 and without the discrepancy; `modes` (k, ...) and `shared`
    (q, k + 1, ...) as in `calib.inference.field_likelihood.project`.
    """
    k, q = len(modes), len(shared)
    changes = shared.reshape(-1, *difference.shape)
    smallest = 1.0 if scales.noise is None else scales.noise[0]
    blocks = replace(
        covariance,
        noise_variance=covariance.noise_variance * smallest**2,
        patterns=covariance.patterns[:0],
    )
    white = blocks.white_of(blocks.rotated(np.concatenate([modes, changes, difference[None]])))
    near, within = _within(white[:k], white[k:])
    left, size, _ = np.linalg.svd(white[k:-1] - within @ white[:k], full_matrices=False)
    kept = size > SAME * np.linalg.norm(white[k:-1], axis=1).max(initial=0.0)
    along = left[:, kept]
    rest = np.tensordot(along.T / size[kept, None], changes - np.tensordot(within, modes, 1), 1)
    fields = np.concatenate([modes, (difference - np.tensordot(near, modes, 1))[None], rest])
    coordinates = np.hstack([within, np.zeros((q * (k + 1), 1)), along * size[kept]])
    return TabledField(
        FieldTable(fields, covariance, scales.patterns, scales.noise, scales.discrepancy),
        near,
        coordinates.reshape(q, k + 1, len(fields)),
        difference.size,
    )


def _within(modes: Array, fields: Array) -> tuple[Array, Array]:
    """(k,) weights of the modes that come near the last field, and (n, k) of those near the others.

    Of modes that are nearly sums of others by small weights all the same: large ones that cancel
    would take the products' rounding with them. What is not met then is left to further fields.
    """
    own = np.maximum(np.linalg.norm(modes, axis=1), np.finfo(float).tiny)
    found = np.linalg.lstsq((modes / own[:, None]).T, fields.T, rcond=LEAST)[0] / own[:, None]
    weights = np.asarray(found.T, dtype=np.float64)
    return weights[-1], weights[:-1]
