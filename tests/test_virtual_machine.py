"""The virtual test machine does what its protocol says and the rubber what its law says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from virtual_blocks import analytic_truth

from calib.data.readers import read_machine
from calib.virtual import LaboratorySettings, Protocol, Rubber, TestMachine
from calib.virtual.crosshead import programme
from calib.virtual.laboratory_settings import MACHINE_FORMATS
from calib.virtual.machine_files import MACHINE_WRITERS
from calib.virtual.machine_run import MachineRun, run_machine
from calib.virtual.relaxation import relaxing_force

EXACT = TestMachine(
    force_noise_N=0.0, force_zero_N=0.0, force_drift_N=0.0, travel_noise_mm=0.0, contact_sd_mm=0.0
)


def run(machine: TestMachine = EXACT, stiffness: float = 1.0, seed: int = 0) -> MachineRun:
    settings = LaboratorySettings(machine=machine)
    return run_machine(analytic_truth(), stiffness, settings, np.random.default_rng(seed))


def test_programme_has_cycles_and_steps_with_holds() -> None:
    protocol = Protocol()
    path = programme(protocol)
    assert np.all(np.diff(path.time) > 0)
    assert np.count_nonzero(path.position == protocol.preconditioning_travel_mm) >= 5
    at_holds = np.interp(path.hold_start + 0.5 * protocol.hold_s, path.time, path.position)
    assert at_holds == pytest.approx(np.arange(1, 10) * 0.2)


def test_relaxing_force_solves_its_differential_equation() -> None:
    """Against scipy's integrator of h' = Fe' - h / tau, Fe even between the readings."""
    rubber, step = Rubber(), 0.05
    time = np.arange(0, 12, step)
    at_rest = np.interp(time, [1.0, 2.0, 6.0, 7.0], [0.0, 1.0, 1.0, 2.5])
    expected = at_rest.copy()
    for share, tau in zip(rubber.relaxing_shares, rubber.relaxing_s, strict=True):

        def slope(t: float, h: np.ndarray, tau: float = tau) -> np.ndarray:
            rate = np.interp(t, [1.0, 2.0, 6.0, 7.0], [0.0, 1.0, 1.0, 2.5])
            later = np.interp(t + 1e-7, [1.0, 2.0, 6.0, 7.0], [0.0, 1.0, 1.0, 2.5])
            return (later - rate) / 1e-7 - h / tau

        found = solve_ivp(slope, (0, 12), [0.0], t_eval=time, max_step=0.01, rtol=1e-8)
        expected += share * found.y[0]
    assert relaxing_force(at_rest, step, rubber) == pytest.approx(expected, abs=2e-4)


def test_a_pin_that_has_left_the_sample_feels_nothing_and_none_pulls() -> None:
    made = run()
    free = made.position < LaboratorySettings().protocol.slack_mm - 0.01
    later = free & (made.time > made.programme.hold_start[0])
    assert np.count_nonzero(later) > 50 and made.force[later] == pytest.approx(0.0, abs=1e-12)
    assert made.force.min() >= 0


def test_holds_relax_to_the_force_at_rest_by_as_much_as_the_thesis_measured() -> None:
    """T Table 3.6: 2.5 to 2.8 % of the mean force in 25 s, for increments 3 to 7."""
    made = run()
    for k in range(2, 7):
        start = made.programme.hold_start[k]
        held = (made.time >= start + 0.05) & (made.time < start + 20)
        force = made.force[held]
        assert force[-1] == pytest.approx(made.force_at_rest[k], rel=0.005)
        assert 1.0 < 100 * np.ptp(force) / force.mean() < 6.0


def test_the_machine_yields_by_its_compliance() -> None:
    made = run(stiffness=1.1)
    position = np.arange(1, 10) * 0.2
    lost = EXACT.compliance_mm_per_N * made.force_at_rest
    assert made.travel == pytest.approx(position - lost, abs=1e-5)
    assert made.force_at_rest == pytest.approx(1.1 * analytic_truth().force_at(made.travel))


def test_cycles_soften_to_the_force_of_the_steps() -> None:
    made = run()
    before = made.time < made.programme.approach
    at_top = made.programme.time[(made.programme.position == 1.0) & (made.programme.cycle < 5)]
    peaks = np.array([made.force[before & (np.abs(made.time - t) < 0.2)].max() for t in at_top])
    assert np.all(np.diff(peaks) < 0)
    assert peaks[0] / peaks[-1] == pytest.approx(1.15, abs=0.01)


def test_what_is_recorded_has_the_stated_noise_and_is_rounded() -> None:
    exact, noisy = run(), run(TestMachine(contact_sd_mm=0.0, force_zero_N=0.0, force_drift_N=0.0))
    error = noisy.force - exact.force
    assert error.std() == pytest.approx(0.07, rel=0.05)
    steps = noisy.force / 0.005
    assert steps == pytest.approx(np.round(steps), abs=1e-6)


@pytest.mark.parametrize("name", MACHINE_FORMATS)
def test_readers_find_what_was_recorded(name, tmp_path) -> None:
    made = run(TestMachine())
    MACHINE_WRITERS[name](tmp_path / "machine.csv", made, "S01")
    record = read_machine(tmp_path / "machine.csv").in_compression()
    assert record.time == pytest.approx(made.time, abs=1e-3)
    assert record.travel == pytest.approx(made.position, abs=1e-5)
    assert record.force == pytest.approx(made.force, abs=1e-5)
    assert "synthetic" in (tmp_path / "machine.csv").read_text()


def test_a_protocol_beyond_the_truth_is_refused() -> None:
    settings = LaboratorySettings(protocol=Protocol(increments=10))
    with pytest.raises(ValueError, match="increments: expected travels up to"):
        run_machine(analytic_truth(), 1.0, settings, np.random.default_rng(0))


def test_errors_of_contact_are_not_cut_off_where_the_truth_ends() -> None:
    """The mean of 400 is within 3.3 of its SDs but for one in a thousand."""
    found = np.array(
        [run(TestMachine(contact_sd_mm=0.005), 1.0, seed).contact for seed in range(400)]
    )
    assert abs(found.mean()) < 3.3 * 0.005 / 20.0
    assert found.std() == pytest.approx(0.005, rel=0.12)
    with pytest.raises(ValueError, match=r"contact_sd_mm: expected at most .* found 0\.1 mm"):
        run(TestMachine(contact_sd_mm=0.1), 0.1)
