"""Direct solves by each library: solution, inertia, unsymmetric matrices; where MKL is found."""

from __future__ import annotations

import glob
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from fe import (
    BlockPin,
    BlockPinModel,
    Contact,
    Status,
    linear_solver,
    negative_curvature,
    pardiso,
    seen,
)
from fe.linear_solver import SUPERLU, GeneralMatrix, Library, SymmetricSolver, installed_library
from fe.negative_curvature import SHIFTS, flip_negative, negative_directions, shifted_direction
from fe.newton import NewtonOptions, descent_direction
from fe.singular_tangent import SingularTangentError


def upper(matrix: np.ndarray) -> sp.csr_matrix:
    triangle = sp.csr_matrix(np.triu(matrix))
    triangle.sort_indices()
    return triangle


LIBRARIES = [
    pytest.param(library, id=library.name)
    for library in dict.fromkeys([installed_library(), SUPERLU])
]


def solver_of(matrix: np.ndarray, library: Library | None = None) -> tuple[SymmetricSolver, int]:
    triangle = upper(matrix)
    indptr, indices = triangle.indptr.astype(np.int32), triangle.indices.astype(np.int32)
    solver = SymmetricSolver(indptr, indices, library)
    return solver, solver.factorise(triangle.data)


def indefinite(n: int, negative: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    Q, _ = np.linalg.qr(rng.standard_normal((n, n)))
    values = np.concatenate([-rng.uniform(1, 2, negative), rng.uniform(1, 3, n - negative)])
    matrix = Q @ np.diag(values) @ Q.T
    return (matrix + matrix.T) / 2


@pytest.mark.parametrize("library", LIBRARIES)
@pytest.mark.parametrize("n_negative", [0, 4])
def test_solution_and_number_of_negative_eigenvalues(library, n_negative):
    matrix = indefinite(30, n_negative)
    solver, negative = solver_of(matrix, library)
    b = np.random.default_rng(1).standard_normal((30, 2))
    np.testing.assert_allclose(matrix @ solver.solve(b), b, atol=1e-12)
    assert negative == n_negative
    solver.close()


@pytest.mark.parametrize("library", LIBRARIES)
def test_definite_and_indefinite_matrices_may_follow_each_other(library):
    """The kind of pivots changes on the way; every solve must know of which kind its factor is."""
    solver, _ = solver_of(indefinite(30, 0), library)
    b = np.ones(30)
    for seed, n_negative in enumerate([3, 0, 0, 2, 5, 0]):
        matrix = indefinite(30, n_negative, seed)
        assert solver.factorise(upper(matrix).data) == n_negative
        np.testing.assert_allclose(matrix @ solver.solve(b), b, atol=1e-12)
    solver.close()


@pytest.mark.parametrize("library", LIBRARIES)
def test_zeros_on_the_diagonal_are_no_zero_pivots(library):
    """A saddle point: as many negative eigenvalues as constraints."""
    rng = np.random.default_rng(2)
    matrix = np.zeros((12, 12))
    matrix[:8, :8] = indefinite(8, 0)
    matrix[8:, :8] = rng.standard_normal((4, 8))
    matrix = np.tril(matrix) + np.tril(matrix, -1).T
    stored = sp.csr_matrix(np.triu(np.ones((12, 12))))  # with its zeros
    rows, columns = stored.nonzero()
    solver = SymmetricSolver(
        stored.indptr.astype(np.int32), stored.indices.astype(np.int32), library
    )
    assert solver.factorise(matrix[rows, columns]) == 4
    np.testing.assert_allclose(matrix @ solver.solve(np.ones(12)), 1.0, atol=1e-8)
    solver.close()


@pytest.mark.parametrize("library", LIBRARIES)
def test_an_unsymmetric_matrix_is_factorised_when_its_entries_are_new(library):
    rng = np.random.default_rng(3)
    solver, _ = solver_of(indefinite(20, 0), library)
    b = rng.standard_normal((20, 3))
    for _ in range(2):
        dense = indefinite(20, 0) + 0.5 * rng.standard_normal((20, 20))
        whole = sp.csr_matrix(dense)
        matrix = GeneralMatrix(whole.indptr, whole.indices, whole.data)
        before = solver.n_factorisations
        for _ in range(2):
            np.testing.assert_allclose(dense @ solver.solve_general(matrix, b), b, atol=1e-11)
        assert solver.n_factorisations == before + 1
    solver.close()


def general(dense: np.ndarray) -> GeneralMatrix:
    whole = sp.csr_matrix(dense)
    return GeneralMatrix(whole.indptr, whole.indices, whole.data)


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_matrix_near_the_symmetric_one_is_solved_without_a_factorisation(library):
    rng = np.random.default_rng(4)
    symmetric = indefinite(60, 0)
    solver, _ = solver_of(symmetric, library)
    dense = symmetric + 0.01 * rng.standard_normal((60, 60))
    b = rng.standard_normal(60)
    for tolerance in (1e-2, 1e-4, 1e-9):
        x = solver.solve_near(general(dense), b, tolerance)
        assert np.linalg.norm(dense @ x - b) <= 2.0 * tolerance * np.linalg.norm(b)
    assert solver.n_factorisations == 1
    solver.close()


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_matrix_too_far_from_the_symmetric_one_is_factorised(library):
    rng = np.random.default_rng(5)
    solver, _ = solver_of(indefinite(60, 0), library)
    dense, b = rng.standard_normal((60, 60)), rng.standard_normal(60)
    np.testing.assert_allclose(dense @ solver.solve_near(general(dense), b, 1e-3), b, atol=1e-9)
    assert solver.n_factorisations == 2
    solver.close()


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_positive_matrix_near_the_factorised_one_is_solved_without_a_factorisation(library):
    first, change = indefinite(60, 0, 7), indefinite(60, 0, 8)
    solver, _ = solver_of(first, library)
    second, b = first + 0.02 * change, np.random.default_rng(7).standard_normal(60)
    for tolerance in (1e-2, 1e-4, 1e-9):
        x = solver.solve_positive(upper(second).data, b, tolerance)
        assert np.linalg.norm(second @ x - b) <= 1.01 * tolerance * np.linalg.norm(b)
    assert solver.n_factorisations == 1
    solver.close()


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_matrix_that_curves_down_is_left_to_a_factorisation(library):
    """So is one that is about an indefinite factor, and one that is too far from the factor."""
    b = np.random.default_rng(9).standard_normal(60)
    positive, far = indefinite(60, 0, 9), indefinite(60, 0, 10)
    solver, _ = solver_of(positive, library)
    assert solver.solve_positive(upper(indefinite(60, 1, 9)).data, b, 1e-6) is None
    assert solver.solve_positive(upper(far).data, b, 1e-9) is None
    solver.factorise(upper(indefinite(60, 1, 9)).data)
    assert solver.solve_positive(upper(positive).data, b, 1e-2) is None
    solver.close()


def test_a_factor_that_is_there_changes_no_bit():
    rng = np.random.default_rng(6)
    symmetric = indefinite(60, 0)
    solver, _ = solver_of(symmetric)
    matrix = general(symmetric + 0.01 * rng.standard_normal((60, 60)))
    b = rng.standard_normal(60)
    before = solver.solve_near(matrix, b, 1e-2)
    solver.solve_general(matrix, b)
    assert solver.solve_near(matrix, b, 1e-2).tobytes() == before.tobytes()
    solver.close()


@pytest.mark.parametrize("n_negative", [1, 3])
def test_the_flipped_direction_is_that_of_a_definite_matrix(n_negative):
    """W' K W is diagonal and negative, and b' x > 0 for any b: the energy falls along x."""
    matrix = indefinite(60, n_negative)
    solver, _ = solver_of(matrix)
    for b in np.random.default_rng(4).standard_normal((5, 60)):
        x = solver.solve(b)
        W, curvature = negative_directions(solver, x, n_negative)
        assert (curvature < 0.0).all()
        np.testing.assert_allclose(W.T @ matrix @ W, np.diag(curvature), atol=1e-10)
        flipped = flip_negative(solver, x, b, n_negative)
        assert b @ flipped > 0.0
        # on the conjugate complement of W it is the Newton direction
        rest = np.linalg.svd((matrix @ W).T)[2][n_negative:].T
        np.testing.assert_allclose(rest.T @ matrix @ (flipped - x), 0.0, atol=1e-9)
    solver.close()


@pytest.mark.parametrize("library", LIBRARIES)
def test_the_shifted_direction_is_that_of_the_least_shift_that_makes_a_matrix_definite(library):
    matrix = indefinite(60, 12, seed=11)
    solver, negative = solver_of(matrix, library)
    assert negative == 12
    values, modes = np.linalg.eigh(matrix)
    b = 10.0 * modes[:, 0] + np.random.default_rng(12).standard_normal(60)  # Newton's goes up
    found = shifted_direction(solver, b)
    size = np.median(np.abs(np.diag(matrix)))
    shift = next(s for s in SHIFTS if values[0] + s * size > 0.0)
    assert shift > SHIFTS[0]
    expected = np.linalg.solve(matrix + shift * size * np.eye(60), b)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert b @ found > 0.0 > b @ np.linalg.solve(matrix, b)
    solver.close()


@pytest.mark.parametrize("rubs", [False, True])
@pytest.mark.parametrize("most", [11, 12])
def test_many_negative_modes_shift_the_tangent_where_nothing_rubs(rubs, most):
    matrix = indefinite(60, 12, seed=11)
    solver, negative = solver_of(matrix)
    gradient = -np.linalg.eigh(matrix)[1][:, 0] - np.random.default_rng(12).standard_normal(60)
    options = NewtonOptions(max_negative_modes=most)
    potential = SimpleNamespace(has_friction=rubs)
    found = descent_direction(potential, solver, gradient, options, negative)
    assert gradient @ found < 0.0
    plain = np.linalg.solve(matrix, -gradient)
    is_shifted = not (rubs or most == 12)
    again, _ = solver_of(matrix)
    shifted = shifted_direction(again, -gradient)
    assert np.allclose(found, shifted) == is_shifted
    assert np.allclose(np.abs(found), np.abs(plain)) == (rubs and most == 11)
    assert solver.factorise(solver.data) == (0 if is_shifted else 12)


def test_a_tangent_that_no_shift_makes_definite_is_told(monkeypatch):
    monkeypatch.setattr(negative_curvature, "SHIFTS", (1e-6, 1e-5))
    solver, _ = solver_of(indefinite(60, 12, seed=11))
    with pytest.raises(SingularTangentError, match="indefinite with 1e-05 times the median"):
        shifted_direction(solver, np.ones(60))


@pytest.mark.parametrize("contact", [Contact("slide", "slide"), Contact(0.3, 0.2)], ids=str)
def test_a_block_comes_out_the_same_with_and_without_mkl(monkeypatch, contact):
    if installed_library() == SUPERLU:
        pytest.skip("MKL is not installed")
    model = BlockPinModel(BlockPin(), contact, (4, 2, 1), (0.1, 0.3))
    by_mkl = model([0.5, 0.05])
    for module in (linear_solver, seen):
        monkeypatch.setattr(module, "installed_library", lambda: SUPERLU)
    by_scipy = model([0.5, 0.05])
    assert (by_mkl.solver, by_scipy.solver) == ("MKL Pardiso", "SciPy SuperLU")
    np.testing.assert_allclose(by_scipy.force, by_mkl.force, rtol=1e-9)
    np.testing.assert_allclose(by_scipy.force_gradient, by_mkl.force_gradient, rtol=1e-7)
    np.testing.assert_array_equal(by_scipy.negative_pivots, by_mkl.negative_pivots)


def test_the_second_solver_does_not_search_for_the_library(monkeypatch):
    solver_of(np.eye(3))[0].close()

    def search(*_: object, **__: object) -> None:
        raise AssertionError("searched the file system")

    monkeypatch.setattr(glob, "glob", search)
    solver, negative = solver_of(2.0 * np.eye(3))
    np.testing.assert_allclose(solver.solve(np.ones(3)), 0.5)
    assert negative == 0
    solver.close()


@pytest.mark.parametrize("contact", [Contact("slide", "slide"), Contact(0.3, 0.2)], ids=str)
@pytest.mark.parametrize("once", [True, False], ids=["once", "always"])
def test_a_factorisation_that_fails_cuts_the_step_or_ends_the_run_with_a_status(
    monkeypatch, contact, once
):
    if installed_library() == SUPERLU:
        pytest.skip("MKL is not installed")
    model = BlockPinModel(BlockPin(), contact, (3, 2, 1), (0.05, 0.2), field_grid=(2, 2))
    expected = model([0.5, 0.05])
    factorise, calls = pardiso.PardisoMatrix.factorise, []

    def failing(self: pardiso.PardisoMatrix, data: np.ndarray) -> int:
        calls.append(data)
        if len(calls) == 12 or (len(calls) > 12 and not once):
            raise SingularTangentError("MKL Pardiso: error -4 in phase 22")
        return factorise(self, data)

    monkeypatch.setattr(pardiso.PardisoMatrix, "factorise", failing)
    found = model([0.5, 0.05])
    if once:
        assert found.status is Status.CONVERGED
        np.testing.assert_allclose(found.force, expected.force, rtol=1e-3)
    else:
        assert found.status is Status.STOPPED
        assert "the tangent is singular (MKL Pardiso: error -4" in found.message
        assert found.reached < 0.2
