"""Stage `population`: the hierarchical model over all samples, under every hypothesis."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib import __version__
from calib.data import Dataset
from calib.inference.at_bound import at_bound
from calib.inference.condensed import condense
from calib.inference.forward import EmulatorForward
from calib.inference.hierarchical import HierarchicalPosterior
from calib.inference.hierarchical_sampling import PopulationDraws, sample_population
from calib.inference.inference_data import save_inference_data
from calib.inference.noise import NoiseSettings, travel_zero_sd
from calib.inference.population import Population, ScatterPrior
from calib.inference.population_data import build_population_data
from calib.inference.sample_errors import SampleErrors
from calib.study.artifacts import plain
from calib.study.config import Study
from calib.study.context import Context, stream
from calib.study.data_stage import load_data
from calib.study.mesh_error_file import load_mesh_error
from calib.study.population_checks import SAMPLES
from calib.study.population_summary import population_path
from calib.study.posterior_setup import noise_of
from calib.study.sample_stage import chains_folder, settings_of
from calib.study.sections import Hypothesis
from calib.study.train_stage import load_emulator
from calib.study.unknowns import prior_of
from fe.progress_bar import progress_bar
from surrogate import ScaledEmulator


def is_wanted(study: Study) -> bool:
    """Whether the study takes its samples one by one."""
    return study.data.level == SAMPLES


def run(context: Context) -> list[Path]:
    """Sample the population under every hypothesis; returns the files population_<name>.nc."""
    study, paths = context.study, []
    data = load_data(context.out)
    for hypothesis in study.hypotheses:
        posterior = population_posterior(context, hypothesis)
        rng = stream(study, f"population {hypothesis.name}")
        label = f"population {hypothesis.name}"
        with progress_bar(label, "step", shown=context.show_progress) as progress:
            store = _store(context.out, hypothesis)
            draws = sample_population(posterior, settings_of(study), rng, progress, store)
        context.echo(f"  {hypothesis.name}: {draws.message}")
        found = build_population_data(
            posterior,
            draws,
            data.dataset,
            (noise_of(study), own_errors(study)),
            provenance(study, hypothesis, posterior, draws),
            rng,
        )
        path = population_path(context.out, hypothesis.name)
        save_inference_data(found, path)
        paths.append(path)
    # All that they hold is in the files now; killed before, finished chains are not made again.
    for hypothesis in study.hypotheses:
        shutil.rmtree(_store(context.out, hypothesis), ignore_errors=True)
    return paths


def _store(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the chains of a hypothesis' population are kept while they grow."""
    return chains_folder(out, hypothesis).with_suffix(".population")


def population_posterior(context: Context, hypothesis: Hypothesis) -> HierarchicalPosterior:
    """Posterior of a hypothesis with its emulator as forward model of every sample."""
    study, dataset = context.study, load_data(context.out).dataset
    noise, own = noise_of(study), own_errors(study)
    mesh = load_mesh_error(context.out, hypothesis)
    with_field = dataset.field is not None
    emulator = ScaledEmulator(load_emulator(context.out, hypothesis))
    forward = EmulatorForward(emulator, with_field=with_field, correction=mesh.correction)
    samples = condense(
        dataset,
        forward,
        noise,
        own,
        force_discretisation=mesh.force,
        field_floor=mesh.field_floor,
        field_patterns=mesh.field_patterns(dataset, with_own_zero(dataset, noise, own), forward),
    )
    prior = prior_of(study, hypothesis, with_field=with_field)
    assert study.population is not None  # refused when the study was read
    scatter = {
        name: ScatterPrior(size, study.population.freedom)
        for name, size in study.population.scatter.items()
        if name in prior.space.names
    }
    return HierarchicalPosterior(Population(prior, scatter), samples)


def with_own_zero(dataset: Dataset, noise: NoiseSettings, own: SampleErrors) -> NoiseSettings:
    """Where the zero of a sample's travel may lie: that of all samples and its own."""
    common = travel_zero_sd(dataset, noise)
    return replace(noise, travel_zero_sd=float(np.hypot(common, own.travel_zero_sd)))


def own_errors(study: Study) -> SampleErrors:
    """What the study assumes of one sample's own errors."""
    assert study.population is not None
    return SampleErrors(study.population.travel_zero_sd)


def leaning(
    posterior: HierarchicalPosterior, draws: PopulationDraws
) -> list[tuple[str, list[str]]]:
    """Bounds of the prior, in words, on which the population and single samples lean; by name."""
    population = posterior.population
    prior, varying = population.prior, population.varying
    x = draws.x.reshape(-1, draws.x.shape[-1])
    of_constants = prior.constant_bounds
    found = [("the population", at_bound(x, prior.bounds, prior.space, of_constants))]
    for index, name in enumerate(posterior.samples.names):
        own = x.copy()
        own[:, population.columns] = draws.own[..., index, :].reshape(len(x), -1)
        bounds = at_bound(own, prior.bounds, prior.space, of_constants)
        found.append((name, tuple(one for one in bounds if one.parameter in varying)))
    return [(name, [one.text for one in bounds]) for name, bounds in found if bounds]


def provenance(
    study: Study, hypothesis: Hypothesis, posterior: HierarchicalPosterior, draws: PopulationDraws
) -> dict[str, object]:
    """Where the draws come from and by what they are to be judged (JSON data)."""
    population = posterior.population
    facts: dict[str, object] = {
        "study": study.name,
        "hypothesis": hypothesis.name,
        "seed": study.seed,
        "version": __version__,
        "varying": population.varying,
        "common": population.common,
        "constants": population.prior.space.law.constants,
        "scatter": population.scatter,
        "leaning": leaning(posterior, draws),
        "without_field": posterior.samples.without_field,
        "limits": {"max_r_hat": study.sampler.max_r_hat, "min_ess": study.sampler.min_ess},
        "sampling": {
            "status": str(draws.status),
            "message": draws.message,
            "autocorrelation_time": draws.autocorrelation_time.max(axis=0),
            "acceptance": draws.acceptance,
        },
        "study_file": study,
    }
    described: dict[str, object] = plain(facts)
    return described
