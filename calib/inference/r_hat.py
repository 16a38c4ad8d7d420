"""Rank-normalised split R-hat of independent ensembles.

Vehtari, Gelman, Simpson, Carpenter, Buerkner, Bayesian Analysis 16 (2021) 667, Eqs. 3-4 and 13: the
larger of that of the ranks and that of the ranks of the distances from the median.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri
from scipy.stats import rankdata

from fe.response import Array


def r_hat(chains: Array) -> float:
    """R-hat of chains (n_chain, n_draw), each split in halves; infinite below 4 draws."""
    n_draw = chains.shape[1]
    half = n_draw // 2
    if half < 2:
        return float("inf")
    # As ArviZ: of an odd number of draws the middle one is left out.
    split = np.concatenate([chains[:, :half], chains[:, n_draw - half :]])
    folded = np.abs(split - np.median(split))
    return max(_plain(_normal_scores(split)), _plain(_normal_scores(folded)))


def _normal_scores(values: Array) -> Array:
    ranks = rankdata(values, method="average").reshape(values.shape)
    scores: Array = ndtri((ranks - 0.375) / (values.size + 0.25))
    return scores


def _plain(chains: Array) -> float:
    n_draw = chains.shape[1]
    within = chains.var(axis=1, ddof=1).mean()
    between = n_draw * chains.mean(axis=1).var(ddof=1)
    if not within > 0:
        return float("inf")
    return float(np.sqrt((between / within + n_draw - 1.0) / n_draw))


def r_hat_of_ensembles(chains: Array) -> Array:
    """(n,) R-hat of every coordinate of chains (n_ensemble, n_step, n_walker, n).

    An ensemble is one chain in the order of time: its walkers are not independent.
    """
    in_time = chains.reshape(len(chains), -1, chains.shape[-1])
    return np.array([r_hat(in_time[:, :, i]) for i in range(chains.shape[-1])])
