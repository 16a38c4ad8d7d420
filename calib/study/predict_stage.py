"""Stage `predict`: the data against their posterior predictive, by increment and by region."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from calib.data.dataset import Dataset
from calib.inference.left_out_forces import left_out_p_values
from calib.inference.posterior import Posterior
from calib.inference.prediction import predictive_fields
from calib.inference.predictive_checks import (
    check_field,
    check_forces,
    correlation,
    face_regions,
    rms_error,
)
from calib.study.artifacts import write_json, write_npz
from calib.study.context import Context, stream
from calib.study.data_stage import load_data
from calib.study.posterior_setup import emulator_posterior
from calib.study.predictive_tables import CHECKS, COMPONENTS
from calib.study.sample_stage import load_samples
from calib.study.sections import Hypothesis
from fe.response import Array

N_FIELD = 400
"""posterior draws whose fields are predicted: p-values to 0.025 at the most (one SD)"""


def run(context: Context) -> list[Path]:
    """Write predictive.json and, with a field, predictive_<hypothesis>.npz; returns their paths."""
    data = load_data(context.out).dataset
    found: dict[str, Any] = {}
    paths = []
    for hypothesis in context.study.hypotheses:
        posterior = emulator_posterior(context, hypothesis)
        stored = load_samples(context.out, hypothesis)
        checks: dict[str, Any] = {
            "force": check_forces(data.force_mean, stored.predictive),
            "force_left_out_p": left_out_p_values(posterior, data.travel),
        }
        if data.field is not None:
            rng = stream(context.study, f"predict {hypothesis.name}")
            draws = stored.result.draws
            chosen = draws[rng.choice(len(draws), min(N_FIELD, len(draws)), replace=False)]
            facts, maps = _field(context, data, posterior, chosen, rng)
            checks |= facts
            paths.append(maps_path(context.out, hypothesis))
            write_npz(paths[-1], maps)
        found[hypothesis.name] = checks
    write_json(context.out / CHECKS, {"travel": data.travel, "hypotheses": found})
    return [context.out / CHECKS, *paths]


def maps_path(out: Path, hypothesis: Hypothesis) -> Path:
    """File of a hypothesis' maps over the front face."""
    return out / f"predictive_{hypothesis.name}.npz"


def _field(
    context: Context, data: Dataset, posterior: Posterior, x: Array, rng: np.random.Generator
) -> tuple[dict[str, Any], dict[str, Array]]:
    """Checks of the field as JSON data, and maps (n_point, 3) of correlation and RMS error."""
    field = data.field
    assert field is not None
    geometry = context.study.geometry
    regions = face_regions(field.points, geometry.width, geometry.pin_width, geometry.pin_shift)
    predicted = predictive_fields(posterior.likelihood, x, rng)
    observed, mean = field.displacement, predicted.model.mean(axis=0)
    maps = {
        "points": field.points,
        "correlation": correlation(observed, mean),
        "rmse": rms_error(observed, mean),
    }
    facts = {
        "n_point": {name: int(mask.sum()) for name, mask in regions.items()},
        "field": check_field(observed, predicted.replicate, predicted.model, regions),
        "summary": _summary(observed, maps),
    }
    return facts, maps


def _summary(observed: Array, maps: dict[str, Array]) -> list[dict[str, object]]:
    """Thesis Table 5.5: averages over the face; the error as a share of the largest motion too."""
    rows: list[dict[str, object]] = []
    for c, name in enumerate(COMPONENTS):
        error = float(np.sqrt(np.square(maps["rmse"][:, c]).mean()))
        known = maps["correlation"][:, c]
        rows.append(
            {
                "component": name,
                "mean_correlation": float(np.nanmean(known)) if np.isfinite(known).any() else None,
                "rmse": error,
                "largest": float(np.abs(observed[..., c]).max()),
            }
        )
    return rows
