"""What is told of where a mesh errs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from benchmarks.mesh_places import EDGES, SHARES, spread


def test_sizes_and_correlations_of_a_known_field_are_found() -> None:
    """Within 4 standard errors of a correlation of 6,000 draws: false alarm 6e-5 (fixed seed)."""
    at = np.stack(np.meshgrid(np.arange(6) * 0.1, np.arange(6) * 0.45), axis=-1).reshape(-1, 2)
    size = np.linspace(0.5, 2.0, len(at))
    covariance = np.exp(-cdist(at, at) / 0.3) * np.outer(size, size)
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(len(at)), covariance, 6000)
    fields = np.moveaxis(draws.reshape(1000, 2, 3, len(at)), 3, 2)
    told, found = spread(fields * np.array([1.0, 20.0, 3.0]), at)
    assert np.sqrt(np.mean(found**2)) == pytest.approx(1.0)
    assert found / found[0] == pytest.approx(size / size[0], rel=0.08)
    assert told["size"] == pytest.approx(np.quantile(found, SHARES))
    apart = cdist(at, at)
    for k in (0, 4):
        between = (apart >= EDGES[k]) & (apart < EDGES[k + 1])
        expected = np.exp(-apart[between] / 0.3).mean()
        assert told["correlation"][k] == pytest.approx(expected, abs=4 / np.sqrt(6000))
