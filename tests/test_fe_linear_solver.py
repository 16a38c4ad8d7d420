"""Symmetric indefinite solves: solution, inertia, and where MKL is found."""

from __future__ import annotations

import glob

import numpy as np
import scipy.sparse as sp

from fe.linear_solver import SymmetricSolver


def upper(matrix: np.ndarray) -> sp.csr_matrix:
    triangle = sp.csr_matrix(np.triu(matrix))
    triangle.sort_indices()
    return triangle


def solver_of(matrix: np.ndarray) -> tuple[SymmetricSolver, int]:
    triangle = upper(matrix)
    solver = SymmetricSolver(triangle.indptr.astype(np.int32), triangle.indices.astype(np.int32))
    return solver, solver.factorise(triangle.data)


def test_solution_and_number_of_negative_eigenvalues():
    rng = np.random.default_rng(0)
    Q, _ = np.linalg.qr(rng.standard_normal((30, 30)))
    values = np.concatenate([-rng.uniform(1, 2, 4), rng.uniform(1, 3, 26)])
    matrix = Q @ np.diag(values) @ Q.T
    matrix = (matrix + matrix.T) / 2
    solver, negative = solver_of(matrix)
    b = rng.standard_normal((30, 2))
    np.testing.assert_allclose(matrix @ solver.solve(b), b, atol=1e-12)
    assert negative == 4
    solver.close()


def test_the_second_solver_does_not_search_for_the_library(monkeypatch):
    solver_of(np.eye(3))[0].close()

    def search(*_: object, **__: object) -> None:
        raise AssertionError("searched the file system")

    monkeypatch.setattr(glob, "glob", search)
    solver, negative = solver_of(2.0 * np.eye(3))
    np.testing.assert_allclose(solver.solve(np.ones(3)), 0.5)
    assert negative == 0
    solver.close()
