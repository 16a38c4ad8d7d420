"""What the analysis of an experiment leaves: dataset.npz, qc.json and the tables."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from calib.data.dataset import Dataset
from calib.data.dataset_file import save_dataset
from calib.data.qc.doubts import doubts
from calib.data.qc.mean_noise import FieldNoise
from calib.data.qc.noise_floor import NoiseFloor
from calib.data.qc.pipeline import QcResult
from calib.data.qc.quality import eligibility
from calib.data.qc.statistics import (
    all_tables,
    requirements,
)
from calib.data.qc.table import QcTable, table_csv
from calib.data.requirements import requirements_text
from fe.atomic_file import write_text

DATASET = "dataset.npz"
REPORT = "qc.json"
TABLES = "tables"
FIGURES = "figures"
FIGURE_NAMES = ("placement", "machine", "cycles", "forces", "boxes", "field", "noise")
"""of `calib.data.qc.figures.all_figures`"""


def key_of(inputs: str, code: str) -> str:
    """What a kept data set was made from: hashes of the files with the rules, and of the code."""
    return f"{inputs} {code}"


def write_results(result: QcResult, out: Path, version: str, code: str) -> list[Path]:
    """Write everything but the figures into the folder `out`; returns the paths.

    `version` of softcal and the hash of its `code` go into qc.json. What older files have left and
    these do not give is removed: dataset.npz without a data set, tables without a row, and all
    figures, which are drawn anew or not at all.
    """
    (out / TABLES).mkdir(parents=True, exist_ok=True)
    for name in FIGURE_NAMES:
        (out / FIGURES / f"{name}.png").unlink(missing_ok=True)
    paths = []
    for table in all_tables(result):
        path = out / TABLES / f"{table.name}.csv"
        if table.rows:
            paths.append(_text(path, table_csv(table)))
        else:
            path.unlink(missing_ok=True)
    text = requirements_text(requirements(result))
    paths.append(_text(out / TABLES / "requirements.txt", text + "\n"))
    report = json.dumps(_plain(qc_report(result, version, code)), indent=1, allow_nan=False)
    paths.append(_text(out / REPORT, report + "\n"))
    if result.dataset is None:
        (out / DATASET).unlink(missing_ok=True)
    else:
        save_dataset(out / DATASET, result.dataset, key_of(result.inputs, code))
        paths.append(out / DATASET)
    return paths


def qc_report(result: QcResult, version: str, code: str) -> dict[str, object]:
    """What was kept and rejected, with reason, value and threshold, and what was found."""
    experiment = result.experiment
    samples = []
    for sample, rules, kept in zip(result.samples, result.rules, result.kept, strict=True):
        own = [r for r in result.rejections if r.sample == sample.name]
        samples.append(
            {
                "name": sample.name,
                "kept": bool(kept),
                "rejections": [{**r._asdict(), "sentence": r.text()} for r in own],
                "figures": {rule.key: rule.value for rule in rules},
            }
        )
    return {
        "version": version,
        "code": code,
        "name": result.name,
        "synthetic": experiment.synthetic,
        "inputs": result.inputs,
        "units": {"length": "mm", "force": "N", "angle": "degree", "time": "s"},
        "eligible": dict(eligibility(len(result.samples), result.rejections)),
        "thresholds": {
            name: getattr(experiment.quality, name)
            for name in experiment.quality.__dataclass_fields__
        },
        "thresholds_of_the_study": result.study_rules,
        "samples": samples,
        "warnings": doubts(result),
        "noise": None if result.noise is None else _noise(result.noise),
        "dataset": None if result.dataset is None else _dataset(result.dataset),
        "tables": {
            t.name: _rows(t)
            for t in all_tables(result)
            if t.rows and t.name in ("placement", "mapping")
        },
    }


def _noise(noise: FieldNoise) -> dict[str, object]:
    """Noise of the mean field by its sources, mm."""
    return {
        "mean_std": noise.mean_std,
        "at_points": _floor(noise.at_points),
        "static": _floor(noise.static),
        "repeats": _floor(noise.repeats),
        "stated": noise.stated,
        "stated_correlation_length": noise.stated_length,
    }


def _dataset(dataset: Dataset) -> dict[str, object] | None:
    """What the data set holds, mm and N; None without a field."""
    field = dataset.field
    if field is None:
        return None
    return {
        "travel": dataset.travel,
        "force_mean": dataset.force_mean,
        "force_sd": dataset.force_sd,
        "force_covariance": dataset.force_covariance,
        "n_samples": dataset.n_samples,
        "travel_zero_sd": dataset.travel_zero_sd,
        "n_points": len(field.points),
        "noise_std": field.noise_std,
        "correlation_length": field.correlation_length,
        "smoothing": field.smoothing,
        "nugget": field.nugget,
        "scale_sd": field.scale_sd,
        "n_patterns": 0 if field.patterns is None else len(field.patterns),
    }


def _floor(floor: NoiseFloor | None) -> dict[str, object] | None:
    return None if floor is None else floor._asdict()


def _rows(table: QcTable) -> list[dict[str, object]]:
    return [dict(zip(table.columns, row, strict=True)) for row in table.rows]


def _text(path: Path, text: str) -> Path:
    write_text(path, text)
    return path


def _plain(value: object) -> Any:
    """What JSON can hold; NaN and infinities become null."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.integer, np.bool_)):
        return value.item()
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value
