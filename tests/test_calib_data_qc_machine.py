"""Force and travel of a test-machine record: zero, slack, compliance, holds, cycles, relaxation."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from closed_form_laboratory import HOLD, INCREMENT, Truth, force_at, machine_record

from calib.data.qc.contact import find_contact, force_zero, in_compression
from calib.data.qc.experiment_file import Machine, Protocol
from calib.data.qc.hold_frames import clock_doubts, frames_of_holds
from calib.data.qc.machine_test import NotAsPlanned, at_travel, machine_test
from calib.data.qc.plateaus import (
    Cycle,
    Hold,
    converged_after,
    cycle_change_sds,
    cycle_changes,
    find_cycles,
    find_holds,
    step_holds,
)
from calib.data.qc.relaxation import CONSTANT_RATE, fit_prony, relaxation
from calib.data.qc.synchronise import synchronise
from calib.data.readers import MachineRecord

PROTOCOL = Protocol(
    increments=4,
    hold_s=HOLD,
    preconditioning_cycles=3,
    preconditioning_travel_mm=0.8,
    use=(2, 3, 4),
)
MACHINE = Machine(compliance_mm_per_N=0.004)


def run(truth: Truth, seed: int = 0, **changes):
    record, starts, travel = machine_record(truth, np.random.default_rng(seed))
    return machine_test(record, PROTOCOL, replace(MACHINE, **changes)), starts, travel


def test_travel_and_force_of_every_hold_are_those_put_into_the_record():
    test, starts, travel = run(Truth(slack=0.37))
    numbers, places, forces = test.loaded()
    np.testing.assert_array_equal(numbers, [1, 2, 3, 4])
    np.testing.assert_allclose(places, travel, atol=0.004)
    np.testing.assert_allclose(forces, force_at(travel), atol=0.012)
    found = [hold.start for hold in test.holds if hold.number > 0]
    np.testing.assert_allclose(found, starts, atol=0.15)


def test_noise_of_a_real_load_cell_leaves_forces_right_within_what_is_stated():
    errors = []
    for seed in range(12):
        test, _, travel = run(Truth(force_noise=0.07), seed)
        _, _, forces = test.loaded()
        spread = np.hypot(
            [p.force_sd for p in test.plateaus[-4:]],
            test.contact.travel_sd * (1.5 + 2.4 * travel**2),
        )
        errors.append((forces - force_at(travel)) / spread)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.5)
    noise = np.mean([p.noise_sd for p in test.plateaus])
    assert noise == pytest.approx(0.07, rel=0.15)


@pytest.mark.parametrize("resolution", [0.1, 0.2])
def test_a_coarse_clock_that_gives_several_readings_one_time_is_no_hindrance(resolution):
    record, _, _ = machine_record(Truth(force_noise=0.01), np.random.default_rng(0))
    coarse = replace(record, time=np.floor(record.time / resolution + 1e-9) * resolution)
    assert np.median(np.diff(coarse.time)) == 0
    one = coarse.at_distinct_times()
    assert np.all(np.diff(one.time) > 0)
    np.testing.assert_allclose(one.time, record.time, atol=0.5 * resolution)
    np.testing.assert_array_equal(one.force, record.force)
    fine, found = (machine_test(one, PROTOCOL, MACHINE) for one in (record, coarse))
    assert found.contact.travel == pytest.approx(fine.contact.travel, abs=0.01)
    np.testing.assert_allclose(found.loaded()[2], fine.loaded()[2], atol=0.02)


@pytest.mark.parametrize("resolution", [0.5, 1.0])
def test_a_clock_in_seconds_does_not_move_the_contact(resolution):
    """Means of the readings of one time moved it by 0.1 mm, five of its stated SDs."""
    record, _, _ = machine_record(Truth(force_noise=0.03), np.random.default_rng(0))
    coarse = replace(record, time=np.floor(record.time / resolution + 1e-9) * resolution)
    fine, found = (machine_test(one, PROTOCOL, MACHINE) for one in (record, coarse))
    assert found.contact.by_force == pytest.approx(fine.contact.by_force, abs=0.01)
    np.testing.assert_allclose(found.loaded()[2], fine.loaded()[2], rtol=0.01)


def test_readings_of_one_time_go_on_towards_the_next_and_not_into_a_pause():
    record, _, _ = machine_record(Truth(), np.random.default_rng(0))
    time = np.array([0.0, 0.0, 1.0, 2.0, 2.0, 9.0, 9.0])
    few = replace(record, time=time, force=np.zeros(7), travel=np.zeros(7))
    np.testing.assert_allclose(few.at_distinct_times().time, [0.0, 0.5, 1.0, 2.0, 2.5, 9.0, 9.5])


def test_a_record_of_one_time_is_not_as_planned():
    record, _, _ = machine_record(Truth(), np.random.default_rng(0))
    with pytest.raises(NotAsPlanned, match="times of readings: found 1, expected 2 or more"):
        machine_test(replace(record, time=np.zeros_like(record.time)), PROTOCOL, MACHINE)


def test_a_clock_that_jumps_far_ahead_is_not_as_planned():
    record, _, _ = machine_record(Truth(), np.random.default_rng(0))
    jumped = replace(record, time=record.time + 5e9 * (record.time > record.time[-20]))
    with pytest.raises(
        NotAsPlanned, match=r"seconds without a reading after \d+\.?\d* s: found 5000000000"
    ):
        machine_test(jumped, PROTOCOL, MACHINE)


def stepped_record(
    seed=0,
    *,
    cycles=0,
    at_contact=20.0,
    first_hold=20.0,
    approach=3.0,
    noise=0.005,
    contact=0.5,
    hard=1.0,
):
    """Steps of 0.2 mm of 1 s, held for 20 s, from a hold at contact on; 20 readings a second."""
    times, places = [0.0, 2.0], [0.0, 0.0]

    def go(seconds, place):
        times.append(times[-1] + seconds)
        places.append(place)

    for _ in range(cycles):
        for seconds, place in ((3.0, contact + 1.0), (3.0, 0.0), (2.0, 0.0)):
            go(seconds, place)
    go(approach, contact)
    if at_contact > 0.0:
        go(at_contact, contact)
    for step in range(1, 10):
        go(1.0, contact + 0.2 * step)
        go(first_hold if step == 1 else 20.0, contact + 0.2 * step)
    time = np.arange(0.0, times[-1], 0.05)
    travel = np.interp(time, times, places)
    depth = np.maximum(travel - contact, 0.0)
    force = hard * depth + 0.6 * depth**2 + 0.8 * depth**3
    force = force + np.random.default_rng(seed).normal(0.0, noise, force.size)
    return MachineRecord("steps", time, force, travel, "compression")


@pytest.mark.parametrize("approach", [0.5, 3.0, 10.0])
def test_contact_is_found_without_cycles_after_a_slow_approach(approach):
    """Its readings all lie before contact: alone they show no contact."""
    for seed in range(3):
        record = stepped_record(seed, approach=approach)
        test = machine_test(record, Protocol(preconditioning_cycles=0), Machine())
        assert test.contact.travel == pytest.approx(0.5, abs=0.01)
        assert [hold.number for hold in test.holds][:2] == [0, 1]


@pytest.mark.parametrize(("cycles", "at_contact"), [(0, 0.0), (5, 3.0)])
def test_a_noisy_load_cell_alone_rejects_no_sample(cycles, at_contact):
    """What it says of contact may be off by more than half an increment."""
    protocol = Protocol(preconditioning_cycles=cycles)
    for seed in range(10):
        record = stepped_record(seed, cycles=cycles, at_contact=at_contact, noise=0.07)
        test = machine_test(record, protocol, Machine())
        assert test.contact.travel == pytest.approx(0.5, abs=0.06)
        assert test.holds[0].number == 1


def test_a_protocol_that_says_where_holds_begin_numbers_those_of_soft_samples_right():
    """Of which the force begins to rise too gently for a noisy load cell."""
    numbers: dict[bool | None, list[int]] = {None: [], False: []}
    for known, found in numbers.items():
        protocol = Protocol(hold_at_contact=known)
        for seed in range(16):
            record = stepped_record(seed, cycles=5, at_contact=0.0, noise=0.07, hard=0.05)
            try:
                test = machine_test(record, protocol, Machine())
            except NotAsPlanned:  # as the force may contradict the protocol
                continue
            found.append(test.holds[0].number)
            if known is not None:
                assert test.contact.travel == pytest.approx(0.5, abs=0.1)
    assert numbers[None].count(0) > 0
    assert set(numbers[False]) == {1} and len(numbers[False]) > 12


@pytest.mark.parametrize("by_hand_sd", [0.0, 0.02])
def test_a_first_hold_too_short_to_be_one_does_not_renumber_the_others(by_hand_sd):
    record = stepped_record(cycles=5, first_hold=6.0)
    with pytest.raises(
        NotAsPlanned, match=r"where the steps begin: found 0\.2, expected 0\.1\d* or less"
    ):
        machine_test(record, Protocol(), Machine(contact_sd_mm=by_hand_sd))
    whole = machine_test(stepped_record(cycles=5), Protocol(), Machine(contact_sd_mm=by_hand_sd))
    assert whole.contact.travel == pytest.approx(0.5, abs=0.01)


def test_a_known_operators_zero_stands_in_for_the_force():
    test, _, _ = run(Truth(slack=0.42, force_noise=0.3), contact_sd_mm=0.0)
    assert test.contact.travel == pytest.approx(0.42, abs=1e-3)
    assert test.contact.travel_sd == 0.0


def test_a_machine_that_gives_way_by_more_than_the_pin_travels_is_refused():
    """As by forces in mN: holds were near no increment, and no word of a unit."""
    record, _, _ = machine_record(Truth(), np.random.default_rng(0))
    with pytest.raises(NotAsPlanned, match="mm that the machine gives way by") as refused:
        machine_test(replace(record, force=1000.0 * record.force), PROTOCOL, MACHINE)
    assert "are forces in N, machine.compliance_mm_per_N too?" in str(refused.value.expected)
    for soft, refused in ((0.06, False), (0.3, True)):  # mm/N: a tenth of the travel, and most
        machine = replace(MACHINE, compliance_mm_per_N=soft)
        if refused:
            with pytest.raises(NotAsPlanned, match="mm that the machine gives way by"):
                machine_test(record, PROTOCOL, machine)
        else:
            machine_test(record, PROTOCOL, machine)
    stiff = replace(MACHINE, compliance_mm_per_N=0.0)
    assert machine_test(replace(record, force=1000.0 * record.force), PROTOCOL, stiff).plateaus


def test_compliance_taken_for_zero_is_found_in_the_travel():
    _, places, forces = run(Truth())[0].loaded()
    _, stiff_places, _ = run(Truth(), compliance_mm_per_N=0.0)[0].loaded()
    np.testing.assert_allclose(stiff_places - places, 0.004 * forces, atol=2e-3)


def test_force_begins_where_a_cubic_was_made_to():
    travel = np.linspace(0.0, 1.0, 200)
    found = find_contact(travel, 0.1 + force_at(travel - 0.314))
    assert found.by_force == pytest.approx(0.314, abs=2e-3)


def test_the_error_of_the_contact_is_about_what_is_stated():
    """RMS of 150 errors over their SDs; the curvature at a corner makes it some more than one."""
    rng, travel = np.random.default_rng(0), np.linspace(0.0, 1.2, 300)
    clean, errors = force_at(travel - 0.3), []
    for _ in range(150):
        found = find_contact(travel, clean + 0.1 * rng.standard_normal(travel.size))
        errors.append((found.by_force - 0.3) / found.by_force_sd)
    assert 0.8 < np.sqrt(np.mean(np.square(errors))) < 1.45


def test_the_error_of_the_force_of_a_hold_is_what_is_stated():
    """RMS of 200 errors over their SDs within four of its SDs, 5 % each."""
    rng, t = np.random.default_rng(0), np.arange(0.0, 20.0, 0.1)
    clean, errors = 2.0 + 0.3 * np.exp(-t / 2.0), []
    expected = clean[t >= 0.75 * t[-1]].mean()
    for _ in range(200):
        found = relaxation(t, clean + 0.05 * rng.standard_normal(t.size), 0.25)
        errors.append((found.force - expected) / found.force_sd)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.2)


def test_drift_of_the_load_cell_is_measured_each_time_the_pin_is_free():
    time = np.arange(0.0, 60.0, 0.1)
    travel = np.where((time > 20) & (time < 40), 0.5, -0.5)
    drift = 0.2 + 0.01 * time
    force = drift + np.where(travel > 0, 1.0, 0.0)
    zero, sd = force_zero(time, travel, force, 0.0)
    inside = (time > 15) & (time < 55)
    np.testing.assert_allclose(zero[inside], drift[inside], atol=0.01)
    assert np.all(sd < 1e-9), "a drift is no noise"


def test_readings_just_before_contact_are_no_zero():
    """An uneven sample is touched a little before: 0.03 mm before the pin may not be free."""
    time = np.arange(0.0, 30.0, 0.1)
    travel = np.interp(time, [0.0, 5.0, 20.0, 30.0], [-0.6, -0.02, -0.02, 0.9])
    force = 0.2 + np.where(travel > -0.025, 0.05, 0.0)
    zero, _ = force_zero(time, travel, force, 0.0)
    np.testing.assert_allclose(zero, 0.2, atol=1e-12)


def test_the_zero_of_the_load_cell_has_the_error_that_is_stated():
    """RMS of 400 errors over the SD within 15 %: a false alarm is beyond four of its SDs."""
    rng, time = np.random.default_rng(0), np.arange(0.0, 30.0, 0.1)
    travel = np.where(time > 10.0, 0.5, -0.5)
    errors = []
    for _ in range(400):
        zero, sd = force_zero(time, travel, 0.1 * rng.standard_normal(time.size), 0.0)
        errors.append(zero[-1] / sd[-1])
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, rel=0.15)


def test_a_load_cell_at_the_end_of_its_range_is_not_as_planned():
    record, _, travel = machine_record(Truth(force_noise=0.01), np.random.default_rng(0))
    end = 0.8 * float(force_at(travel)[-1])
    clipped = replace(record, force=np.clip(record.force, -end, end))
    with pytest.raises(NotAsPlanned, match=r"readings stay at: found .*did the load cell reach"):
        machine_test(clipped, PROTOCOL, MACHINE)
    for noise, resolution in ((0.005, 0.02), (0.01, 0.05), (0.005, 0.1), (0.01, 0.2)):
        record, _, _ = machine_record(Truth(force_noise=noise), np.random.default_rng(0))
        coarse = replace(record, force=np.round(record.force / resolution) * resolution)
        machine_test(coarse, PROTOCOL, MACHINE)


def test_holds_that_go_away_from_the_sample_are_told_as_a_matter_of_sign():
    record, _, _ = machine_record(Truth(), np.random.default_rng(0))
    assert record.travel is not None
    turned = replace(record, travel=-record.travel, force=-record.force, positive="compression")
    if record.positive != "compression":
        turned = replace(turned, travel=record.travel, force=record.force)
    with pytest.raises(NotAsPlanned, match="that go away from the sample by the signs of the file"):
        machine_test(turned, PROTOCOL, MACHINE)


@pytest.mark.parametrize("sign", [1, -1])
def test_signs_follow_the_record_and_the_travel_goes_with_the_force(sign):
    force, travel = np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.5, 1.0])
    record = MachineRecord("x", np.arange(3.0), sign * force, -travel, "unknown")
    turned = in_compression(record, sign)
    np.testing.assert_array_equal(turned.force, force)
    np.testing.assert_array_equal(turned.travel, travel)
    stated = MachineRecord("x", np.arange(3.0), -force, -travel, "tension")
    np.testing.assert_array_equal(in_compression(stated, 1).force, force)


def test_a_record_cut_short_is_not_as_planned():
    record, starts, _ = machine_record(Truth(), np.random.default_rng(0))
    some = record.time < starts[2]
    cut = MachineRecord("x", record.time[some], record.force[some], record.travel[some], "unknown")
    with pytest.raises(NotAsPlanned) as caught:
        machine_test(cut, PROTOCOL, MACHINE)
    assert (caught.value.what, caught.value.found, caught.value.expected) == ("plateaus", 2, 4)


def test_holds_survive_noise_quantisation_and_a_creeping_crosshead():
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 60.0, 0.05)
    level = np.interp(time, [0, 5, 7, 27, 29, 49, 51, 60], [0, 0, 0.2, 0.205, 0.4, 0.405, 0, 0])
    seen = np.round(level + 5e-4 * rng.standard_normal(time.size), 3)
    holds = step_holds(find_holds(time, seen, Protocol(increments=2, use=(1, 2))), Protocol(), 0.0)
    numbers = [hold.number for hold in holds]
    assert numbers[-2:] == [1, 2]
    np.testing.assert_allclose([h.start for h in holds[-2:]], [7, 29], atol=0.6)
    np.testing.assert_allclose([h.end for h in holds[-2:]], [27, 49], atol=0.6)


def test_a_hold_at_contact_is_number_zero():
    holds = [Hold(-1, 30.0 * k, 30.0 * k + 20, 0.5 + 0.2 * k) for k in range(5)]
    four = Protocol(increments=4, use=(2, 3))
    early = [Hold(-1, -30.0, -10.0, 0.3), *holds]
    assert [h.number for h in step_holds(early, four, 0.53)] == [0, 1, 2, 3, 4]
    assert [h.number for h in step_holds(holds, four, 0.5)] == [0, 1, 2, 3, 4]
    assert [h.number for h in step_holds(holds[1:], four, 0.5)] == [1, 2, 3, 4]
    for stated, numbers in ((True, [0, 1, 2, 3, 4]), (False, [1, 2, 3, 4, 5])):
        known = replace(four, hold_at_contact=stated)
        for contact in (0.38, 0.5):  # by the force, which is not asked then
            assert [h.number for h in step_holds(holds, known, contact)] == numbers


def test_cycles_have_the_peaks_of_the_record_and_their_convergence_is_counted():
    test, _, _ = run(Truth())
    peak = force_at(np.array([0.8]))[0]
    assert len(test.cycles) == 3
    # the mean next to the peak is a little less than the peak
    np.testing.assert_allclose([c.peak_force for c in test.cycles], peak, rtol=0.06)
    forces = 1.0 + 0.2 * 0.4 ** np.arange(8)
    cycles = [Cycle(float(i), float(f), 1.0) for i, f in enumerate(forces)]
    np.testing.assert_allclose(cycle_changes(cycles), 100 * np.diff(forces) / forces[1:])
    # changes are 0.12, 0.048, 0.019, 0.0077: below 1 % from the fourth on
    assert converged_after(cycles) == 4
    assert converged_after(cycles[:3]) is None
    # where noise could hide a change of 1 % it is not told
    for sd, expected in ((1e-4, 4), (3e-3, 6), (5e-3, None)):
        noisy = [cycle._replace(peak_sd=sd) for cycle in cycles]
        np.testing.assert_allclose(cycle_change_sds(noisy), 100 * sd * np.sqrt(2) / forces[1:])
        assert converged_after(noisy) == expected


def test_the_sd_of_peak_forces_is_their_scatter():
    """Over 60 records of one test; the SD of an SD of 180 numbers is 5 %: five of them."""
    time = np.arange(0.0, 40.0, 0.05)
    travel = 0.8 * np.abs(np.sin(np.pi * time / 10.0))
    protocol = Protocol(preconditioning_travel_mm=0.8)
    rng = np.random.default_rng(4)
    found = [
        find_cycles(
            time, travel, 2.0 * travel + 0.05 * rng.standard_normal(time.size), 40, protocol
        )
        for _ in range(60)
    ]
    peaks = np.array([[cycle.peak_force for cycle in cycles[:3]] for cycles in found])
    stated = np.array([[cycle.peak_sd for cycle in cycles[:3]] for cycles in found])
    scatter = np.sqrt(np.mean(np.var(peaks, axis=0, ddof=1)))
    assert scatter == pytest.approx(np.sqrt(np.mean(stated**2)), rel=0.27)


def test_relaxation_of_a_known_decay_is_that_of_its_formula():
    t = np.arange(0.0, 20.0, 0.05)
    force = 2.0 + 0.08 * np.exp(-t / 1.5)
    found = relaxation(t + 7.0, force, 0.25)
    assert found.force == pytest.approx(2.0, abs=1e-4)
    mean = force.mean()
    assert found.variation_percent == pytest.approx(100 * (force[0] - force[-1]) / mean, rel=0.03)
    # 0.08 / 1.5 exp(-t / 1.5) = 0.001
    assert found.time_to_constant == pytest.approx(
        1.5 * np.log(0.08 / 1.5 / CONSTANT_RATE), rel=0.1
    )


def test_variation_of_a_noisy_hold_is_that_of_the_fit_and_not_of_the_noise():
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 20.0, 0.05)
    force = 2.0 + 0.08 * np.exp(-t / 1.5) + 0.05 * rng.standard_normal(t.size)
    found = relaxation(t, force, 0.25)
    assert found.variation_percent == pytest.approx(4.0, abs=1.5)
    assert found.raw_variation_percent > 10
    assert found.noise_sd == pytest.approx(0.05, rel=0.1)
    assert abs(found.force - 2.0) < 4 * found.force_sd


def test_fitted_force_never_rises_in_a_hold():
    t = np.linspace(0.0, 5.0, 60)
    prony = fit_prony(t, 1.0 + 0.1 * t)
    assert np.all(np.diff(prony.force(t)) <= 1e-12)


def test_frames_fall_into_their_holds_whatever_the_clock_says():
    holds = [Hold(k, 10.0 * k, 10.0 * k + 6, 0.2 * k) for k in range(10)]
    for clock in (-2.8, 0.0, 1.9):
        times = np.array([-4.0, *(10.0 * k + 3 for k in range(1, 10))]) + clock
        found = synchronise(times, holds, 5.0)
        np.testing.assert_array_equal(found.hold[1:], np.arange(1, 10))
        assert abs(found.offset + clock) <= found.half_width + 1e-9


def test_short_holds_tell_the_clock_to_less_than_half_their_length():
    rng = np.random.default_rng(2)
    holds = [Hold(k, 5.0 * k, 5.0 * k + 2, 0.2 * k) for k in range(10)]
    times = np.array([-1.0, *(5.0 * k + 1.0 for k in range(1, 10))]) + 1.3
    times[1:] += rng.uniform(-0.6, 0.6, 9)
    found = synchronise(times, holds, 5.0)
    np.testing.assert_array_equal(found.hold[1:], np.arange(1, 10))
    assert found.half_width < 1.0
    assert abs(found.offset + 1.3) <= found.half_width


def test_a_frame_between_two_holds_belongs_to_none():
    holds = [Hold(k, 10.0 * k, 10.0 * k + 6, 0.2 * k) for k in range(1, 5)]
    times = np.array([0.0, 13.0, 23.0, 38.0, 43.0])
    assert synchronise(times, holds, 1.0).hold.tolist() == [-1, 1, 2, -1, 4]


@pytest.mark.parametrize("period", [1.0, 2.0, 5.0])
@pytest.mark.parametrize("clock", [-3.0, 0.0, 1.5, 4.0])
def test_a_series_shows_each_hold_by_a_frame_that_is_in_it_whatever_the_clock_says(period, clock):
    holds = [Hold(k, 20.4 * k, 20.4 * k + 20.0, 0.2 * k) for k in range(7)]
    true = np.concatenate([[-6.0], np.arange(-3.0, 150.0, period)])
    found = synchronise(true + clock, holds, 5.0)
    assert abs(found.offset + clock) <= found.half_width
    chosen = _shown(found, holds)
    for hold, frame in zip(holds[1:], chosen, strict=True):
        assert hold.start <= true[frame] <= hold.end
        # the last that does, as its force has relaxed the most
        assert found.time[frame] > hold.end - found.half_width - period - 1e-6
    assert not clock_doubts("A", found, [2, 3, 4, 5])


def test_a_photograph_taken_twice_makes_no_series_of_those_that_are_taken_by_hand():
    holds = [Hold(k, 8.0 * k, 8.0 * k + 7.0, 0.2 * k) for k in range(7)]
    true = np.array([-4.0, 8.5, 16.4, 24.2, 24.9, 32.5, 40.3, 48.6])
    found = synchronise(true - 4.8, holds, 5.0)
    assert found.hold[1:].tolist() == [1, 2, 3, 3, 4, 5, 6]
    assert abs(found.offset - 4.8) <= found.half_width


def test_a_series_begun_within_a_hold_says_nothing_of_the_hold_before():
    holds = [Hold(k, 20.4 * k, 20.4 * k + 20.0, 0.2 * k) for k in range(1, 7)]
    times = np.concatenate([[0.0], np.arange(holds[1].start + 3.0, 142.0, 2.0)])
    found = synchronise(times, holds, 5.0)
    assert abs(found.offset) < 0.5
    assert not np.isin(found.hold, 1).any()


def test_holds_that_are_shorter_than_the_clocks_are_unsure_are_doubted_by_number():
    holds = [Hold(k, 8.0 * k, 8.0 * k + 7.0, 0.2 * k) for k in range(1, 7)]
    times = np.concatenate([[0.0], np.arange(1.0, 56.0, 1.0)])
    [doubt] = clock_doubts("A", synchronise(times, holds, 5.0), [3, 4])
    assert "hold 2, 3, 4, 5 none stays" in doubt and "± 5 s" in doubt
    assert not clock_doubts("A", synchronise(times, holds, 1.0), [3, 4])


def _shown(found, holds):
    """The frame of each hold but that before the first step."""
    numbers = np.array([hold.number for hold in holds[1:]])
    protocol = SimpleNamespace(use=tuple(int(n) for n in numbers[1:-1]))
    return frames_of_holds(found, numbers, 0.2 * numbers, SimpleNamespace(protocol=protocol))[0]


def test_values_at_nominal_travels_are_those_of_the_parabola_through_three_holds():
    travel = INCREMENT * np.arange(1, 6) + 0.03
    values = np.stack([2 * travel + 3 * travel**2, -(travel**2)], axis=1)
    nominal = np.array([0.4, 0.6, 1.0])
    found = at_travel(travel, values, nominal, 0.1)
    np.testing.assert_allclose(found[:, 0], 2 * nominal + 3 * nominal**2, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], -(nominal**2), atol=1e-12)
    assert np.isnan(at_travel(travel, values, np.array([1.3]), 0.1)).all()


def test_a_value_that_lacks_at_the_next_hold_is_bridged_by_a_line():
    travel = np.array([0.2, 0.4, 0.6])
    values = np.array([[1.0], [2.0], [np.nan]])
    assert at_travel(travel, values, np.array([0.38]), 0.1)[0, 0] == pytest.approx(1.9)


def test_five_holds_bring_a_polynomial_of_fourth_degree_to_the_nominal_travels_exactly():
    travel = INCREMENT * np.arange(1, 8) - 0.012
    values, nominal = 2 * travel + 7 * travel**4, np.array([0.4, 0.8, 1.4])
    found = at_travel(travel, values, nominal, 0.1, 5)
    np.testing.assert_allclose(found, 2 * nominal + 7 * nominal**4, rtol=1e-12)
    assert np.abs(at_travel(travel, values, nominal, 0.1) / found - 1).max() > 1e-3


def test_what_the_force_says_of_contact_has_its_weight_beside_the_operator():
    test = run(Truth(force_noise=0.07))[0]
    sds = np.array([test.contact.by_force_sd, MACHINE.contact_sd_mm])
    assert test.contact.force_share == pytest.approx(sds[0] ** -2 / np.sum(sds**-2.0))
    assert run(Truth(), contact_sd_mm=0.0)[0].contact.force_share == 0.0


@pytest.mark.parametrize("planned", [0.25, 0.22, 0.15])
def test_holds_that_are_no_increment_apart_are_not_as_planned(planned: float):
    record, _, _ = machine_record(Truth(), np.random.default_rng(0))
    with pytest.raises(NotAsPlanned, match=r"hold to hold: found 0\.2.* protocol.increment_mm"):
        machine_test(record, replace(PROTOCOL, increment_mm=planned), MACHINE)
