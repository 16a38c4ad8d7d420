"""A posterior pushed through the forward model of a second test: means and replicates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib.inference.field_noise import field_covariance
from calib.study.block_cells import Cells, refinement
from calib.study.mesh_error import left_share
from calib.study.second_data import Rubbers, SecondData, answer_of, plate_model, solve
from calib.study.second_test import SecondTest
from fe.response import Array, Response, Status
from fe.specimens.tensile import TensileModel

N_REPLICATES = 480
"""of the measurement, shared evenly among the draws; as many as these where they are more"""
MAX_FAILED = 0.2
"""share of the draws that may fail to be solved"""


@dataclass(frozen=True)
class Predicted:
    """What the model says at n draws of the constants, without errors of the measurement."""

    answer: Array
    """(n, n_step) travel mm or force N"""
    field: Array | None
    """(n, n_step, n_point, 3) mm at the points of the data; None where these have no field"""
    n_failed: int = 0
    """draws that could not be solved, left out"""
    why_failed: str = ""
    """what happened to the first of them"""


@dataclass(frozen=True)
class Replicates:
    """The measurement made again, once for each of some predictions."""

    answer: Array
    """(m, n_step) mean of the measured number of samples"""
    sample: Array
    """(m, n_step) single samples"""
    field: Array | None
    """(m, n_step, n_point, 3) mm"""


def predict(
    test: SecondTest,
    data: SecondData,
    rubbers: Rubbers,
    progress: Callable[[int], None] | None = None,
) -> Predicted:
    """One FE solve for each draw of the material, on the sampling mesh.

    Raises ValueError when more than `MAX_FAILED` of them cannot be solved.
    """
    model = _model(test, test.mesh.sampling, data)
    found = []
    for index in range(len(rubbers.constants)):
        found.append(solve(model, rubbers, index))
        if progress is not None:
            progress(index + 1)
    good = [response for response in found if response.status is Status.CONVERGED]
    n_failed = len(found) - len(good)
    reason = next((r.message for r in found if r.status is not Status.CONVERGED), "")
    if n_failed > MAX_FAILED * len(found):
        raise ValueError(
            f"draws: {n_failed} of {len(found)} predictions could not be solved ({reason}), "
            f"expected at most {MAX_FAILED:.0%}; ask for less load"
        )
    return replace(_collected(data, good), n_failed=n_failed, why_failed=reason)


def mesh_difference(test: SecondTest, data: SecondData, rubbers: Rubbers) -> Predicted:
    """Finer minus sampling mesh at the first of the draws, one row.

    Raises ValueError when the finer mesh cannot be solved.
    """
    coarse = predict(test, data, rubbers)
    response = solve(_model(test, test.mesh.check, data), rubbers)
    if response.status is not Status.CONVERGED:
        raise ValueError(f"mesh.check: the finer mesh cannot be solved: {response.message}")
    fine = _collected(data, [response])
    if fine.field is None or coarse.field is None:
        return Predicted(fine.answer - coarse.answer, None)
    return Predicted(fine.answer - coarse.answer, fine.field - coarse.field)


def corrected(predicted: Predicted, difference: Predicted) -> Predicted:
    """The predictions taken to the finer mesh by the difference measured at one point."""
    field = predicted.field
    if field is not None and difference.field is not None:
        field = field + difference.field
    return replace(predicted, answer=predicted.answer + difference.answer, field=field)


def replicates(
    test: SecondTest,
    data: SecondData,
    predicted: Predicted,
    difference: Predicted,
    rng: np.random.Generator,
) -> Replicates:
    """Predictions with all errors: stiffness of samples, noise and scale of the field, zero, mesh.

    The stiffness of the tested samples moves answer and field together, and so does the zero of
    the travel; what is left of the mesh's error has the shape of the measured difference and the
    SD of `calib.study.mesh_error.left_share`, at second order. Scale of the field and zero err
    alike at all levels.
    """
    index = np.arange(max(N_REPLICATES, len(predicted.answer))) % len(predicted.answer)
    factor = np.linalg.cholesky(data.stiffness_covariance())
    single = rng.standard_normal((index.size, data.levels.size)) @ factor.T
    mean = rng.standard_normal(single.shape) @ factor.T / np.sqrt(data.n_samples)
    left = left_share(refinement(test.mesh.check, test.mesh.sampling))
    mesh = left * rng.standard_normal(index.size)
    softened = np.stack([data.softened(each) for each in predicted.answer])[index]
    answer = predicted.answer[index] + mesh[:, None] * difference.answer
    field = None
    if data.field is not None and predicted.field is not None and difference.field is not None:
        noise = field_covariance(data.field).sample(rng, index.size)
        changed = np.stack([data.softened(each) for each in predicted.field])[index]
        field = predicted.field[index] + mean[:, :, None, None] * changed + noise
        field += mesh[:, None, None, None] * difference.field
    zero, scale = rng.standard_normal((2, index.size))
    answer += data.travel_zero_sd * zero[:, None] * _by_travel(data, predicted.answer)[index]
    if field is not None and data.field is not None and predicted.field is not None:
        shift = data.travel_zero_sd * zero[:, None, None, None]
        field += shift * _by_travel(data, predicted.field)[index]
        field *= 1.0 + data.field.scale_sd * scale[:, None, None, None]
    return Replicates(answer + mean * softened, answer + single * softened, field)


def _by_travel(data: SecondData, values: Array) -> Array:
    """(n, n_step, ...) change of values (n, n_step, ...) per mm by which the zero is off."""
    return np.stack([data.by_travel(each) for each in values])


def _model(test: SecondTest, cells: Cells, data: SecondData) -> TensileModel:
    """Of the plate at the levels and the points of the data."""
    return plate_model(test, cells, data.levels, None if data.field is None else data.field.points)


def _collected(data: SecondData, found: list[Response]) -> Predicted:
    answer = np.array([answer_of(response, data.control) for response in found])
    if data.field is None:
        return Predicted(answer, None)
    return Predicted(answer, np.array([each.displacement for each in found]))
