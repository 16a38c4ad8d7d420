"""Moments of a posterior from weighted points, however these were found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fe.response import Array


@dataclass(frozen=True)
class Moments:
    """Weighted points of a posterior."""

    x: Array
    """(n, d)"""
    weights: Array
    """(n,) summing to 1"""

    @property
    def mean(self) -> Array:
        """(d,) posterior mean of x"""
        mean: Array = self.weights @ self.x
        return mean

    @property
    def covariance(self) -> Array:
        """(d, d) posterior covariance of x"""
        off = self.x - self.mean
        covariance: Array = np.einsum("n,ni,nj->ij", self.weights, off, off)
        return covariance

    @property
    def sd(self) -> Array:
        """(d,) posterior SD of x"""
        return np.sqrt(np.diag(self.covariance))

    def relative_sd(self, values: Array) -> Array:
        """(k,) SD over mean of values (n, k) given at the points."""
        mean = self.weights @ values
        ratio: Array = np.sqrt(self.weights @ (values - mean) ** 2) / np.abs(mean)
        return ratio

    def draws(self, rng: np.random.Generator, n: int) -> Array:
        """(n, d) equally probable draws, with repetition."""
        return self.x[rng.choice(len(self.x), n, p=self.weights / self.weights.sum())]
