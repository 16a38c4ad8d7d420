"""What docs/verification/fe.json is computed with: grid convergence, draws, Taylor, merging."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import convergence_study, grid_convergence, taylor, verify_fe
from benchmarks.convergence_study import HIGH, LOW, draws
from benchmarks.grid_convergence import index_percent


@pytest.mark.parametrize("order", [1.0, 1.6, 2.0, 2.8])
@pytest.mark.parametrize("h", [(1.0, 2.0, 4.0), (1.0, 1.3, 2.1)])
def test_the_grid_convergence_index_covers_the_error_of_a_power_law(order, h):
    """With f = 5 + 0.1 h^p the order is found and the index is 1.25 times the true error."""
    sizes = np.array(h)
    f = 5.0 + 0.1 * sizes**order
    index, found = index_percent(f, sizes, high=3.0)
    np.testing.assert_allclose(found, order, rtol=1e-6)
    np.testing.assert_allclose(index, 100 * 1.25 * 0.1 / f[0], rtol=1e-5)


def test_the_observed_order_stays_within_its_bounds():
    """A difference that is small by chance must not promise a tiny error."""
    sizes = np.array([1.0, 1.5, 2.25])
    assert index_percent(np.array([5.0, 5.1, 9.0]), sizes)[1] == 2.0
    assert index_percent(np.array([5.0, 5.1, 5.1]), sizes)[1] == 1.0
    assert index_percent(np.array([5.0, 5.0, 5.3]), sizes)[0] == 0.0


def test_draws_lie_in_their_ranges_and_more_keep_the_first():
    few, many = draws(5), draws(64)
    assert many[:5] == few
    values = np.array(many)
    values[:, 2] = np.log(values[:, 2])
    assert (values >= np.array(LOW)).all()
    assert (values <= np.array(HIGH)).all()
    assert (np.ptp(values, axis=0) > 0.9 * (np.array(HIGH) - np.array(LOW))).all()


def test_the_sobol_study_counts_what_was_reached_and_goes_on_where_it_was(tmp_path, monkeypatch):
    case = next(iter(convergence_study.CASES))
    arguments = {"cells": (4, 2, 1), "travel": (0.05, 0.1), "reached": (0.1, 0.2)}
    found = convergence_study.figures(tmp_path, 2, 1, (case,), **arguments)
    fraction = found["converged_fraction"][case]
    assert (fraction["0.1 mm"], fraction["0.2 mm"], fraction["draws"]) == (1.0, 0.0, 2)
    assert found["not_converged"][case] == []

    def not_again(*_):
        raise AssertionError("simulated a draw that is stored")

    monkeypatch.setattr(convergence_study, "simulate", not_again)
    again = convergence_study.figures(tmp_path, 2, 1, (case,), **arguments)
    assert again == found


@pytest.mark.parametrize(
    ("case", "name"),
    [("slide", "C01"), ("stick", "height"), ("stick", "bulk"), ("friction", "pin_fillet")],
)
def test_sensitivities_pass_the_taylor_test(case, name):
    """The remainder falls as h^2; with a wrong derivative it would as h. Force and field."""
    steps = taylor.STEPS[:3]
    found = taylor.remainders(taylor.model(taylor.CONTACTS[case]), name, steps)
    np.testing.assert_allclose(taylor.orders(found, steps), 2.0, atol=0.1)


def test_a_part_replaces_its_figures_and_leaves_the_others(tmp_path, monkeypatch):
    out = tmp_path / "verification" / "fe.json"
    monkeypatch.setitem(verify_fe.PARTS, "taylor", lambda _: {"taylor_order": 2.0})
    monkeypatch.setitem(verify_fe.PARTS, "gci", lambda settings: {"draws": settings.draws})
    verify_fe.main(["--only", "taylor", "--out", str(out)])
    verify_fe.main(["--only", "gci", "--draws", "7", "--out", str(out)])
    assert json.loads(out.read_text()) == {"taylor_order": 2.0, "draws": 7}


def test_cases_run_one_at_a_time_stand_together(tmp_path):
    out = tmp_path / "fe.json"
    verify_fe.merge(out, {"converged_fraction": {"bar, stick": 1.0, "bar, frictionless": 0.5}})
    verify_fe.merge(out, {"converged_fraction": {"bar, frictionless": 0.9}})
    found = json.loads(out.read_text())["converged_fraction"]
    assert found == {"bar, stick": 1.0, "bar, frictionless": 0.9}


def test_meshes_of_the_index_are_those_of_the_mesh_study():
    from benchmarks.mesh_convergence import MESHES

    assert set(grid_convergence.MESHES) <= set(MESHES)
