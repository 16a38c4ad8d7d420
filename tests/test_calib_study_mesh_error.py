"""What two meshes differ by: corrected to first order, and what is left of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_models import AnalyticBlock
from test_calib_inference_forward import BLOCK, scaled

from calib.data import Dataset, FieldData
from calib.inference import EmulatorForward
from calib.study.config import load_study
from calib.study.mesh_error import MeshError, load_mesh_error, mesh_error, save_mesh_error
from fe.campaign_result import Campaign
from fe.response import Array, Response

CHECKS = np.array([[0.3, 0.2], [0.45, 0.15]])


def runs(block: AnalyticBlock, ratios: Array) -> Campaign:
    return Campaign(ratios, tuple(block(x) for x in ratios), n_reused=0)


def finer(response: Response, ratios: Array) -> Response:
    """As a finer mesh would say: other by what is linear in the ratios."""
    rng = np.random.default_rng(3)
    by_force = 0.05 * rng.normal(size=(response.force.size, 2))
    by_field = 0.02 * rng.normal(size=(*response.displacement.shape, 2))
    factor = 0.97 * np.exp(by_force @ ratios)
    gradient = factor[:, None] * (response.force_gradient + response.force[:, None] * by_force)
    return replace(
        response,
        force=response.force * factor,
        force_gradient=gradient,
        displacement=response.displacement + 0.01 + by_field @ ratios,
        displacement_gradient=response.displacement_gradient + by_field,
    )


def both(ratios: Array) -> tuple[Campaign, Campaign]:
    coarse = runs(BLOCK, ratios)
    fine = tuple(finer(run, x) for run, x in zip(coarse.responses, ratios, strict=True))
    return replace(coarse, responses=fine), coarse


def dataset() -> Dataset:
    shape = BLOCK(CHECKS[0]).displacement.shape
    field = FieldData(
        points=BLOCK.points,
        displacement=np.zeros(shape),
        noise_std=np.full(3, 0.01),
        correlation_length=0.5,
        reference_share=0.5,
    )
    ones = np.ones(shape[0])
    travel = BLOCK(CHECKS[0]).travel
    return Dataset("synthetic", True, travel, ones, 0.1 * ones, 5, field)


def test_a_difference_that_is_linear_in_the_ratios_is_corrected_exactly() -> None:
    error = mesh_error(*both(CHECKS), 1.5, "stuck")
    for ratios in (np.array([0.1, 0.4]), np.array([0.9, 0.0])):
        coarse = BLOCK(ratios)
        found, expected = error.correction.response(coarse, ratios), finer(coarse, ratios)
        assert found.force == pytest.approx(expected.force, rel=1e-12)
        assert found.force_gradient == pytest.approx(expected.force_gradient, rel=1e-10)
        assert found.displacement == pytest.approx(expected.displacement, abs=1e-14)
        assert found.displacement_gradient == pytest.approx(expected.displacement_gradient)
    # Nothing of what the two checks differ by is left to be stated.
    share = 1.5 / (1.5**2 - 1)
    size = np.mean(error.field**2, axis=(0, 2))
    assert error.field_floor == pytest.approx(share * np.sqrt(size), rel=1e-9)


@pytest.mark.parametrize("unknown", ["gradient", "stability"])
def test_without_derivatives_to_trust_the_correction_is_the_mean(unknown: str) -> None:
    fine, coarse = both(CHECKS)
    spoilt = (
        replace(
            fine.responses[0], force_gradient=np.full_like(fine.responses[0].force_gradient, np.nan)
        )
        if unknown == "gradient"
        else replace(
            fine.responses[0], negative_pivots=np.array([0, 0, 0, 0, 1])[: fine.travel.size]
        )
    )
    fine = replace(fine, responses=(spoilt, fine.responses[1]))
    error = mesh_error(fine, coarse, 1.5, "stuck")
    assert error.slopes is None and error.correction.slopes is None
    mean = (fine.displacement - coarse.displacement).mean(axis=0)
    assert error.correction.field == pytest.approx(mean)


def test_what_is_left_is_an_index_and_what_checks_differ_by() -> None:
    rng = np.random.default_rng(5)
    signed, field = 0.02 * rng.standard_normal((2, 5)), 0.01 * rng.standard_normal((2, 5, 9, 3))
    error = MeshError(1.5, rng.random((2, 2)), signed, field)
    half_gap = np.abs(np.diff(signed, axis=0)[0]) / np.sqrt(2)
    size = np.maximum(np.sqrt((signed**2).mean(axis=0)), np.sqrt((signed**2).mean()))
    np.testing.assert_allclose(error.force**2, (1.2 * size) ** 2 + half_gap**2)
    spread = (np.diff(field, axis=0)[0] ** 2 / 2).mean(axis=1)
    np.testing.assert_allclose(error.field_floor**2, 1.44 * (field**2).mean(axis=(0, 2)) + spread)
    one = MeshError(1.5, error.ratios[:1], signed[:1], field[:1])
    np.testing.assert_allclose(one.field_floor**2, 1.44 * (field[:1] ** 2).mean(axis=(0, 2)))


def test_patterns_are_changes_of_the_ratios_and_two_equal_checks_count_as_one() -> None:
    forward = EmulatorForward(scaled(), with_field=True)
    place = CHECKS[:1]
    once = mesh_error(*both(place), 1.5, "stuck").field_patterns(dataset(), forward)
    twice = mesh_error(*both(np.repeat(place, 2, axis=0)), 1.5, "stuck")
    found = twice.field_patterns(dataset(), forward)
    assert once is not None and found is not None
    n_step = len(once)
    np.testing.assert_allclose(found[:n_step], once / np.sqrt(2))
    np.testing.assert_allclose(found[n_step:], once / np.sqrt(2))
    slope, basis = forward.jacobian(np.array([[1.0, *place[0]]])).weights, forward.field_basis
    assert slope is not None and basis is not None and basis.modes is not None
    tangents = np.tensordot(slope[0][:, 1:].T, basis.modes, 1).reshape(2, -1)
    left = once.reshape(n_step, -1).T
    by_ratio, *_ = np.linalg.lstsq(tangents.T, left)
    assert np.abs(left - tangents.T @ by_ratio).max() < 1e-12 * np.abs(left).max()
    assert np.abs(by_ratio).max() > 1e-4  # and they are not nothing


def test_forces_alone_have_no_patterns() -> None:
    forward = EmulatorForward(scaled())
    bare = replace(dataset(), field=None)
    assert mesh_error(*both(CHECKS), 1.5, "stuck").field_patterns(bare, forward) is None


@pytest.mark.parametrize("with_slopes", [True, False])
def test_a_mesh_error_is_read_as_it_was_kept(with_slopes: bool, tmp_path: Path) -> None:
    study = load_study("thesis-forces")
    hypothesis = study.hypotheses[0]
    error = mesh_error(*both(CHECKS), 1.5, "stuck")
    if not with_slopes:
        error = replace(error, slopes=None)
    save_mesh_error(tmp_path, hypothesis, study, error, ["r", "s"])
    found = load_mesh_error(tmp_path, hypothesis)
    np.testing.assert_array_equal(found.field, error.field)
    assert (found.slopes is None) is not with_slopes
    if found.slopes is not None and error.slopes is not None:
        np.testing.assert_array_equal(found.slopes.field, error.slopes.field)
        np.testing.assert_array_equal(found.slopes.log_force, error.slopes.log_force)
