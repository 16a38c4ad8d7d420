"""Posterior samples as ArviZ InferenceData and netCDF."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import arviz as az
import h5py
import numpy as np
import xarray as xr

from calib.data.dataset import Dataset
from calib.disk_full import DiskFullError
from calib.inference.coordinates import Space, theta_of
from calib.inference.likelihood import Likelihood
from calib.inference.prediction import expected_forces, predictive_forces
from calib.inference.sampling import SamplingResult
from fe.atomic_file import replacing
from fe.progress_bar import Progress
from fe.response import Array

NAMES = {
    "C10": "Mooney-Rivlin C10",
    "C01": "Mooney-Rivlin C01",
    "C11": "Mooney-Rivlin C11",
    "mu": "small-strain shear modulus 2 (C10 + C01)",
    "kappa": "C10 + C01",
}
"""what the names mean in the Mooney-Rivlin laws, which name them"""
MAX_DRAWS = 40_000
"""largest number of kept samples of one hypothesis (all chains); more are thinned"""
BATCH = 8192


@dataclass(frozen=True)
class HypothesisSamples:
    """What one hypothesis brings to the file."""

    likelihood: Likelihood
    samples: SamplingResult
    space: Space = field(default_factory=Space)
    """what was unknown under it"""


def build_inference_data(
    hypotheses: Mapping[str, HypothesisSamples],
    dataset: Dataset,
    provenance: Mapping[str, object],
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> az.InferenceData:
    """Groups posterior, posterior_predictive, log_likelihood, observed_data.

    A parameter that a hypothesis does not have is NaN under it.

    The log likelihood is called `force`, or `force_and_field` where it holds both. A measured field
    itself is not copied into observed_data; it stays in the study's data file. Acceptance and
    autocorrelation times belong to ensembles, not draws, and stand in the provenance.

    Samples have dims (hypothesis, chain, draw): a chain is one walker, its coordinate `ensemble`
    says of which ensemble. Chains are thinned by half the shortest autocorrelation time, more if
    MAX_DRAWS is exceeded, and cut to the length of the shortest hypothesis (the latest draws are
    kept). `provenance` must be JSON data; it goes into the attribute `provenance`.
    Raises ValueError when there is no hypothesis or the ensembles differ in number or walkers.
    """
    if not hypotheses:
        raise ValueError("hypotheses: expected at least one")
    chains = {name: _thinned(given.samples) for name, given in hypotheses.items()}
    shapes = {chain.shape[:1] + chain.shape[2:3] for chain in chains.values()}
    if len(shapes) > 1:
        raise ValueError(f"hypotheses: ensembles and walkers must agree, found {sorted(shapes)}")
    n_draw = min(chain.shape[1] for chain in chains.values())
    x = [_as_chains(chain[:, -n_draw:]) for chain in chains.values()]
    coords = _coords(tuple(hypotheses), chains, n_draw, dataset)
    likelihoods = [given.likelihood for given in hypotheses.values()]
    return az.InferenceData(
        attrs={"provenance": json.dumps(dict(provenance), sort_keys=True)},
        posterior=_posterior(x, coords, [given.space for given in hypotheses.values()]),
        posterior_predictive=_predictive(x, coords, likelihoods, rng),
        log_likelihood=_log_likelihood(x, coords, likelihoods, progress),
        observed_data=_observed(dataset),
    )


def provenance_of(data: az.InferenceData) -> dict[str, object]:
    """The provenance that was stored with the samples; raises ValueError when it is damaged."""
    try:
        stored = json.loads(data.attrs["provenance"])
    except (TypeError, ValueError) as error:
        raise ValueError(f"its provenance is not JSON ({error})") from error
    if not isinstance(stored, dict):
        raise ValueError(f"its provenance is a {type(stored).__name__}, not a table")
    return stored


def stated_provenance(path: Path) -> dict[str, object]:
    """The provenance in a posterior.nc, whose samples stay unread.

    Raises ValueError naming the file when it cannot be read or states none.
    """
    try:
        with h5py.File(path, "r") as file:
            stored = json.loads(str(file.attrs["provenance"]))
    except (OSError, KeyError, ValueError) as error:
        raise ValueError(f"{path}: not a readable posterior ({_reason(error)})") from error
    if not isinstance(stored, dict):
        raise ValueError(f"{path}: found no table of provenance, expected a posterior of a study")
    return stored


def _thinned(samples: SamplingResult) -> Array:
    """(n_ensemble, n_draw, n_walker, d) with little more than one draw per memory length."""
    n_ensemble, n_step, n_walker, _ = samples.chains.shape
    shortest = samples.autocorrelation_time.min()
    by_memory = int(shortest / 2) if np.isfinite(shortest) else 1
    by_size = int(np.ceil(n_ensemble * n_step * n_walker / MAX_DRAWS))
    step = min(max(1, by_memory, by_size), max(1, n_step // 8))
    # Counted from the end, so that the last draw is kept.
    kept: Array = samples.chains[:, ::-1][:, ::step][:, ::-1]
    return kept


def _as_chains(chain: Array) -> Array:
    """(n_ensemble * n_walker, n_draw, d), ensembles one after the other."""
    moved = chain.transpose(0, 2, 1, 3)
    return moved.reshape(-1, *moved.shape[2:])


def _coords(
    names: tuple[str, ...], chains: Mapping[str, Array], n_draw: int, dataset: Dataset
) -> dict[str, object]:
    n_ensemble, _, n_walker, _ = next(iter(chains.values())).shape
    return {
        "hypothesis": list(names),
        "chain": np.arange(n_ensemble * n_walker),
        "draw": np.arange(n_draw),
        "ensemble": ("chain", np.repeat(np.arange(n_ensemble), n_walker)),
        "travel": ("travel", dataset.travel, {"units": "mm", "long_name": "pin travel"}),
    }


def _posterior(x: list[Array], coords: Mapping[str, object], spaces: list[Space]) -> xr.Dataset:
    found = [_named(draws, space) for draws, space in zip(x, spaces, strict=True)]
    notes = {
        name: {"units": unit, "long_name": meaning}
        for space in spaces
        for name, unit, meaning in _described(space)
    }
    absent = np.full(x[0].shape[:2], np.nan)
    dims = ("hypothesis", "chain", "draw")
    variables = {
        name: (dims, np.array([values.get(name, absent) for values in found]), note)
        for name, note in notes.items()
    }
    return xr.Dataset(variables, {k: v for k, v in coords.items() if k != "travel"})


def _described(space: Space) -> list[tuple[str, str, str]]:
    """Name, unit and meaning of the constants and the parameters under one hypothesis."""
    law = space.law
    constants = zip(law.constants, law.units, strict=True)
    described = [(n, unit, NAMES.get(n, f"{law.name} {n}")) for n, unit in constants]
    return described + [(u.name, u.unit, NAMES.get(u.name, u.meaning)) for u in space.unknowns]


def _named(x: Array, space: Space) -> dict[str, Array]:
    """Draws (n_chain, n_draw) of constants and parameters by name."""
    constants = np.moveaxis(space.constants(theta_of(x)), -1, 0)
    values = dict(zip(space.law.constants, constants, strict=True))
    natural = np.moveaxis(space.natural(x), -1, 0)
    return values | {n: v for n, v in zip(space.names, natural, strict=True) if n not in values}


def _predictive(
    x: list[Array],
    coords: Mapping[str, object],
    likelihoods: list[Likelihood],
    rng: np.random.Generator,
) -> xr.Dataset:
    """Replicates of the measured mean force, and the model's force without any error."""
    dims = ("hypothesis", "chain", "draw", "travel")
    flat = [draws.reshape(-1, draws.shape[-1]) for draws in x]
    pairs = list(zip(likelihoods, flat, strict=True))
    replicate = np.array([predictive_forces(like, draws, rng) for like, draws in pairs])
    model = np.array([expected_forces(like, draws) for like, draws in pairs])
    shape = (len(x), *x[0].shape[:2], -1)
    note = {"units": "N", "long_name": "replicated mean force of the measured number of samples"}
    bare = {"units": "N", "long_name": "force of the model without errors"}
    return xr.Dataset(
        {
            "force": (dims, replicate.reshape(shape), note),
            "model_force": (dims, model.reshape(shape), bare),
        },
        dict(coords),
    )


def _log_likelihood(
    x: list[Array],
    coords: Mapping[str, object],
    likelihoods: list[Likelihood],
    progress: Progress | None,
) -> xr.Dataset:
    """Conditional log density of each increment given the others (for leave-one-out)."""
    pointwise: list[Array] = []
    n = x[0].shape[0] * x[0].shape[1]
    for likelihood, draws in zip(likelihoods, x, strict=True):
        theta, parts = theta_of(draws.reshape(-1, draws.shape[-1])), []
        for start in range(0, n, BATCH):
            if progress is not None:
                progress(len(pointwise) * n + start, len(x) * n)
            parts.append(likelihood.pointwise(theta[start : start + BATCH]))
        pointwise.append(np.concatenate(parts).reshape(*draws.shape[:2], -1))
    if progress is not None:
        progress(len(x) * n, len(x) * n)
    dims = ("hypothesis", "chain", "draw", "travel")
    note = {"units": "1", "long_name": "log density of an increment given all others"}
    name = "force" if likelihoods[0].field is None else "force_and_field"
    return xr.Dataset({name: (dims, np.array(pointwise), note)}, dict(coords))


def _observed(dataset: Dataset) -> xr.Dataset:
    travel = ("travel", dataset.travel, {"units": "mm", "long_name": "pin travel"})
    count = {"units": "N", "n_samples": dataset.n_samples}
    attrs = {"name": dataset.name, "synthetic": int(dataset.synthetic)}
    variables = {
        "force": ("travel", dataset.force_mean, {**count, "long_name": "mean force"}),
        "force_sd": ("travel", dataset.force_sd, {**count, "long_name": "SD between samples"}),
    }
    return xr.Dataset(variables, {"travel": travel}, attrs)


def save_inference_data(data: az.InferenceData, path: Path) -> None:
    """Write netCDF atomically: a reader sees the old file or the new one, never half of one.

    Raises OSError naming `path` where it cannot be written, `DiskFullError` of a full disk; the old
    file is left.
    """
    with replacing(path) as temporary:
        try:
            data.to_netcdf(str(temporary), engine="h5netcdf")
        except RuntimeError as error:  # of HDF5, as it closes what a full disk did not take
            why = _reason(error).replace(str(temporary), path.name)
            raise DiskFullError(
                f"{path}: cannot be written, expected a disk with room for it (HDF5: {why})"
            ) from error


def _reason(error: Exception) -> str:
    """What the library says of a damaged file, without its own parts in further brackets."""
    return str(error).partition("\n")[0].partition(" (")[0]


def load_inference_data(path: Path) -> az.InferenceData:
    """Read what `save_inference_data` wrote, into memory.

    Raises ValueError naming the file when it cannot be read or holds no posterior.
    """
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise ValueError(f"{path}: found {found}, expected a posterior of this program")
    try:
        data: az.InferenceData = az.from_netcdf(  # type: ignore[no-untyped-call]
            str(path), engine="h5netcdf"
        )
        data.load()
        data.close()
    except (OSError, ValueError, KeyError) as error:
        raise ValueError(f"{path}: not a readable posterior ({_reason(error)})") from error
    if "posterior" not in data.groups() or "provenance" not in data.attrs:
        raise ValueError(f"{path}: holds no posterior of this program; run the study again")
    try:
        provenance_of(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}; run the study again") from error
    return data
