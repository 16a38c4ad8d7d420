"""The compiled elimination of many small matrices is that of LAPACK, one by one."""

from __future__ import annotations

import numpy as np
import pytest

from calib.inference.elimination import LANES
from calib.inference.gaussian import gram_and_logdet, scaled_gram_and_logdet


@pytest.mark.parametrize("m", [1, LANES - 1, LANES, 3 * LANES + 5])
@pytest.mark.parametrize("n", [1, 5, 13])
def test_gram_and_determinant_are_those_of_numpy(n: int, m: int) -> None:
    rng = np.random.default_rng(n + m)
    factor = rng.standard_normal((m, n, n + 2))
    matrices = factor @ factor.transpose(0, 2, 1)
    vectors = rng.standard_normal((m, n, 2))
    gram, logdet = gram_and_logdet(
        np.ascontiguousarray(matrices.transpose(1, 2, 0)),
        np.ascontiguousarray(vectors.transpose(2, 1, 0)),
    )
    expected = vectors.transpose(0, 2, 1) @ np.linalg.solve(matrices, vectors)
    np.testing.assert_allclose(gram.transpose(2, 0, 1), expected, rtol=1e-7)
    np.testing.assert_allclose(logdet, np.linalg.slogdet(matrices)[1], rtol=1e-9, atol=1e-9)


def test_a_scaled_precision_is_put_together_as_stated() -> None:
    rng = np.random.default_rng(1)
    factor = rng.standard_normal((7, 9))
    precision, root = factor @ factor.T, rng.random((7, 40))
    root[3] = 0.0
    vectors = rng.standard_normal((2, 7, 40))
    dense = root[:, None] * precision[:, :, None] * root + np.eye(7)[:, :, None]
    for found, expected in zip(
        scaled_gram_and_logdet(precision, root, vectors),
        gram_and_logdet(dense, vectors),
        strict=True,
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


def test_only_what_is_not_positive_definite_becomes_nan() -> None:
    matrices = np.repeat(np.eye(3)[:, :, None], LANES + 3, axis=2)
    matrices[1, 1, 4] = -1.0
    matrices[2, 2, LANES] = np.nan
    gram, logdet = gram_and_logdet(matrices, np.ones((1, 3, LANES + 3)))
    bad = np.isnan(logdet)
    assert np.flatnonzero(bad).tolist() == [4, LANES]
    assert np.isnan(gram[0, 0, bad]).all()
    assert np.all(gram[0, 0, ~bad] == 3.0)
