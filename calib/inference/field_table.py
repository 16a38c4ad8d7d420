"""Products of a few fields with an inverse covariance whose sizes are unknown, as polynomials.

    Sigma(b, a) = b^2 noise + model errors + patterns^T patterns + a^2 D^T D

All that the likelihood needs of Sigma^-1 are its products with a few fields, and ln |Sigma|. As
functions of ln b and ln a these are analytic within pi / 2 of the real axis (Sigma is singular for
negative b^2 or a^2 alone), so that Chebyshev polynomials in the two meet them to rounding
(Trefethen, Approximation Theory and Approximation Practice, theorem 8.2). The plane of the two is
cut into tiles, of which few are ever asked for: a posterior is narrow. Within a tile the products
of all fields are sums of few functions, which a singular value decomposition finds.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve

from calib.inference.field_noise import FieldCovariance
from fe.response import Array

Range = tuple[float, float]

DIGITS = 11
"""decimal digits to which the polynomials meet the products, relative to the fields' largest"""
WIDEST = 1.0
"""largest width of a tile in the logarithm of a size"""


class Tile(NamedTuple):
    """Products over one tile: mixtures of few functions, each a polynomial."""

    functions: Array
    """(n_basis, r) coefficients of each function in the polynomials"""
    shares: Array
    """(r, s (s + 1) / 2 + 1) of each function in b^2 times the upper triangle, and in ln |Sigma|
    - 2 n_obs ln b"""


class AtNoise(NamedTuple):
    """Products at one size of the noise, as sums over the discrepancy's own directions."""

    products: Array
    """(s, s) b^2 times those without a discrepancy"""
    seen: Array
    """(s, q) b times the products of the fields with the directions"""
    values: Array
    """(q,) by which these enter: 1 / (1 / a^2 + value)"""
    logdet: float
    """ln |Sigma| - 2 n_obs ln b without a discrepancy"""


class FieldTable:
    """b^2 times products of fields (s, n_step, n_point, 3) with Sigma^-1, and ln |Sigma|.

    `covariance` is with a noise of factor 1 and without the discrepancy; `patterns` (q, ...) are
    those of a discrepancy at a share of 1. `noise` and `discrepancy` are the bounds of b and a,
    None where they are 1. Tiles are made when first asked for and kept; what is found does not
    depend on the order in which they are.
    """

    def __init__(
        self,
        fields: Array,
        covariance: FieldCovariance,
        patterns: Array,
        noise: Range | None,
        discrepancy: Range | None,
    ) -> None:
        self.s, self._n_obs = len(fields), fields[0].size
        self._covariance, self._patterns, self._fields = covariance, patterns, fields
        self._edges = _edges(noise), _edges(discrepancy)
        self._at_noise: dict[int, list[AtNoise]] = {}
        self._tiles: dict[tuple[int, int], Tile] = {}

    @cached_property
    def _rotated(self) -> Array:
        known = self._covariance.patterns
        return self._covariance.rotated(np.concatenate([self._fields, known, self._patterns]))

    def at(self, noise: Array, discrepancy: Array) -> Array:
        """(m, s (s + 1) / 2 + 1) at the sizes (m,) each, which are taken into their bounds.

        b^2 times the upper triangle of the products, and ln |Sigma| - 2 n_obs ln b.
        """
        found = np.empty((len(noise), self.s * (self.s + 1) // 2 + 1))
        places, n = self._places(noise, discrepancy), len(self._edges[1]) - 1
        of = places[0][0] * n + places[1][0]
        for tile in np.unique(of):
            rows = np.flatnonzero(of == tile)
            basis = np.ones((len(rows), 1))
            for (_, unit), edges in zip(places, self._edges, strict=True):
                own = np.polynomial.chebyshev.chebvander(unit[rows], _count(edges) - 1)
                basis = (basis[:, :, None] * own[:, None]).reshape(len(rows), -1)
            functions, shares = self._tile(int(tile) // n, int(tile) % n)
            found[rows] = (basis @ functions) @ shares
        return found

    def tiles(self, noise: Array, discrepancy: Array) -> npt.NDArray[np.int64]:
        """(m,) numbers of the tiles that hold the sizes (m,) each."""
        places = self._places(noise, discrepancy)
        numbers: npt.NDArray[np.int64] = places[0][0] * (len(self._edges[1]) - 1) + places[1][0]
        return numbers

    def _places(
        self, noise: Array, discrepancy: Array
    ) -> list[tuple[npt.NDArray[np.int64], Array]]:
        """For either size the tile's number (m,) and the place within (m,)."""
        pairs = zip((noise, discrepancy), self._edges, strict=True)
        return [_tile_of(np.log(size), edges) for size, edges in pairs]

    def _tile(self, i: int, j: int) -> Tile:
        if (i, j) not in self._tiles:
            if i not in self._at_noise:
                self._at_noise[i] = [self._with_noise(b) for b in _nodes(self._edges[0], i)]
            shares = _nodes(self._edges[1], j)
            rows = [_with_discrepancy(at, a) for at in self._at_noise[i] for a in shares]
            self._tiles[i, j] = _compressed(np.array(rows), self._counts, self._n_obs)
        return self._tiles[i, j]

    @property
    def _counts(self) -> tuple[int, int]:
        return _count(self._edges[0]), _count(self._edges[1])

    def _with_noise(self, factor: float) -> AtNoise:
        """Products at a size of the noise, all known patterns eliminated."""
        noise = self._covariance.noise_variance * factor**2
        none = self._covariance.patterns[:0]
        blocks = replace(self._covariance, noise_variance=noise, patterns=none)
        white = blocks.white_of(self._rotated)
        gram, logdet = _eliminated(white @ white.T, self.s, len(self._covariance.patterns))
        values, vectors = np.linalg.eigh(gram[self.s :, self.s :])
        return AtNoise(
            factor**2 * gram[: self.s, : self.s],
            factor * gram[: self.s, self.s :] @ vectors,
            np.maximum(values, 0.0),
            blocks.logdet + logdet - 2.0 * self._n_obs * float(np.log(factor)),
        )


def _with_discrepancy(at: AtNoise, share: float) -> Array:
    """One row of a table: products and ln |Sigma| with a discrepancy of that share."""
    weight = share**2 / (1.0 + share**2 * at.values)
    products = at.products - (at.seen * weight) @ at.seen.T
    logdet = at.logdet + float(np.log1p(share**2 * at.values).sum())
    return np.append(products[np.triu_indices(len(products))], logdet)


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


def _compressed(values: Array, counts: tuple[int, int], n_obs: int) -> Tile:
    """The tile that has the values (n_nodes, s (s + 1) / 2 + 1) at the nodes.

    To `DIGITS` of the fields' largest products with themselves, and of n_obs in ln |Sigma|.
    """
    s = int(np.sqrt(2 * (values.shape[1] - 1)))
    rows, columns = np.triu_indices(s)
    own = np.sqrt(values[:, :-1].max(axis=0)[rows == columns])
    size = np.append(np.maximum(own[rows] * own[columns], np.finfo(float).tiny), n_obs)
    left, strength, right = np.linalg.svd(values / size, full_matrices=False)
    kept = strength > 10.0**-DIGITS / np.sqrt(values.size) * strength[0]
    grid = left[:, kept].reshape(*counts, -1)
    grid = np.einsum("in,nkv->ikv", _to_coefficients(counts[0]), grid)
    grid = np.einsum("jk,ikv->ijv", _to_coefficients(counts[1]), grid)
    shares = strength[kept, None] * right[kept] * size
    return Tile(grid.reshape(-1, grid.shape[-1]), np.ascontiguousarray(shares))


def _edges(bounds: Range | None) -> Array:
    """Logarithms at which tiles begin and end; (0, 0) of a size that is known to be 1."""
    if bounds is None:
        return np.zeros(2)
    low, high = np.log(bounds)
    return np.linspace(low, high, max(int(np.ceil((high - low) / WIDEST)), 1) + 1)


def _count(edges: Array) -> int:
    """Number of polynomials in a tile."""
    half = 0.5 * float(edges[1] - edges[0])
    if half == 0.0:
        return 1
    return int(np.ceil(DIGITS * np.log(10.0) / np.arcsinh(0.5 * np.pi / half))) + 2


def _nodes(edges: Array, tile: int) -> Array:
    """Sizes at the Chebyshev points of their logarithm within a tile."""
    low, high = edges[tile : tile + 2]
    sizes: Array = np.exp(0.5 * (low + high) + 0.5 * (high - low) * _points(_count(edges)))
    return sizes


def _tile_of(log_size: Array, edges: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """Number of the tile of each logarithm, and its place within, in [-1, 1]."""
    n, width = len(edges) - 1, float(edges[1] - edges[0])
    if width == 0.0:
        return np.zeros(len(log_size), dtype=np.int64), np.zeros(len(log_size))
    away = np.clip((log_size - edges[0]) / width, 0.0, n)
    tile = np.minimum(np.floor(np.nan_to_num(away)), n - 1).astype(np.int64)
    return tile, 2.0 * (away - tile) - 1.0


def _points(n: int) -> Array:
    points: Array = np.polynomial.chebyshev.chebpts1(n) if n > 1 else np.zeros(1)
    return points


def _to_coefficients(n: int) -> Array:
    """(n, n) takes values at n Chebyshev points to coefficients."""
    values = np.polynomial.chebyshev.chebvander(_points(n), n - 1)
    return np.asarray(np.linalg.inv(values), dtype=np.float64)
