"""The data set that the posterior is conditioned on, kept as a file of the study."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.data import PUBLISHED_CONSTANTS, Dataset
from calib.data.dataset_file import dataset_arrays, dataset_of_arrays
from calib.data.odd_samples import odd_samples
from calib.inference.field_noise import NUGGET
from calib.study.artifacts import read_json, read_npz, write_json, write_npz
from calib.study.config import Study, StudyError
from calib.study.data_checks import SAME_TRAVEL
from calib.study.data_source import measured_dataset
from calib.study.sections import THESIS_TABLE
from fe.response import Array

DATA = "data"
"""data.npz holds the arrays, data.json the rest"""
MOST_SHOWN = 20
"""travels that a refusal names"""


@dataclass(frozen=True)
class StudyData:
    """Measured or synthetic data and what is known beside them."""

    dataset: Dataset
    published: dict[str, float] | None
    """constants published for the same data (C10, C01, C11, mu), MPa"""
    truth: dict[str, float] | None
    """constants behind synthetic data (C10, C01, C11, mu), MPa"""
    truth_hypothesis: str | None
    """hypothesis behind synthetic data"""
    left_out: tuple[str, ...] = ()
    """samples that quality control rejects, one sentence a rule"""
    warnings: tuple[str, ...] = ()
    """what it warns of, and samples of another stiffness of those that come without it"""


def measured(study: Study) -> StudyData:
    """The data set that the study names, at its increments.

    Raises StudyError when a file cannot be read or an increment was not measured.
    """
    try:
        dataset = measured_dataset(study.data)
    except (OSError, ValueError) as error:
        raise StudyError(str(error)) from error
    is_thesis = study.data.source == THESIS_TABLE
    published = with_mu(PUBLISHED_CONSTANTS) if is_thesis else None
    used = at_increments(dataset, study.increments)
    return StudyData(used, published, None, None, *_judged(study, dataset))


def _judged(study: Study, dataset: Dataset) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What quality control says of samples that it rejects, and what it warns of."""
    folder = study.data.folder
    if folder is None:
        return (), tuple(odd_samples(dataset.samples))
    # readers, only where they are needed
    from calib.study.experiment_data import rejections_kept, warnings_kept

    return rejections_kept(folder), warnings_kept(folder)


def at_increments(dataset: Dataset, increments: tuple[float, ...]) -> Dataset:
    """The part of a data set measured at the given travels (mm).

    Raises StudyError naming the travel that was not measured.
    """
    chosen = []
    for travel in increments:
        nearest = int(np.argmin(np.abs(dataset.travel - travel)))
        if abs(dataset.travel[nearest] - travel) > SAME_TRAVEL:
            near = np.sort(dataset.travel[np.argsort(np.abs(dataset.travel - travel))[:MOST_SHOWN]])
            known = ", ".join(f"{value:g}" for value in near)
            known += "" if len(near) == len(dataset.travel) else ", ... (those nearest)"
            raise StudyError(
                f"increments: found {travel:g} mm, expected a travel that was measured: {known} mm"
            )
        chosen.append(nearest)
    return dataset.at_steps(chosen)


def with_mu(constants: dict[str, float]) -> dict[str, float]:
    """Constants C10, C01, C11 and the small-strain shear modulus mu = 2 (C10 + C01), MPa."""
    named = {name: float(constants[name]) for name in ("C10", "C01", "C11")}
    return {**named, "mu": 2.0 * (named["C10"] + named["C01"])}


def save_data(out: Path, data: StudyData) -> list[Path]:
    """Write data.npz and data.json; returns their paths."""
    dataset = data.dataset
    facts: dict[str, object] = {
        "units": {"travel": "mm", "force": "N", "displacement": "mm", "constants": "MPa"},
        "name": dataset.name,
        "synthetic": dataset.synthetic,
        "n_samples": dataset.n_samples,
        "travel": dataset.travel,
        "force_mean": dataset.force_mean,
        "force_sd": dataset.force_sd,
        "published": data.published,
        "truth": data.truth,
        "truth_hypothesis": data.truth_hypothesis,
        "left_out": data.left_out,
        "warnings": data.warnings,
    }
    if dataset.field is not None:
        facts["correlation_length"] = dataset.field.correlation_length
        facts["smoothing"] = dataset.field.smoothing
        facts["reference_share"] = dataset.field.reference_share
        facts["n_point"] = len(dataset.field.points)
    paths = [out / f"{DATA}.npz", out / f"{DATA}.json"]
    write_npz(paths[0], dataset_arrays(dataset))
    write_json(paths[1], facts)
    return paths


def load_data(out: Path) -> StudyData:
    """Read what `save_data` wrote; raises ValueError naming a damaged file."""
    facts = read_json(out / f"{DATA}.json", ("published", "truth", "truth_hypothesis"))
    arrays: dict[str, Array] = read_npz(out / f"{DATA}.npz", ("travel", "force_mean", "force_sd"))
    facts_of_old = ("name", "synthetic", "n_samples", "correlation_length", "reference_share")
    known = {name: np.asarray(facts[name]) for name in facts_of_old if name in facts}
    known["nugget"] = np.asarray(NUGGET)
    dataset = dataset_of_arrays({**known, **arrays})
    return StudyData(
        dataset,
        facts["published"],
        facts["truth"],
        facts["truth_hypothesis"],
        tuple(facts.get("left_out", ())),
        tuple(facts.get("warnings", ())),
    )
