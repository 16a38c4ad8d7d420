"""Draws of a population and its samples as ArviZ InferenceData: units, names, a new sample."""

from __future__ import annotations

import json
from collections.abc import Mapping

import arviz as az
import numpy as np
import xarray as xr

from calib.data.dataset import Dataset
from calib.inference.coordinates import Space, theta_of
from calib.inference.hierarchical import HierarchicalPosterior
from calib.inference.hierarchical_sampling import PopulationDraws
from calib.inference.noise import NoiseSettings
from calib.inference.sample_errors import SampleErrors
from fe.response import Array

SD, ONE, NEW, ALONE = "sd_", "_sample", "_new", "_alone"
"""of the names of an SD between samples, of what a sample, a new sample and a sample alone have"""
MAX_DRAWS = 8_000
"""largest number of kept draws; more are thinned"""
MAX_ALONE = 1_000


def build_population_data(
    posterior: HierarchicalPosterior,
    draws: PopulationDraws,
    dataset: Dataset,
    errors: tuple[NoiseSettings, SampleErrors],
    provenance: Mapping[str, object],
    rng: np.random.Generator,
) -> az.InferenceData:
    """Groups posterior, posterior_predictive, constant_data, observed_data.

    posterior, dims (chain, draw): `kappa` and the like are the population's (of what is normal by
    its logarithm the median), constants are those at them; `sd_kappa` the SD between samples, of ln
    kappa and the like, else in the parameter's unit; `kappa_sample` with the further dim sample
    each sample's; `kappa_new` those of a sample not yet seen. posterior_predictive: `force_new`
    (travel), N, as it would be measured, with all errors. constant_data: `kappa_alone` (alone,
    sample) draws of each sample by its own data, `fit_p` (sample). Chains are walkers, thinned.
    """
    kept = _thinned(draws)
    x, tau, own, z = kept
    space = posterior.population.prior.space
    flat = x.reshape(-1, x.shape[-1])
    new = posterior.population.draw_new(flat, tau.reshape(len(flat), -1), rng)
    force = _force_of_new(posterior, new, z.reshape(len(flat), -1), errors, rng)
    shape = x.shape[:2]
    dims = ("chain", "draw")
    variables = _variables(space, x, dims, "")
    for column, name in zip(range(tau.shape[-1]), posterior.population.varying, strict=True):
        unknown = space.unknowns[space.names.index(name)]
        note = {
            "units": "1" if unknown.log else unknown.unit,
            "long_name": f"SD between samples of {unknown.x_name}",
        }
        variables[SD + name] = (dims, tau[..., column], note)
    variables |= _variables(space, _whole(posterior, x, own), (*dims, "sample"), ONE)
    variables |= _variables(space, new.reshape(*shape, -1), dims, NEW)
    n_ensemble, n_walker = draws.x.shape[0], draws.x.shape[2]
    coords = {
        "chain": np.arange(shape[0]),
        "draw": np.arange(shape[1]),
        "ensemble": ("chain", np.repeat(np.arange(n_ensemble), n_walker)),
        "sample": list(posterior.samples.names),
    }
    travel = ("travel", dataset.travel, {"units": "mm", "long_name": "pin travel"})
    replicate = (
        (*dims, "travel"),
        force.reshape(*shape, -1),
        {"units": "N", "long_name": "force of a new sample as it would be measured"},
    )
    few = {name: coords[name] for name in ("chain", "draw")}
    return az.InferenceData(
        attrs={"provenance": json.dumps(dict(provenance), sort_keys=True)},
        posterior=xr.Dataset(variables, coords),
        posterior_predictive=xr.Dataset({"force_new": replicate}, {**few, "travel": travel}),
        constant_data=_alone(posterior, draws),
        observed_data=_observed(dataset, posterior.samples.names, travel),
    )


def _thinned(draws: PopulationDraws) -> tuple[Array, Array, Array, Array]:
    """x, tau, own, z with the dims (chain, draw, ...); the last draw is kept."""
    n_ensemble, n_step, n_walker = draws.x.shape[:3]
    every = max(1, int(np.ceil(n_ensemble * n_step * n_walker / MAX_DRAWS)))

    def chains(values: Array) -> Array:
        few = values[:, ::-1][:, ::every][:, ::-1].swapaxes(1, 2)
        return few.reshape(-1, *few.shape[2:])

    return chains(draws.x), chains(draws.tau), chains(draws.own), chains(draws.z)


def _whole(posterior: HierarchicalPosterior, x: Array, own: Array) -> Array:
    """(..., n, d) all coordinates of the samples, with what is common from x (..., d)."""
    whole = np.repeat(x[..., None, :], own.shape[-2], axis=-2)
    whole[..., posterior.population.columns] = own
    return whole


def _variables(
    space: Space, x: Array, dims: tuple[str, ...], suffix: str
) -> dict[str, tuple[tuple[str, ...], Array, dict[str, str]]]:
    """Constants and parameters of coordinates x (..., d) by name."""
    law = space.law
    constants = np.moveaxis(space.constants(theta_of(x)), -1, 0)
    found = {
        name + suffix: (dims, values, {"units": unit, "long_name": f"{law.name} {name}"})
        for name, unit, values in zip(law.constants, law.units, constants, strict=True)
    }
    natural = np.moveaxis(space.natural(x), -1, 0)
    for unknown, values in zip(space.unknowns, natural, strict=True):
        note = {"units": unknown.unit, "long_name": unknown.meaning}
        found.setdefault(unknown.name + suffix, (dims, values, note))
    return found


def _force_of_new(
    posterior: HierarchicalPosterior,
    new: Array,
    z: Array,
    errors: tuple[NoiseSettings, SampleErrors],
    rng: np.random.Generator,
) -> Array:
    """(m, n_step) forces of new samples (m, d) with common errors z (m, q) and their own, N."""
    samples, (noise, own) = posterior.samples, errors
    force, moved = samples.forces(theta_of(new), z)
    zero = own.travel_zero_sd * rng.standard_normal((len(new), 1))
    noise_here = noise.load_cell_sd * rng.standard_normal(force.shape)
    found: Array = force + moved + zero * (force @ samples.errors.slope.T) + noise_here
    return found


def _alone(posterior: HierarchicalPosterior, draws: PopulationDraws) -> xr.Dataset:
    """Draws of each sample by its own data, with what is common as all data say."""
    space, names = posterior.population.prior.space, posterior.population.varying
    whole = draws.alone[:: max(1, len(draws.alone) // MAX_ALONE)]
    variables = {
        name: values
        for name, values in _variables(space, whole, ("alone", "sample"), ALONE).items()
        if name.removesuffix(ALONE) in (*names, *space.law.constants)
    }
    note = {"units": "1", "long_name": "p-value of the chi-square of the sample's residuals"}
    return xr.Dataset(
        {**variables, "fit_p": (("sample",), draws.p_value, note)},
        {"sample": list(posterior.samples.names)},
    )


def _observed(dataset: Dataset, names: tuple[str, ...], travel: object) -> xr.Dataset:
    assert dataset.samples is not None
    note = {"units": "N", "long_name": "force of each sample"}
    return xr.Dataset(
        {"force": (("sample", "travel"), dataset.samples.force, note)},
        {"sample": list(names), "travel": travel},
        {"name": dataset.name, "synthetic": int(dataset.synthetic)},
    )
