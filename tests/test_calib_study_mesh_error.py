"""What two meshes differ by: corrected to first order, and what is left of it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_models import AnalyticBlock
from test_calib_inference_forward import BLOCK, scaled

from calib.data import Dataset, FieldData
from calib.inference import EmulatorForward, NoiseSettings, build_likelihood
from calib.inference.field_floor import FieldFloor, local_profile
from calib.inference.field_noise import field_covariance
from calib.inference.forward import Jacobian
from calib.inference.noise import COMPLIANCE, FACE, ZERO, field_nuisances
from calib.inference.tangent_errors import (
    FOLLOWED,
    Mistaken,
    mistaken,
    patterns_at,
    tangents_at,
    with_nuisances,
)
from calib.study.assumptions import assumptions_table
from calib.study.config import load_study
from calib.study.mesh_error import FORCE_BEYOND, MeshError, left_share, mesh_error
from calib.study.mesh_error_file import load_mesh_error, save_mesh_error
from calib.study.plans import Errors, planned_likelihood
from calib.study.tables import mesh_table
from fe.campaign import CampaignFailed
from fe.campaign_result import Campaign
from fe.response import Array, Response, Status

CHECKS = np.array([[0.3, 0.2], [0.45, 0.15]])
EXTENT = np.array([1.0, 0.5])


def runs(block: AnalyticBlock, ratios: Array) -> Campaign:
    return Campaign(ratios, tuple(block(x) for x in ratios), n_reused=0)


def finer(response: Response, ratios: Array) -> Response:
    """As a finer mesh would say: other by what is linear in the ratios."""
    rng = np.random.default_rng(3)
    by_field = 0.02 * rng.normal(size=(*response.displacement.shape, 2))
    return replace(
        response,
        force=0.97 * response.force,
        force_gradient=0.97 * response.force_gradient,
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


def test_a_difference_that_is_linear_in_the_ratios_is_corrected_to_second_order() -> None:
    # Derivatives are followed less and less: by the cube of the distance over the reach.
    error, off = mesh_error(*both(CHECKS), 1.5, "stuck", 50.0 * EXTENT), []
    for distance in (0.4, 0.2, 0.1):
        ratios = CHECKS[-1] + distance * np.array([1.0, -0.5])
        coarse = BLOCK(ratios)
        found, expected = error.correction.response(coarse, ratios), finer(coarse, ratios)
        assert found.force == pytest.approx(expected.force, rel=1e-12)
        assert found.force_gradient == pytest.approx(expected.force_gradient, rel=1e-10)
        assert found.displacement == pytest.approx(expected.displacement, abs=1e-4)
        off.append(np.abs(found.displacement - expected.displacement).max())
    assert off[0] / off[1] == pytest.approx(8.0, rel=0.05)
    assert off[1] / off[2] == pytest.approx(8.0, rel=0.05)
    # Nothing of what the two checks differ by is left to be stated.
    share = 1.5 / (1.5**2 - 1)
    size = np.mean(error.field**2, axis=(0, 2))
    assert error.field_floor.sd == pytest.approx(share * np.sqrt(size), rel=1e-4)


def test_fields_at_first_order_are_left_with_more_and_forces_are_not() -> None:
    fine, coarse = both(CHECKS[:1])
    smooth = mesh_error(fine, coarse, 2.0, "stuck", EXTENT)
    glued = mesh_error(fine, coarse, 2.0, "stuck", EXTENT, field_order=1.0)
    # half of 3 / (2^2 - 1), and of 3 / (2 - 1)
    assert smooth.left == pytest.approx((0.5, 0.5)) and glued.left == pytest.approx((0.5, 1.5))
    np.testing.assert_allclose(glued.force, smooth.force, rtol=1e-12)
    np.testing.assert_allclose(glued.field_floor.sd, 3.0 * smooth.field_floor.sd, rtol=1e-10)
    np.testing.assert_array_equal(glued.correction.force, smooth.correction.force)
    np.testing.assert_array_equal(glued.correction.field, smooth.correction.field)


def test_the_correction_goes_on_by_the_derivatives_of_the_last_check() -> None:
    """Those of the check before are of another place: here three times as large."""
    fine, coarse = both(CHECKS)
    first = fine.responses[0]
    change = first.displacement_gradient - coarse.responses[0].displacement_gradient
    other = replace(first, displacement_gradient=first.displacement_gradient + 2.0 * change)
    error = mesh_error(
        replace(fine, responses=(other, *fine.responses[1:])), coarse, 1.5, "stuck", EXTENT
    )
    assert error.slopes is not None and error.correction.slopes is not None
    assert np.array_equal(error.correction.slopes.field, -error.slopes.field[-1])
    assert error.slopes.field[0] == pytest.approx(3.0 * error.slopes.field[-1], rel=1e-6)


def test_the_last_two_checks_that_got_to_the_end_tell_the_error() -> None:
    fine, coarse = both(np.vstack([[[0.8, 0.4]], CHECKS, [[0.5, 0.1]]]))
    failed = replace(fine.responses[3], reached=0.5, status=Status.STOPPED)
    fine = replace(fine, responses=(*fine.responses[:3], failed))
    error = mesh_error(fine, coarse, 1.5, "stuck", EXTENT)
    np.testing.assert_array_equal(error.ratios, CHECKS)
    assert error.slopes is not None and len(error.slopes.field) == 2


@pytest.mark.parametrize("unknown", ["gradient", "stability", "box"])
def test_without_derivatives_to_trust_the_correction_is_the_mean(unknown: str) -> None:
    fine, coarse = both(CHECKS)
    first = fine.responses[0]
    nothing = np.full_like(first.displacement_gradient, np.nan)
    pivots = np.arange(first.travel.size) == first.travel.size - 1
    spoilt = {
        "gradient": replace(first, displacement_gradient=nothing),
        "stability": replace(first, negative_pivots=pivots.astype(np.int64)),
        "box": first,
    }[unknown]
    fine = replace(fine, responses=(spoilt, fine.responses[1]))
    extent = None if unknown == "box" else EXTENT
    error = mesh_error(fine, coarse, 1.5, "stuck", extent)
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
    np.testing.assert_allclose(
        error.field_floor.sd**2, 1.44 * (field**2).mean(axis=(0, 2)) + spread
    )
    one = MeshError(1.5, error.ratios[:1], signed[:1], field[:1])
    np.testing.assert_allclose(one.field_floor.sd**2, 1.44 * (field[:1] ** 2).mean(axis=(0, 2)))


def test_patterns_are_changes_of_each_constant_and_equal_checks_count_as_one() -> None:
    forward, data = EmulatorForward(scaled(), with_field=True), dataset()
    noise = NoiseSettings(compliance_sd=0.01, gain_sd=0.01)
    place = CHECKS[:1]
    once = mesh_error(*both(place), 1.5, "stuck", EXTENT)
    twice = mesh_error(*both(np.repeat(place, 2, axis=0)), 1.5, "stuck", EXTENT)
    found = once.field_patterns(data, noise, forward)
    assert found is not None
    again = twice.field_patterns(data, noise, forward)
    np.testing.assert_allclose(again, found, atol=1e-8)
    theta = np.array([1.0, *place[0]])
    nuisances = field_nuisances(data, noise)
    tangents = tangents_at(forward, theta, nuisances)
    step, basis = 1e-4, forward.field_basis
    assert basis is not None
    for column in range(2):
        moved = [theta + sign * step * np.eye(3)[1 + column] for sign in (1, -1)]
        fields = [basis.fields(forward.predict(t[None]).weights)[0] for t in moved]
        slope = (fields[0] - fields[1]) / (2 * step)
        assert tangents[column] == pytest.approx(slope, abs=1e-5 * np.abs(slope).max())
    likelihood = build_likelihood(data, forward, noise)
    assert likelihood.field is not None
    by_sd = likelihood.field.shared(basis.fields(forward.predict(theta[None]).weights))[:, 0]
    names = [error.name for error in likelihood.errors.shared]
    for error, tangent in zip(nuisances, tangents[2:], strict=True):
        assert error.sd * tangent == pytest.approx(by_sd[names.index(error.name)])
    sd = once.mistaken(data, noise, forward)
    assert sd.names == (ZERO, COMPLIANCE) and np.all(sd.ratios > 1e-4)
    assert np.all(np.diag(sd.nuisances) < np.square([noise.travel_zero_sd, noise.compliance_sd]))
    np.testing.assert_allclose(found[:4], sd.patterns(tangents))


def curvature(forward: EmulatorForward, ratios: Array, a: int, b: int) -> Array:
    """Second derivative of the field by two ratios, of predictions alone, mm."""
    basis, step = forward.field_basis, 0.01 * np.eye(2)
    assert basis is not None
    found = np.zeros_like(basis.offset)
    for by_a, by_b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        theta = np.append(1.0, ratios + by_a * step[a] + by_b * step[b])
        found += by_a * by_b * basis.fields(forward.predict(theta[None]).weights)[0]
    return found / (2 * 0.01) ** 2


def test_shapes_turn_by_the_second_derivatives_over_the_errors_of_the_ratios() -> None:
    forward, data = EmulatorForward(scaled(), with_field=True), dataset()
    noise = NoiseSettings(travel_zero_sd=0.0)
    error = mesh_error(*both(CHECKS[:1]), 1.5, "stuck", EXTENT)
    found, sd = error.field_patterns(data, noise, forward), error.mistaken(data, noise, forward)
    assert found is not None and len(found) == 2 + 4
    reach = np.minimum(sd.ratios, FOLLOWED * EXTENT)
    largest = 0.0
    for a in range(2):
        for b in range(2):
            second = curvature(forward, CHECKS[0], a, b)
            expected = reach[a] * sd.ratios[b] * second
            bound = 0.02 * np.abs(expected).max() + 1e-6
            assert found[2 + 2 * a + b] == pytest.approx(expected, abs=bound)
            largest = max(largest, np.abs(expected).max())
    assert largest > 1e-4  # a hundred times the bound


def test_a_check_outside_of_the_emulators_box_counts_as_one_at_its_edge() -> None:
    forward, data = EmulatorForward(scaled(), with_field=True), dataset()
    error = mesh_error(*both(CHECKS[:1]), 1.5, "stuck", EXTENT)
    edge = replace(error, ratios=np.clip(CHECKS[:1] - 2.0, *forward.bounds.T))
    beyond = replace(error, ratios=CHECKS[:1] - 2.0)
    stated = (one.field_patterns(data, NoiseSettings(), forward) for one in (edge, beyond))
    np.testing.assert_array_equal(*stated)


def test_shapes_turn_as_far_at_the_edge_of_the_box_and_not_beyond_it() -> None:
    forward, seen = EmulatorForward(scaled(), with_field=True), []
    low = forward.bounds[:, 0]
    predict = forward.jacobian

    def watched(theta: Array) -> Jacobian:
        seen.append(theta[0, 1:])
        return predict(theta)

    found = Mistaken(np.array([0.05, 0.02]), (), np.zeros((0, 0)), forward.bounds)
    inside = patterns_at(found, forward, np.append(1.0, low + found.ratios), ())
    forward.jacobian = watched  # type: ignore[method-assign]
    edge = patterns_at(found, forward, np.append(1.0, low), ())
    assert np.all(np.array(seen) >= low)
    # Second derivatives hardly change over the errors.
    change = np.abs(edge[2:] - inside[2:]).max(axis=(1, 2, 3))
    assert np.all(change < 0.3 * np.abs(inside[2:]).max(axis=(1, 2, 3)))
    # Nor where the mesh was checked outside of it.
    beyond = patterns_at(found, forward, np.append(1.0, low - 0.3), ())
    np.testing.assert_array_equal(beyond[2:], edge[2:])
    # A ratio that does not err turns nothing.
    still = replace(found, ratios=np.array([0.05, 0.0]))
    assert len(patterns_at(still, forward, np.append(1.0, low), ())) == 2 + 2


def test_constants_that_the_field_hardly_tells_apart_stay_within_their_box() -> None:
    forward, data, noise = EmulatorForward(scaled(), with_field=True), dataset(), NoiseSettings()
    error = mesh_error(*both(CHECKS[:1]), 1.5, "stuck", EXTENT)
    free = replace(error, extent=None).mistaken(data, noise, forward).ratios
    wide = replace(error, extent=1e3 * EXTENT).mistaken(data, noise, forward).ratios
    np.testing.assert_allclose(wide, free, rtol=1e-4)
    narrow = replace(error, extent=1e-6 * EXTENT).mistaken(data, noise, forward)
    assert np.all(narrow.ratios < 1e-6 * EXTENT)


def test_the_model_at_the_last_check_is_the_corrected_one_and_its_derivatives() -> None:
    error = mesh_error(*both(CHECKS), 1.5, "stuck", EXTENT, under_stiffer_pin(CHECKS))
    assert error.at_check is not None

    def corrected(ratios: Array) -> Array:
        return error.correction.response(BLOCK(ratios), ratios).displacement

    np.testing.assert_allclose(error.at_check.field, corrected(CHECKS[-1]), atol=1e-12)
    for tangent, step in zip(error.at_check.tangents, 1e-5 * np.eye(2), strict=True):
        slope = (corrected(CHECKS[-1] + step) - corrected(CHECKS[-1] - step)) / 2e-5
        np.testing.assert_allclose(tangent, slope, atol=1e-7)
    assert mesh_error(*both(CHECKS), 1.5, "stuck").at_check is None


def test_errors_of_ratios_do_not_hang_on_how_rough_the_changes_of_an_emulator_are() -> None:
    class Rough(EmulatorForward):
        def jacobian(self, theta: Array) -> Jacobian:
            found = super().jacobian(theta)
            assert found.weights is not None
            off = np.random.default_rng(8).standard_normal(found.weights.shape)
            return Jacobian(found.force, found.weights + 0.1 * np.abs(found.weights) * off)

    error, data, noise = mesh_error(*both(CHECKS), 1.5, "stuck", EXTENT), dataset(), NoiseSettings()
    smooth, rough = (
        of(scaled(), with_field=True, correction=error.correction)
        for of in (EmulatorForward, Rough)
    )
    known = [error.mistaken(data, noise, forward).ratios for forward in (smooth, rough)]
    np.testing.assert_array_equal(*known)
    by_emulator = replace(error, at_check=None)
    asked = [by_emulator.mistaken(data, noise, forward).ratios for forward in (smooth, rough)]
    assert np.abs(asked[1] / asked[0] - 1.0).max() > 0.05
    np.testing.assert_allclose(known[0], asked[0], rtol=0.1)


def test_forces_alone_have_no_patterns() -> None:
    forward = EmulatorForward(scaled())
    bare = replace(dataset(), field=None)
    error = mesh_error(*both(CHECKS), 1.5, "stuck")
    assert error.field_patterns(bare, NoiseSettings(), forward) is None
    nothing = error.mistaken(bare, NoiseSettings(), forward)
    assert not nothing.ratios.any() and nothing.names == ()


def planned_errors(mistaken: Mistaken, noise: NoiseSettings, data: Dataset) -> Errors:
    return Errors(
        own_share=np.full(len(data.travel), 0.1),
        noise=noise,
        n_samples=5,
        discretisation=np.zeros(len(data.travel)),
        floor=FieldFloor(np.zeros((len(data.travel), 3))),
        mistaken=mistaken,
        noise_std=np.full(3, 0.01),
        length=0.5,
        reference_share=0.5,
        nugget=1e-6,
    )


def test_a_planned_experiment_errs_by_the_same_ratios() -> None:
    forward, data = EmulatorForward(scaled(), with_field=True), dataset()
    error = mesh_error(*both(CHECKS[:1]), 1.5, "stuck", EXTENT)
    mistaken = error.mistaken(data, NoiseSettings(), forward)
    assert mistaken.ratios.max() > 1e-4 and mistaken.nuisances[0, 0] > 0
    errors = planned_errors(mistaken, NoiseSettings(), data)
    theta = np.array([1.0, *CHECKS[0]])
    planned = planned_likelihood(forward, data.travel, BLOCK.points, errors, theta)
    assert planned.field is not None
    expected = error.field_patterns(data, NoiseSettings(), forward)
    assert expected is not None and len(expected) == 3 + 4
    # How the shapes turn is not known of plans by one run, and left out of all.
    np.testing.assert_allclose(planned.field.covariance.patterns, expected[:3], rtol=1e-10)


def test_without_a_zero_that_may_move_there_is_no_pattern_along_it() -> None:
    forward, data = EmulatorForward(scaled(), with_field=True), dataset()
    error = mesh_error(*both(CHECKS[:1]), 1.5, "stuck", EXTENT)
    exact = NoiseSettings(travel_zero_sd=0.0)
    found = error.field_patterns(data, exact, forward)
    assert (
        found is not None
        and len(found) == 2 + 4
        and error.mistaken(data, exact, forward).names == ()
    )
    stated = replace(data, travel_zero_sd=0.03)
    assert error.mistaken(stated, exact, forward).names == (ZERO,)


def test_the_error_of_a_scaled_block_goes_with_its_travel_and_force() -> None:
    forward, data = EmulatorForward(scaled(), with_field=True), dataset()
    error = mesh_error(*both(CHECKS[:1]), 1.5, "stuck", EXTENT)
    noise = NoiseSettings(compliance_sd=0.01, face_travel_sd=0.01, field_scale_sd=0.01)
    errors = planned_errors(error.mistaken(data, noise, forward), noise, data)
    found, small = errors.mistaken, errors.scaled(0.4, noise=1.0).mistaken
    assert small.names == found.names and len(found.names) == 4
    factor = np.sqrt(np.diag(small.nuisances) / np.diag(found.nuisances))
    np.testing.assert_allclose(factor, [0.4, 2.5, 0.4, 1.0])
    np.testing.assert_array_equal(small.ratios, found.ratios)
    planned = errors.scaled(0.4, noise=1.0).noise
    assert planned.face_travel_sd == pytest.approx(0.4 * noise.face_travel_sd)
    assert planned.travel_zero_sd == noise.travel_zero_sd


def test_a_camera_at_the_side_does_not_see_the_tilt_of_the_bar_as_travel() -> None:
    forward, data = EmulatorForward(scaled(), with_field=True), dataset()
    error = mesh_error(*both(CHECKS[:1]), 1.5, "stuck", EXTENT)
    noise = NoiseSettings(compliance_sd=0.01, face_travel_sd=0.01)
    front = planned_errors(error.mistaken(data, noise, forward), noise, data)
    side = front.beside_the_bar()
    assert front.mistaken.names == (ZERO, COMPLIANCE, FACE)
    assert side.mistaken.names == (ZERO, COMPLIANCE) and side.noise.face_travel_sd == 0.0
    np.testing.assert_array_equal(side.mistaken.nuisances, front.mistaken.nuisances[:2, :2])
    theta = np.array([1.0, *CHECKS[0]])
    planned = planned_likelihood(forward, data.travel, BLOCK.points, side, theta)
    assert [shared.name for shared in planned.errors.shared] == [ZERO, COMPLIANCE]


def test_files_before_the_extent_was_kept_tell_it_by_the_reach(tmp_path: Path) -> None:
    study = load_study("thesis-forces")
    hypothesis = study.hypotheses[0]
    error = mesh_error(*both(CHECKS), 1.5, "stuck", EXTENT)
    save_mesh_error(tmp_path, hypothesis, study, replace(error, extent=None), ["r", "s"])
    found = load_mesh_error(tmp_path, hypothesis).extent
    np.testing.assert_allclose(found, EXTENT)


@pytest.mark.parametrize("with_slopes", [True, False])
def test_a_mesh_error_is_read_as_it_was_kept(with_slopes: bool, tmp_path: Path) -> None:
    study = load_study("thesis-forces")
    hypothesis = study.hypotheses[0]
    error = mesh_error(*both(CHECKS), 1.5, "stuck", EXTENT, under_stiffer_pin(CHECKS))
    if not with_slopes:
        error = replace(error, slopes=None)
    save_mesh_error(tmp_path, hypothesis, study, error, ["r", "s"])
    found = load_mesh_error(tmp_path, hypothesis)
    np.testing.assert_array_equal(found.field, error.field)
    np.testing.assert_array_equal(found.extent, EXTENT)
    assert (found.slopes is None) is not with_slopes
    assert found.pin is not None and error.pin is not None and found.pin.stiffening == 4.0
    np.testing.assert_array_equal(found.pin.field, error.pin.field)
    np.testing.assert_array_equal(found.force, error.force)
    assert found.at_check is not None and error.at_check is not None
    np.testing.assert_array_equal(found.at_check.tangents, error.at_check.tangents)
    np.testing.assert_array_equal(found.at_check.field, error.at_check.field)
    if found.slopes is not None and error.slopes is not None:
        np.testing.assert_array_equal(found.slopes.field, error.slopes.field)
        np.testing.assert_array_equal(found.slopes.reach, error.slopes.reach)


def under_stiffer_pin(ratios: Array, times: float = 4.0) -> tuple[Campaign, float]:
    """Runs as under a pin that gives way less: forces miss 4 % less 4 % / times, fields 0.02 mm."""
    coarse, gained = runs(BLOCK, ratios), 1.0 - 1.0 / times
    stiffer = tuple(
        replace(
            run,
            force=run.force * (1.0 + 0.04 * gained),
            displacement=run.displacement - 0.02 * gained,
        )
        for run in coarse.responses
    )
    return replace(coarse, responses=stiffer), times


def test_the_correction_goes_on_to_a_rigid_pin_whatever_the_pin_of_the_check() -> None:
    coarse, ratios = runs(BLOCK, CHECKS[:1]), CHECKS[0] + [0.02, 0.0]
    expected = BLOCK(ratios)
    for times in (4.0, 8.0):
        stiffer = under_stiffer_pin(CHECKS[:1], times)
        error = mesh_error(stiffer[0], coarse, 1.5, "stuck", EXTENT, stiffer)
        found = error.correction.response(BLOCK(ratios), ratios)
        # Of forces a quotient is carried on, so that 0.04 squared is missed.
        np.testing.assert_allclose(found.force, 1.04 * expected.force, rtol=1e-3)
        np.testing.assert_allclose(found.displacement, expected.displacement - 0.02, atol=1e-9)


def test_of_the_pins_part_what_is_gone_on_by_is_stated_beside_the_meshs_share() -> None:
    fine, coarse = both(CHECKS[:1])
    for times in (4.0, 8.0):
        stiffer = under_stiffer_pin(CHECKS[:1], times)
        error = mesh_error(fine, coarse, 1.5, "stuck", EXTENT, stiffer)
        mesh = mesh_error(fine, stiffer[0], 1.5, "stuck", EXTENT)
        pin = 1.0 - 1.0 / (1.0 + 0.04 * (1.0 - 1.0 / times))
        beyond = FORCE_BEYOND * pin / (times - 1.0)
        np.testing.assert_allclose(error.force**2, mesh.force**2 + beyond**2)
        floor = mesh.field_floor.sd**2 + (0.02 / times) ** 2
        np.testing.assert_allclose(error.field_floor.sd**2, floor, rtol=1e-10)


def test_a_pin_and_a_mesh_that_cancel_leave_what_each_of_them_leaves() -> None:
    _, coarse = both(CHECKS[:1])
    error = mesh_error(coarse, coarse, 1.5, "stuck", EXTENT, under_stiffer_pin(CHECKS[:1]))
    assert not error.signed_force.any() and not error.field.any()
    pin = 0.03 / 1.03 / 3.0
    np.testing.assert_allclose(error.force, np.hypot(1.2 * 0.03, FORCE_BEYOND * pin), rtol=1e-12)
    np.testing.assert_allclose(error.field_floor.sd, 0.015 * np.hypot(1.2, 1.0 / 3.0), rtol=1e-10)
    np.testing.assert_allclose(error.correction.force, 1.0 / (1.0 - pin), rtol=1e-12)


def test_derivatives_of_the_pins_part_are_carried_on_too() -> None:
    fine, coarse = both(CHECKS[:1])
    first = coarse.responses[0]
    by_pin = np.random.default_rng(9).normal(size=first.displacement_gradient.shape)
    stiffer = replace(first, displacement_gradient=first.displacement_gradient - 0.03 * by_pin)
    under = replace(coarse, responses=(stiffer,)), 4.0
    alone = mesh_error(fine, coarse, 1.5, "stuck", EXTENT)
    error = mesh_error(fine, coarse, 1.5, "stuck", EXTENT, under)
    assert error.slopes is not None and alone.slopes is not None
    added = error.slopes.field[0] - alone.slopes.field[0]
    np.testing.assert_allclose(added, 0.01 * by_pin, atol=1e-12)
    unstable = replace(stiffer, negative_pivots=np.ones_like(stiffer.negative_pivots))
    under = replace(coarse, responses=(unstable,)), 4.0
    assert mesh_error(fine, coarse, 1.5, "stuck", EXTENT, under).slopes is None


def test_errors_of_ratios_are_those_of_mesh_and_pin_one_by_one() -> None:
    forward, data = EmulatorForward(scaled(), with_field=True), dataset()
    fine, coarse = both(CHECKS[:1])
    stiffer = under_stiffer_pin(CHECKS[:1])
    found = mesh_error(fine, coarse, 1.5, "stuck", EXTENT, stiffer)
    one = found.mistaken(data, NoiseSettings(), forward)
    under, beside = stiffer[0].displacement, left_share(1.5)
    parts = (beside * (under - fine.displacement), (coarse.displacement - under) / 3.0)
    nuisances = field_nuisances(data, NoiseSettings())
    assert found.at_check is not None
    assert data.field is not None
    tangents = with_nuisances(found.at_check.tangents, found.at_check.field, nuisances)
    held = np.append(EXTENT / np.sqrt(12.0), [error.sd for error in nuisances])
    errors = field_covariance(data.field, floor=found.field_floor)
    apart = sum(mistaken(errors, data.travel, tangents, part, held) for part in parts)
    np.testing.assert_allclose(one.ratios**2, np.diag(apart)[:2], rtol=1e-6)
    np.testing.assert_allclose(one.nuisances, apart[2:, 2:], rtol=1e-6)


def test_a_pin_that_no_run_got_through_with_is_told() -> None:
    fine, coarse = both(CHECKS)
    stiffer, times = under_stiffer_pin(CHECKS)
    stopped = tuple(replace(run, reached=0.7, status=Status.STOPPED) for run in stiffer.responses)
    with pytest.raises(CampaignFailed, match=r"sampling mesh under a stiffer pin stopped at 0\.7"):
        mesh_error(fine, coarse, 1.5, "stuck", EXTENT, (replace(stiffer, responses=stopped), times))


@pytest.mark.parametrize(("name", "order"), [("stuck", 1.0), ("sliding", 2.0)])
def test_a_study_takes_the_order_of_its_contact_and_tells_both_shares(
    name: str, order: float, tmp_path: Path
) -> None:
    study = load_study("thesis-forces")
    [hypothesis] = [one for one in study.hypotheses if one.name == name]
    error = mesh_error(*both(CHECKS), 1.6, name, EXTENT, field_order=order)
    path, _ = save_mesh_error(tmp_path, hypothesis, study, error, ["r", "s"])
    assert load_mesh_error(tmp_path, hypothesis).left == error.left
    facts = json.loads(path.read_text())
    assert facts["left_share"] == left_share(1.6)
    assert facts["field_left_share"] == left_share(1.6, order)
    said = f"{left_share(1.6):.2f} of forces, {left_share(1.6, order):.2f} of fields ({name})"
    assert said in mesh_table({name: facts}).note
    share = left_share(study.refinement(hypothesis), order)
    row = "mesh error left after the correction, SD over the measured difference"
    told = [value for label, value, _ in assumptions_table(study, dataset()).rows if label == row]
    assert any(f"{share:.2f} of fields" in value for value in told)


def test_the_table_of_meshes_tells_the_pins_part_at_each_point(tmp_path: Path) -> None:
    study = load_study("thesis-forces")
    hypothesis = study.hypotheses[0]
    error = mesh_error(*both(CHECKS), 1.5, "stuck", EXTENT, under_stiffer_pin(CHECKS))
    tables = []
    for found in (error, replace(error, pin=None)):
        path, _ = save_mesh_error(tmp_path, hypothesis, study, found, ["r", "s"])
        facts = json.loads(path.read_text())
        tables.append(mesh_table({"stuck": facts}))
    other = facts | {"coarse_cells": [12, 4, 2], "fine_cells": [16, 5, 4]}
    title = mesh_table({"stuck": facts, "sliding": other}).title
    assert "sliding: 12 x 4 x 2 against 16 x 5 x 4" in title
    told, plain = tables
    places = ["r = 0.3, s = 0.2", "r = 0.45, s = 0.15"]
    rows = [row for row in told.rows if "the pin's part" in row[0]]
    assert [row[1] for row in rows] == [places[0]] * 2 + [places[1]] * 2
    assert rows[0][2:] == tuple(["-2.91"] * len(rows[0][2:]))  # 1 / 1.03 - 1
    assert "gives way 4 times less" in told.title and "on by 0.33 times that part" in told.note
    assert len(plain.rows) == len(told.rows) - 4 and "pin" not in plain.title + plain.note


def test_the_floor_is_large_where_the_meshes_differ_under_one_pin(tmp_path: Path) -> None:
    fine, coarse = both(CHECKS)
    seen = tuple(replace(run, points=BLOCK.points) for run in fine.responses)
    stiffer, times = under_stiffer_pin(CHECKS)
    pressed = tuple(
        replace(run, displacement=run.displacement * (1.0 + 0.1 * BLOCK.points[:, :1]))
        for run in stiffer.responses
    )
    under = replace(stiffer, responses=pressed), times
    error = mesh_error(replace(fine, responses=seen), coarse, 1.5, "stuck", EXTENT, under)
    assert error.pin is not None
    expected = local_profile(BLOCK.points, error.field - error.pin.field)
    assert not np.allclose(expected, local_profile(BLOCK.points, error.field), rtol=0.05)
    assert error.field_floor.profile == pytest.approx(expected, rel=1e-12)
    study = load_study("thesis-forces")
    hypothesis = study.hypotheses[0]
    save_mesh_error(tmp_path, hypothesis, study, error, ["r", "s"])
    found = load_mesh_error(tmp_path, hypothesis)
    assert found.points is not None
    np.testing.assert_array_equal(found.points, BLOCK.points)
    assert found.field_floor.profile == pytest.approx(expected, rel=1e-12)
    # Files before points were kept: the same everywhere.
    save_mesh_error(tmp_path, hypothesis, study, replace(error, points=None), ["r", "s"])
    assert load_mesh_error(tmp_path, hypothesis).field_floor.profile is None


def test_directions_in_which_samples_differ_hide_nothing_of_the_mesh() -> None:
    forward, data = EmulatorForward(scaled(), with_field=True), dataset()
    fine, coarse = both(CHECKS[:1])
    error = mesh_error(fine, coarse, 1.5, "stuck", EXTENT)
    assert data.field is not None
    assert error.at_check is not None
    like_r = replace(data.field, patterns=0.3 * error.at_check.tangents[:1])
    with_directions = replace(data, field=like_r)
    expected = error.mistaken(data, NoiseSettings(), forward)
    found = error.mistaken(with_directions, NoiseSettings(), forward)
    np.testing.assert_array_equal(found.ratios, expected.ratios)
