"""A second design in the posterior's box: when, where, what it cuts off, and what it changes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_block import analytic_block
from scipy.stats import norm

from calib.inference import Marginal, Prior
from calib.inference.quadrature import Quadrature, integrate
from calib.study import local_design
from calib.study.artifacts import write_json
from calib.study.config import Study, load_study
from calib.study.context import Context
from calib.study.emulator_tables import refinement_table
from calib.study.local_design import (
    BOXES,
    LOCAL,
    MOST_CUT,
    MOST_LOST,
    REFINEMENT,
    box_of,
    designed_box,
    is_small,
    kept_box,
    local_points,
    mass_beyond,
    shares_beyond,
)
from calib.study.posterior_setup import emulator_posterior
from calib.study.stages import run_stages
from calib.study.train_stage import emulator_path, load_diagnostics, load_emulator
from calib.study.training_runs import SAME_POINT
from fe.executors import serial_map
from fe.response import Array

DESIGN = np.array([[0.0, 1.0], [0.0, 0.5]])
PRIOR = Prior(
    Marginal("log_uniform", 0.001, 0.1),
    Marginal("uniform", 0.0, 1.0),
    Marginal("normal", 0.0, 0.5, 0.2, 0.1),
)


def a_normal(mean: tuple[float, float], sd: tuple[float, float], box: Array) -> Quadrature:
    """Nodes of a normal of (r, s) cut off at a box, ln kappa known."""
    unit, weight = np.polynomial.legendre.leggauss(60)
    axes = [low + (high - low) * 0.5 * (unit + 1.0) for low, high in box]
    shares = [weight * norm.pdf(at, m, s) for at, m, s in zip(axes, mean, sd, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    weights = np.outer(*shares).ravel()
    x = np.column_stack([np.full(len(nodes), -4.0), nodes])
    return Quadrature(x, weights / weights.sum(), 0.0, 0.0)


@pytest.mark.parametrize("width", [2.0, 3.0, 4.0])
def test_the_mass_beyond_a_box_is_bounded_and_not_by_far_too_much(width: float) -> None:
    mean, sd = (0.4, 0.25), (0.01, 0.002)
    half = width * np.array(sd)
    box = np.column_stack([mean - half, mean + half])
    true = 4.0 * norm.sf(width)
    told = mass_beyond(a_normal(mean, sd, box), box, DESIGN)
    assert true < told < 3.0 * true


def test_edges_of_the_design_cut_nothing_and_a_density_that_rises_to_an_edge_is_beyond() -> None:
    mean, sd = (0.0, 0.25), (0.01, 0.002)
    box = np.array([[0.0, 0.05], [0.24, 0.26]])
    assert mass_beyond(a_normal(mean, sd, box), box, DESIGN) < 1e-4
    shifted = np.array([[-0.01, 0.05], [0.25, 0.26]])
    assert mass_beyond(a_normal(mean, sd, shifted), shifted, DESIGN) == 1.0


@pytest.mark.parametrize("nodes_end", [3.0, 7.0])
def test_nothing_of_a_posterior_that_ends_far_inside_a_box_is_beyond(nodes_end: float) -> None:
    """Quadrature has its nodes where the posterior is, which may be nowhere near an edge."""
    mean, sd = (0.4, 0.25), np.array([0.01, 0.002])
    nodes = np.column_stack([mean - nodes_end * sd, mean + nodes_end * sd])
    found = a_normal(mean, tuple(sd), nodes)
    wide = np.column_stack([mean - 20.0 * sd, mean + 20.0 * sd])
    assert mass_beyond(found, wide, DESIGN) == 0.0
    cut = wide.copy()
    cut[0, 1] = mean[0] + 0.5 * sd[0]
    assert mass_beyond(inside_of(found, cut), cut, DESIGN) > 0.1


def test_a_box_holds_the_posterior_within_the_design_and_is_small_or_not() -> None:
    wide = np.array([[0.0, 0.08], [0.24, 0.26]])
    found = a_normal((0.02, 0.25), (0.01, 0.002), wide)
    box = box_of(found, DESIGN)
    assert box[0, 0] == 0.0 and box[1, 0] == pytest.approx(0.25 - 4.5 * 0.002, rel=1e-2)
    assert is_small(box, DESIGN) and not is_small(np.array([[0.0, 0.5], [0.0, 0.2]]), DESIGN)
    few, more = local_points(box, 8, 1), local_points(box, 16, 1)
    assert ((more >= box[:, 0]) & (more <= box[:, 1])).all()
    assert len(few) == 8 and len(np.unique(more, axis=0)) == 16


def test_a_posterior_that_leans_on_a_bound_is_held_by_its_first_box() -> None:
    wide = np.array([[0.0, 0.25], [0.2, 0.3]])
    found = a_normal((0.4, 0.25), (1.0, 0.002), wide)
    leaning = found.weights * np.exp(-found.x[:, 1] / 0.01)
    found = replace(found, weights=leaning / leaning.sum())
    assert found.mean[1] == pytest.approx(0.01, rel=0.02)
    box = box_of(found, DESIGN)
    assert box[0, 0] == 0.0 and 0.10 < box[0, 1] < 0.12
    np.testing.assert_allclose(box[1], [0.241, 0.259], atol=1e-4)
    narrow = np.array([[0.0, found.mean[1] + 4.5 * found.sd[1]], box[1]])
    assert mass_beyond(inside_of(found, narrow), narrow, DESIGN) > MOST_CUT
    assert mass_beyond(inside_of(found, box), box, DESIGN) < MOST_CUT


def inside_of(found: Quadrature, box: Array) -> Quadrature:
    """The nodes within a box."""
    kept = ((found.x[:, 1:] >= box[:, 0]) & (found.x[:, 1:] <= box[:, 1])).all(axis=1)
    weights = found.weights[kept]
    return Quadrature(found.x[kept], weights / weights.sum(), 0.0, 0.0)


def test_a_prior_within_a_box_is_the_same_density_there_and_zero_outside() -> None:
    box = np.array([[0.3, 0.4], [0.2, 0.3]])
    cut = PRIOR.within(box)
    rng = np.random.default_rng(1)
    x = PRIOR.sample(rng, 4000)
    inside = ((x[:, 1:] >= box[:, 0]) & (x[:, 1:] <= box[:, 1])).all(axis=1)
    expected = np.where(inside, PRIOR.log_prob(x), -np.inf)
    np.testing.assert_allclose(cut.log_prob(x), expected, rtol=1e-12)
    assert 0 < inside.sum() < 4000
    truth = 0.1 * (norm.cdf(1.0) - norm.cdf(0.0)) / (norm.cdf(3.0) - norm.cdf(-2.0))
    assert np.exp(cut.log_share) == pytest.approx(truth, rel=1e-12)
    drawn = cut.sample(rng, 500)
    assert np.isfinite(cut.log_prob(drawn)).all()
    with pytest.raises(ValueError, match=r"box: expected shape \(2, 2\)"):
        PRIOR.within(box[:1])


ROUND = {
    "n_train": 20,
    "predicted_shift": [0.0, 0.0, 0.0],
    "force_error": [1e-3],
    "rms_z": 1.0,
    "n_added": 1,
}


def narrow() -> Study:
    """A field so exact that the posterior is narrow."""
    study = load_study("virtual")
    assert study.virtual is not None
    return replace(
        study,
        hypotheses=study.hypotheses[1:],
        virtual=replace(study.virtual, field_noise_std=(0.001, 0.001, 0.002)),
        design=replace(study.design, n_runs=8, n_held_out=2, n_refine=4, n_local=8),
    )


@pytest.fixture(scope="module")
def context(tmp_path_factory: pytest.TempPathFactory) -> Context:
    out = tmp_path_factory.mktemp("local")
    found = Context(narrow(), out, analytic_block, serial_map, lambda _: None, show_progress=False)  # type: ignore[arg-type]
    run_stages(found, until="check")
    return found


@pytest.mark.slow
def test_a_narrow_posterior_gets_a_design_and_an_emulator_of_its_own(context: Context) -> None:
    [hypothesis] = context.study.hypotheses
    box = kept_box(context.out, hypothesis)
    assert box is not None
    facts = json.loads((context.out / REFINEMENT).read_text())[hypothesis.name]
    assert facts["mass_beyond"] < MOST_CUT and len(facts["local"]) >= 8
    assert shares_beyond(context.out)[hypothesis.name] < MOST_LOST  # after the last check, too
    local = load_emulator(context.out / LOCAL, hypothesis)
    assert (local.bounds[:, 0] >= box[:, 0]).all() and (local.bounds[:, 1] <= box[:, 1]).all()
    assert local.header.n_train >= 8
    # That of the whole box does not learn from the second design.
    whole = load_emulator(context.out, hypothesis)
    single = np.delete(np.array(facts["ratios"]), facts["local"], axis=0)
    # The first mean by the field, where the mesh is checked again, and the last may be one place.
    assert facts["checked"] == [0, 1, len(facts["ratios"]) - 1]
    near = SAME_POINT * np.ptp(whole.bounds, axis=1)
    again = (np.abs(single[1] - single[2]) <= near).all()
    assert whole.header.n_train == 8 + len(single) - again
    assert np.prod(np.ptp(whole.bounds, axis=1)) > 10.0 * np.prod(np.ptp(box, axis=1))
    assert load_diagnostics(context.out / LOCAL)[hypothesis.name]["held_out"] is None


@pytest.mark.slow
def test_the_posterior_of_the_box_is_that_of_the_whole_with_its_evidence(context: Context) -> None:
    [hypothesis] = context.study.hypotheses
    box = kept_box(context.out, hypothesis)
    posterior = emulator_posterior(context, hypothesis)
    np.testing.assert_allclose(posterior.prior.bounds[1:], box, rtol=1e-12)
    found = integrate(posterior)
    whole = integrate(emulator_posterior(context, hypothesis, whole=True))
    # The stand-in is smooth: here both emulators are as good.
    np.testing.assert_allclose(found.mean, whole.mean, atol=0.1 * whole.sd.min())
    np.testing.assert_allclose(found.sd, whole.sd, rtol=0.05)
    assert found.log_evidence == pytest.approx(whole.log_evidence, abs=0.1)


@pytest.mark.slow
def test_a_second_design_ends_with_the_same_bits_again(context: Context, tmp_path: Path) -> None:
    run_stages(replace(context, out=tmp_path), until="refine")
    [hypothesis] = context.study.hypotheses
    for name in (REFINEMENT, emulator_path(Path(LOCAL), hypothesis)):
        assert (tmp_path / name).read_bytes() == (context.out / name).read_bytes()


@pytest.mark.slow
def test_a_box_that_cuts_the_posterior_off_is_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_design, "WIDTH", 1.0)
    monkeypatch.setattr(local_design, "TAIL", 0.2)
    study = narrow()
    found = Context(
        study, tmp_path, analytic_block, serial_map, lambda _: None, show_progress=False
    )  # type: ignore[arg-type]
    run_stages(found, until="refine")
    facts = json.loads((tmp_path / REFINEMENT).read_text())["sliding"]
    assert len(facts["local"]) == 3 * 8
    # None of the three holds it: the emulator of the prior's box is the better one.
    assert facts["box"] is None and facts["mass_beyond"] == 0.0
    shares = [found["mass_beyond"] for found in facts["rounds"]]
    assert max(shares) > MOST_LOST
    [hypothesis] = study.hypotheses
    assert kept_box(tmp_path, hypothesis) is None


def test_a_posterior_that_its_last_check_moved_out_of_its_box_is_that_of_the_priors(
    tmp_path: Path,
) -> None:
    hypothesis = load_study("virtual").hypotheses[0]
    box = [[0.1, 0.2], [0.3, 0.4]]
    found = {"box": box, "local": [1], "mass_beyond": 1e-5, "limit": 0.05, "rounds": [ROUND]}
    write_json(tmp_path / REFINEMENT, {"stuck": found})
    np.testing.assert_array_equal(kept_box(tmp_path, hypothesis), box)  # type: ignore[arg-type]
    for share, held in ((0.5 * MOST_LOST, True), (2.0 * MOST_LOST, False)):
        write_json(tmp_path / BOXES, {"stuck": share})
        assert (kept_box(tmp_path, hypothesis) is not None) == held
        note = refinement_table({"stuck": found}, shares_beyond(tmp_path)).note
        assert (f"leaves {share:.1g} of it outside" in note) == held
        assert ("with the emulator of the prior's" in note) != held
    np.testing.assert_array_equal(designed_box(tmp_path, hypothesis), box)  # type: ignore[arg-type]
