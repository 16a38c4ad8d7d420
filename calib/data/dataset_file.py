"""A Dataset as one npz file: no pickle, with a version and the hash of what it was made from."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from calib.data.dataset import Dataset, FieldData, SampleData
from fe.atomic_file import replacing
from fe.response import Array

VERSION = 1
"""of the file's layout; another one is refused"""
_FORCES = ("travel", "force_mean", "force_sd")
_EXPECTED = "expected a data set of `calib qc`"
_NOISE = ("correlation_length", "reference_share", "nugget")

Arrays = dict[str, Any]
"""arrays by name"""


def dataset_arrays(dataset: Dataset) -> Arrays:
    """All that a dataset holds, as arrays that need no pickle."""
    arrays: Arrays = {name: getattr(dataset, name) for name in _FORCES}
    arrays |= {
        "name": np.array(dataset.name),
        "synthetic": np.array(dataset.synthetic),
        "n_samples": np.array(dataset.n_samples),
    }
    if dataset.travel_zero_sd > 0:
        arrays["travel_zero_sd"] = np.array(dataset.travel_zero_sd)
    if dataset.force_covariance is not None:
        arrays["force_covariance"] = dataset.force_covariance
    field, samples = dataset.field, dataset.samples
    if field is not None:
        arrays |= {name: getattr(field, name) for name in ("points", "displacement", "noise_std")}
        arrays |= {name: np.array(getattr(field, name)) for name in _NOISE}
        if field.scale_sd > 0:
            arrays["scale_sd"] = np.array(field.scale_sd)
        if field.smoothing > 0:
            arrays["smoothing"] = np.array(field.smoothing)
        if field.patterns is not None:
            arrays["patterns"] = field.patterns
    if samples is not None:
        arrays["sample_names"] = np.array(samples.names)
        arrays["sample_force"] = samples.force
        arrays["sample_displacement"] = samples.displacement
        if samples.noise_std is not None:
            arrays["sample_noise_std"] = samples.noise_std
    return arrays


def dataset_of_arrays(arrays: Arrays) -> Dataset:
    """The dataset that `dataset_arrays` took apart. Raises KeyError and ValueError otherwise."""
    field = samples = None
    if "displacement" in arrays:
        field = FieldData(
            points=arrays["points"],
            displacement=arrays["displacement"],
            noise_std=arrays["noise_std"],
            patterns=arrays.get("patterns"),
            scale_sd=float(arrays.get("scale_sd", 0.0)),
            # files of before it was known have exp(-d / length)
            smoothing=float(arrays.get("smoothing", 0.0)),
            **{name: float(arrays[name]) for name in _NOISE},
        )
    if "sample_names" in arrays:
        names = tuple(str(name) for name in arrays["sample_names"])
        force, displacement = arrays["sample_force"], arrays["sample_displacement"]
        samples = SampleData(names, force, displacement, arrays.get("sample_noise_std"))
    return Dataset(
        name=str(arrays["name"]),
        synthetic=bool(arrays["synthetic"]),
        n_samples=int(arrays["n_samples"]),
        field=field,
        force_covariance=arrays.get("force_covariance"),
        samples=samples,
        travel_zero_sd=float(arrays.get("travel_zero_sd", 0.0)),
        **{name: arrays[name] for name in _FORCES},
    )


def save_dataset(path: Path | str, dataset: Dataset, inputs: str = "") -> None:
    """Write one npz file, atomically; `inputs` is the hash of what the dataset was made from."""
    arrays = dataset_arrays(dataset)
    arrays |= {"version": np.array(VERSION), "inputs": np.array(inputs)}
    with replacing(Path(path)) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **arrays)


def load_dataset(path: Path | str) -> tuple[Dataset, str]:
    """The dataset and the hash of its inputs, from what `save_dataset` wrote.

    Raises ValueError of one sentence for a file that is damaged, of another version, or no dataset.
    """
    path = Path(path)
    arrays = _arrays(path)
    if "version" not in arrays:
        raise ValueError(f"{path}: found an npz file of another kind, {_EXPECTED}")
    try:
        version = int(arrays["version"])
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: found a version that is no number, {_EXPECTED}") from error
    if version != VERSION:
        raise ValueError(f"{path}: found version {version}, expected {VERSION}")
    try:
        return dataset_of_arrays(arrays), str(arrays["inputs"])
    except KeyError as error:
        raise ValueError(f"{path}: found no {error.args[0]} in it, {_EXPECTED}") from error
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: found no data set ({error}), {_EXPECTED}") from error


def _arrays(path: Path) -> dict[str, Array]:
    """What an npz file holds; raises ValueError of one sentence where it is none."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except FileNotFoundError as error:
        raise ValueError(f"{path}: found no such file, {_EXPECTED}") from error
    # RuntimeError: a damaged zip may claim to be encrypted or of an unknown compression
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        EOFError,
        RuntimeError,
        BadZipFile,
        zlib.error,
    ) as error:
        raise ValueError(f"{path}: found no npz file or a damaged one, {_EXPECTED}") from error
