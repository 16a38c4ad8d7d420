"""What was drawn of a population comes back from its file, and is shown."""

from __future__ import annotations

import csv
from dataclasses import asdict, replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from test_calib_study_summary import _summary

from benchmarks.linear_population import NOISE, OWN, condensed, dataset, forces, population
from calib.inference.hierarchical import HierarchicalPosterior
from calib.inference.hierarchical_sampling import PopulationDraws, sample_population
from calib.inference.inference_data import save_inference_data
from calib.inference.population import ScatterPrior
from calib.inference.population_data import build_population_data
from calib.inference.sampling import SamplerSettings
from calib.study.artifacts import plain
from calib.study.figure_style import png_bytes
from calib.study.hierarchical_stage import leaning
from calib.study.population_figures import new_sample_forces, shrinkage
from calib.study.population_summary import (
    PopulationSummary,
    is_beyond,
    is_prior,
    load_population,
    population_remarks,
    worst_of_samples,
)
from calib.study.population_tables import population_tables
from calib.study.summary import _with_population, judgement_lines
from calib.study.summary_files import to_csv

N = 5
FORCE = forces(
    np.column_stack([0.1 * np.arange(N), np.full(N, 0.4)]), np.random.default_rng(2), 0.1
)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[PopulationSummary, PopulationDraws]:
    data = dataset(FORCE)
    posterior = HierarchicalPosterior(population(), condensed(data, 0.1))
    settings = SamplerSettings(n_ensembles=2, n_walkers=16, max_steps=20, check_every=20)
    draws = sample_population(posterior, settings, np.random.default_rng(1))
    facts = {
        "varying": ["kappa"],
        "constants": posterior.population.prior.space.law.constants,
        "scatter": posterior.population.scatter,
        "limits": {"max_r_hat": 1.01, "min_ess": 400.0},
        "sampling": {"message": draws.message},
    }
    stored = build_population_data(
        posterior, draws, data, (NOISE, OWN), plain(facts), np.random.default_rng(3)
    )
    path: Path = tmp_path_factory.mktemp("population") / "population_linear.nc"
    save_inference_data(stored, path)
    return load_population(path), draws


def test_stored_means_are_those_of_the_draws(
    found: tuple[PopulationSummary, PopulationDraws],
) -> None:
    summary, draws = found
    assert summary.sample_names == ("S1", "S2", "S3", "S4", "S5")
    kappa = np.exp(draws.own[..., 0]).mean(axis=(0, 1, 2))
    assert [one.mean for one in summary.samples["kappa"]] == pytest.approx(kappa)
    assert summary.population["sd_kappa"].mean == pytest.approx(draws.tau.mean())
    assert summary.population["r"].mean == pytest.approx(draws.x[..., 1].mean())
    assert summary.population["mu"].unit == "MPa" and summary.population["sd_kappa"].unit == "1"
    assert summary.fit_p == pytest.approx(draws.p_value)
    # what is common to all is drawn, too: C10 = (1 - r) kappa of a sample by itself
    assert draws.alone[..., 1].std() == pytest.approx(draws.x[..., 1].std(), rel=0.5)
    each = (1.0 - draws.alone[..., 1]) * np.exp(draws.alone[..., 0])
    assert [one.sd for one in summary.alone["C10"]] == pytest.approx(each.std(axis=0), rel=0.02)


def test_a_new_sample_is_less_known_than_the_population(
    found: tuple[PopulationSummary, PopulationDraws],
) -> None:
    summary, _ = found
    assert summary.new["kappa"].sd > summary.population["kappa"].sd
    spread = FORCE.std(axis=0, ddof=1)
    for force, seen, sd in zip(summary.force_new, FORCE.mean(axis=0), spread, strict=True):
        assert abs(force.mean - seen) < 3 * sd and force.sd > 0.5 * sd


def test_tables_name_units_and_short_chains_fail(
    found: tuple[PopulationSummary, PopulationDraws],
) -> None:
    summary, _ = found
    population_text, new, samples = (t.text() for t in population_tables(summary, "linear"))
    assert "SD of kappa between samples" in population_text and "MPa" in population_text
    assert "force at 0.5 mm" in new and "by itself" in samples
    assert any("ESS" in failure for failure in summary.failures)
    assert population_tables(None, "linear") == []


def test_a_sample_that_nothing_explains_and_a_narrow_prior_of_scatter_are_told(
    found: tuple[PopulationSummary, PopulationDraws],
) -> None:
    summary, _ = found
    fine = replace(
        summary,
        fit_p=(0.5, 0.4, 0.03, 0.9, 0.2),
        beyond_prior=(),
        leaning=(),
        sampling={"status": "converged", "message": ""},
    )
    assert population_remarks(fine) == []
    cut = {"status": "max_steps", "message": "kept 6 times; stopped at max_steps"}
    [said] = population_remarks(replace(fine, sampling=cut))
    assert said == f"the population's chains were stopped early: {cut['message']}"
    odd = replace(
        fine,
        fit_p=(0.5, 0.4, 1e-3, 0.9, 0.2),
        beyond_prior=("sd_kappa",),
        leaning=(("S4", "kappa = 0.005 MPa"),),
        without_field=("S2",),
    )
    lines = judgement_lines([replace(_summary(), population=odd)])
    assert any(
        line.startswith("LOOK AT") and "of S3 lie outside what any constants" in line
        for line in lines
    )
    assert any("S4 leans on the prior's kappa = 0.005 MPa: a" in line for line in lines)
    assert any("the scatter of kappa lies beyond what its prior expects" in line for line in lines)
    assert any("of S2 the forces count alone: no point of its field" in line for line in lines)


def test_samples_that_lean_on_one_bound_are_told_in_one_sentence(
    found: tuple[PopulationSummary, PopulationDraws],
) -> None:
    leaning = [("the population", "r = 0"), ("S1", "s = 0"), ("S2", "r = 0")]
    summary = replace(found[0], leaning=tuple(leaning))
    said = [line for line in population_remarks(summary) if "on the prior's" in line]
    assert [line.partition(" on ")[0] for line in said] == [
        "the population and S2 lean", "S1 leans",
    ]  # fmt: skip
    many = replace(summary, leaning=tuple((f"S{i}", "r = 0") for i in range(1, 9)))
    [said_once] = [line for line in population_remarks(many) if "on the prior's" in line]
    assert said_once.startswith("S1, S2, S3 and 5 more lean on the prior's r = 0: a convention")


def test_the_one_sample_whose_chains_do_not_agree_is_named() -> None:
    draws = np.random.default_rng(4).standard_normal((32, 200, 5))
    draws[16:, :, 3] += 5.0  # the fourth sample in the second ensemble
    posterior = xr.Dataset(
        {"kappa_sample": (("chain", "draw", "sample"), draws)},
        {"sample": [f"S{i + 1}" for i in range(5)], "ensemble": ("chain", np.repeat([0, 1], 16))},
    )
    worst = worst_of_samples(posterior, ["kappa"])
    assert worst["kappa of S4"].r_hat > 1.5 and len(worst) == 1


def test_bounds_that_samples_lean_on_are_named(
    found: tuple[PopulationSummary, PopulationDraws],
) -> None:
    _, draws = found
    posterior = HierarchicalPosterior(population(), condensed(dataset(FORCE), 0.1))
    names = [name for name, _ in leaning(posterior, draws)]
    assert not set(names) & {"S1", "S2", "S3", "S4", "S5"}
    low = posterior.population.prior.bounds[0, 0]
    own = draws.own.copy()
    own[..., 3, 0] = low + np.abs(np.random.default_rng(0).normal(size=own.shape[:3]))
    told = dict(leaning(posterior, replace(draws, own=own)))
    assert len(told["S4"]) == 1 and told["S4"][0].startswith(f"kappa = {np.exp(low):g} MPa")
    assert "S3" not in told


def test_a_scatter_is_the_prior_s_where_it_is_as_wide_and_at_its_place() -> None:
    facts = {"scatter": {"kappa": asdict(ScatterPrior(0.3))}}
    quantiles = ScatterPrior(0.3).quantile(np.linspace(0.001, 0.999, 999))
    draws = {"prior": quantiles, "known": 0.2 + 0.1 * quantiles, "beyond": 0.7 + quantiles}
    judged = {
        name: [
            judge(SimpleNamespace(values=values), "kappa", facts) for judge in (is_prior, is_beyond)
        ]
        for name, values in draws.items()
    }
    assert judged == {
        "prior": [True, False], "known": [False, False], "beyond": [False, True]
    }  # fmt: skip


def test_figures_are_drawn(found: tuple[PopulationSummary, PopulationDraws]) -> None:
    summary, _ = found
    for figure in (shrinkage(summary), new_sample_forces(summary, FORCE)):
        assert len(png_bytes(figure, dpi=50)) > 2000


def test_csv_has_a_line_for_population_new_sample_and_every_sample(
    found: tuple[PopulationSummary, PopulationDraws],
) -> None:
    summary, _ = found
    averaged = _summary()
    lines = list(csv.DictReader(StringIO(to_csv([replace(averaged, population=summary)]))))
    by_place = {(line["of"], line["constant"]): line for line in lines}
    assert len(by_place) == len(lines)
    assert ("averaged sample", "mu") in by_place
    scatter = by_place["population", "sd_kappa"]
    assert float(scatter["mean"]) == summary.population["sd_kappa"].mean
    assert float(scatter["r_hat"]) == summary.convergence["sd_kappa"].r_hat
    assert float(by_place["new sample", "mu"]["sd"]) == summary.new["mu"].sd
    for index, name in enumerate(summary.sample_names):
        assert float(by_place[name, "fit_p"]["mean"]) == pytest.approx(summary.fit_p[index])
        assert float(by_place[name, "kappa"]["mean"]) == summary.samples["kappa"][index].mean
        alone = by_place[f"{name} by itself", "kappa"]
        assert float(alone["mean"]) == summary.alone["kappa"][index].mean


def test_a_population_that_the_study_asks_for_and_that_is_not_there_is_a_failure(
    tmp_path: Path,
) -> None:
    """As of a run that was killed before it: the averaged sample's table alone is no answer."""
    summary = _with_population(_summary(), tmp_path)
    assert summary.population is None and not summary.passed
    assert summary.failures[-1].startswith("population: not sampled yet")
