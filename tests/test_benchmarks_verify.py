"""What docs/verification/fe.json is computed with: grid convergence, draws, Taylor, merging."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from toy_simulation import RATIOS, Toy

import benchmarks.run_key
from benchmarks import (
    convergence_study,
    grid_convergence,
    mesh_convergence,
    mesh_uncertainty,
    taylor,
    verify_fe,
)
from benchmarks.convergence_study import HIGH, LOW, draws
from benchmarks.grid_convergence import index_percent
from benchmarks.mesh_convergence import similar
from benchmarks.run_key import is_kept, kept_campaign, run_key
from fe import BlockPin, BlockPinModel, Contact


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
    few, many = draws(5), draws(192)
    assert many[:5] == few
    values = np.array([draw[2:] for draw in many])
    values[:, 2] = np.log(values[:, 2])
    assert (values >= np.array(LOW)).all()
    assert (values <= np.array(HIGH)).all()
    assert (np.ptp(values, axis=0) > 0.9 * (np.array(HIGH) - np.array(LOW))).all()


def test_every_pin_and_contact_has_its_share_of_the_draws_and_covers_the_other_ranges():
    middle = (np.array(LOW) + np.array(HIGH)) / 2
    for case in convergence_study.CASES:
        values = np.array([draw[2:] for draw in draws(192) if draw.case == case])
        values[:, 2] = np.log(values[:, 2])
        assert 28 <= len(values) <= 36
        # three standard errors of 34 independent draws
        assert (np.abs((values > middle).mean(axis=0) - 0.5) < 0.26).all()


def test_only_a_draw_with_friction_has_its_coefficients_in_the_contact():
    for draw in draws(32):
        expected = {"stick": "stick", "frictionless": "slide"}.get(draw.touch)
        assert draw.contact.pin == (expected or draw.pin_friction)
        assert draw.contact.base == (expected or draw.base_friction)


def test_the_sobol_study_counts_what_was_reached_and_goes_on_where_it_was(tmp_path, monkeypatch):
    tiny = {
        case: (4, 2, 1) if case.startswith("bar") else (3, 2, 3) for case in convergence_study.CASES
    }
    arguments = {"cells": tiny, "travel": (0.05, 0.1), "reached": (0.1, 0.2)}
    found = convergence_study.figures(tmp_path, 4, 1, **arguments)
    found |= convergence_study.figures(tmp_path, 4, 1, "fitting", **arguments)
    total = found["converged_fraction"]["all"]
    assert (total["0.1 mm"], total["0.2 mm"], total["draws"]) == (1.0, 0.0, 4)
    by_case = [v["draws"] for k, v in found["converged_fraction"].items() if k != "all"]
    assert sum(by_case) == 4
    assert found["converged_fraction_fitting"]["all"]["draws"] == 1
    assert [row["number"] for row in found["not_converged"]] == [0, 1, 2, 3]
    assert {row["reached"] for row in found["not_converged"]} == {0.1}

    def not_again(*_):
        raise AssertionError("simulated a draw that is stored")

    monkeypatch.setattr(convergence_study.BlockPinModel, "__call__", not_again)
    again = convergence_study.figures(tmp_path, 4, 1, **arguments)
    assert again == {key: found[key] for key in again}


@pytest.mark.parametrize(
    ("case", "name"),
    [("slide", "C01"), ("stick", "height"), ("stick", "bulk"), ("friction", "pin_fillet")],
)
def test_sensitivities_pass_the_taylor_test(case, name):
    """The remainder falls as h^2; with a wrong derivative it would as h. Force and field."""
    block = taylor.model(taylor.CONTACTS[case])
    np.testing.assert_allclose(taylor.order_of(block, name), 2.0, atol=0.1)


def test_a_part_replaces_its_figures_and_leaves_the_others(tmp_path, monkeypatch):
    out = tmp_path / "verification" / "fe.json"
    monkeypatch.setitem(verify_fe.PARTS, "taylor", lambda _: {"taylor_order": 2.0})
    monkeypatch.setitem(verify_fe.PARTS, "gci", lambda settings: {"draws": settings.draws})
    verify_fe.main(["--only", "taylor", "--out", str(out)])
    verify_fe.main(["--only", "gci", "--draws", "7", "--out", str(out)])
    assert json.loads(out.read_text()) == {"taylor_order": 2.0, "draws": 7}


def test_a_mesh_that_is_followed_to_a_travel_has_nan_beyond_it(tmp_path, monkeypatch):
    case, mesh = mesh_convergence.Case("bar", "slide"), mesh_convergence.Mesh((3, 2, 1), 0.05)
    monkeypatch.setattr(mesh_convergence, "TRAVEL", (0.02, 0.04))
    whole = mesh_convergence.simulate(tmp_path, case, mesh, mesh_convergence.RATIOS)
    monkeypatch.setitem(mesh_convergence.FOLLOWED, "slide, 3 x 2 x 1, 0.05", 0.02)
    for _ in range(2):  # made and found
        part = mesh_convergence.simulate(tmp_path, case, mesh, mesh_convergence.RATIOS)
        assert part.travel.tolist() == [0.02, 0.04]
        np.testing.assert_array_equal(part.force[:1], whole.force[:1])
        np.testing.assert_array_equal(part.displacement[:1], whole.displacement[:1])
        assert np.isnan(part.force[1:]).all()
        assert np.isnan(part.displacement[1:]).all()


def test_some_cases_of_a_part_leave_the_other_cases(tmp_path, monkeypatch):
    out = tmp_path / "fe.json"

    def part(settings):
        return {"force": {str(case): settings.draws for case in settings.cases}}

    monkeypatch.setitem(verify_fe.PARTS, "directions", part)
    verify_fe.main(["--only", "directions", "--draws", "1", "--out", str(out)])
    some = ["--cases", "slide", "round, stick"]
    verify_fe.main(["--only", "directions", *some, "--draws", "2", "--out", str(out)])
    found = json.loads(out.read_text())["force"]
    assert len(found) == len(grid_convergence.CASES)
    assert {case for case, value in found.items() if value == 2} == {"slide", "round, stick"}
    verify_fe.main(["--only", "directions", "--draws", "3", "--out", str(out)])
    assert set(json.loads(out.read_text())["force"].values()) == {3}


@pytest.mark.parametrize("case", grid_convergence.CASES, ids=str)
def test_meshes_of_the_index_are_refined_alike_in_all_directions(case):
    """Rings across the rim and over the height: along the rim they have two elements each."""
    meshes = similar(case)
    directions = slice(2) if case.pin == "round" else slice(3)
    coarse = np.array(meshes[0].numbers[directions])
    for mesh in meshes[1:]:
        assert np.ptp(np.array(mesh.numbers[directions]) / coarse) == 0.0
    assert len({mesh.step for mesh in meshes}) == 1


def test_a_stored_run_is_found_again_but_not_for_another_model_or_code(tmp_path):
    model = BlockPinModel(BlockPin(), Contact(), (1, 1, 1), (0.1,))
    finer = BlockPinModel(BlockPin(), Contact(), (2, 1, 1), (0.1,))
    keys = [run_key(model)]
    for i, code in enumerate(["a = 1  # one", '"""Why."""\n\na = (1)\n"""mm"""', "a = 2"]):
        (tmp_path / str(i)).mkdir()
        (tmp_path / str(i) / "module.py").write_text(code)
        keys.append(run_key(model, tmp_path / str(i)))
    assert keys[0] == run_key(BlockPinModel(BlockPin(), Contact(), (1, 1, 1), (0.1,)))
    assert keys[1] == keys[2]
    assert len({*keys, run_key(finer)}) == 4


def test_a_kept_campaign_runs_again_what_other_code_has_run(tmp_path, monkeypatch):
    log = tmp_path / "log"
    for code, n_runs in (("one", 6), ("one", 6), ("other", 12)):
        monkeypatch.setattr(benchmarks.run_key, "syntax_hash", lambda _, code=code: code)
        asked = Toy(log=str(log)), RATIOS, tmp_path / "store"
        assert is_kept(*asked) == (log.exists() and len(log.read_text().splitlines()) == n_runs)
        kept_campaign(*asked)
        assert len(log.read_text().splitlines()) == n_runs
        assert is_kept(*asked) and len(log.read_text().splitlines()) == n_runs


def test_indices_of_force_and_field_cover_errors_of_second_order(tmp_path, monkeypatch):
    """With errors C h^2 the index is 1.25 times the error of the finest mesh."""

    def simulate(folder, case, mesh, ratios):
        h = similar(case)[-1].numbers[0] / mesh.numbers[0]
        force = np.linspace(100.0, 900.0, 5) * (1.0 + 0.002 * h**2)
        field = np.full((5, 7, 3), 0.4 - 0.001 * h**2)
        return SimpleNamespace(force=force, displacement=field, seconds=1.0, status="made up")

    monkeypatch.setattr(grid_convergence, "simulate", simulate)
    found = grid_convergence.figures(tmp_path)
    contacts = {"slide", "stick", "friction 0.3"}
    assert set(found["force_gci_percent"]) == contacts | {f"round, {c}" for c in contacts}
    for contact in found["force_gci_percent"]:
        force, field = found["force_gci_percent"][contact], found["field_gci_mm"][contact]
        error = 0.002
        np.testing.assert_allclose(list(force.values()), 125 * error / (1 + error), rtol=1e-5)
        np.testing.assert_allclose(list(field.values()), 1.25 * 0.001, rtol=1e-5)
        assert all(found["force_gci_monotone"][contact].values())


def test_an_index_is_none_where_the_finest_mesh_is_not_followed(tmp_path, monkeypatch):
    def simulate(folder, case, mesh, ratios):
        force = np.full(5, 100.0 + 1.0 / mesh.numbers[0])
        field = np.full((5, 7, 3), 1.0 / mesh.numbers[0])
        if mesh == similar(case)[-1]:
            force[-1] = field[-1] = np.nan
        return SimpleNamespace(force=force, displacement=field, seconds=1.0, status="made up")

    monkeypatch.setattr(grid_convergence, "simulate", simulate)
    found = grid_convergence.figures(tmp_path)
    for key in ("force_gci_percent", "force_gci_order", "field_gci_mm", "force_gci_monotone"):
        *known, last = found[key]["stick"].values()
        assert last is None
        assert None not in known


def test_bounds_of_the_fitting_mesh_cover_errors_of_second_order(tmp_path, monkeypatch):
    """With errors C h^2 by the number of elements the bound is 1.25 times the fitting mesh's."""

    def error(mesh):
        return np.prod(mesh.numbers, dtype=float) ** (-2.0 / 3.0)

    def simulate(folder, case, mesh, ratios):
        force = np.linspace(100.0, 900.0, 5) * (1.0 + error(mesh))
        field = np.full((5, 7, 3), 0.4)
        field[..., 1] -= 0.02 * error(mesh)
        return SimpleNamespace(force=force, displacement=field)

    monkeypatch.setattr(mesh_uncertainty, "simulate", simulate)
    found = mesh_uncertainty.figures(tmp_path)
    for case in mesh_uncertainty.CASES:
        left = error(mesh_convergence.fitting(case))
        force = list(found["force_uncertainty_percent"][str(case)].values())
        field = list(found["field_uncertainty_mm"][str(case)].values())
        np.testing.assert_allclose(force, 125.0 * left / (1.0 + left), rtol=5e-3)
        np.testing.assert_allclose(field, 1.25 * 0.02 * left / np.sqrt(3.0), rtol=5e-3)


def test_bounds_of_a_run_that_stopped_are_refused():
    case = mesh_uncertainty.CASES[0]
    meshes = [mesh_convergence.Mesh((n, n, 1), 0.05) for n in (2, 3, 4, 5)]
    run = SimpleNamespace(force=np.array([1.0, np.nan]), reached=1.33)
    with pytest.raises(ValueError, match=r"found 1\.33 mm of 2 x 2 x 1"):
        mesh_uncertainty.bounds(case, meshes, [run] * 4, 0)
