"""A finished study held against a second test: validation.json, a table and a figure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calib.inference.validation import Prediction, Requirement, Samples, judge
from calib.study.artifacts import plain, write_json
from calib.study.figure_style import save_png
from calib.study.second_data import SecondData, constants_of, second_data
from calib.study.second_prediction import (
    Predicted,
    corrected,
    mesh_difference,
    predict,
    replicates,
)
from calib.study.second_test import SecondTest
from calib.study.validation_figures import Shown, validation_figure
from fe.response import Array

FOLDER = "validation"
COMPONENTS = ("x", "y", "z")
CONSTANTS = ("C10", "C01", "C11")
Echo = Callable[[str], None]


def validate(
    out: Path, test: SecondTest, folder: Path, echo: Echo
) -> tuple[dict[str, Any], list[Path]]:
    """Predict the second test by the study in `out`; returns what was found and the files written.

    `folder` is where the test's data are looked for. Raises ValueError when the study is not
    finished, has no such hypothesis or one of another law, or the test cannot be read or solved.
    """
    draws, bulk_ratio = _posterior(out, test)
    echo(f"data       {test.data.source}")
    data = second_data(test, folder, bulk_ratio)
    found: dict[str, Any] = {}
    shown = []
    for order, (name, constants) in enumerate(draws.items()):
        found[name], picture = _against(test, data, name, constants, bulk_ratio, order, echo)
        shown.append(picture)
    for order, given in enumerate(test.constants, start=len(draws)):
        point = constants_of(given)[None]
        found[given.name], picture = _against(
            test, data, given.name, point, bulk_ratio, order, echo
        )
        shown.append(picture)
    facts = _facts(test, data, found)
    target = out / FOLDER / test.name
    write_json(target / "validation.json", facts)
    save_png(validation_figure(data, shown), target / "validation.png")
    return plain(facts), [target / "validation.json", target / "validation.png"]


def _posterior(out: Path, test: SecondTest) -> tuple[dict[str, Array], float]:
    """Hypothesis -> (draws, 3) constants of some posterior draws, MPa; and the bulk ratio."""
    from calib.inference.inference_data import load_inference_data, provenance_of

    path = out / "posterior.nc"
    if not path.is_file():
        raise ValueError(f"{path}: found no such file, expected the posterior of a finished study")
    stored = load_inference_data(path)
    study: Any = provenance_of(stored)["study_file"]
    posterior = stored["posterior"]
    names = [str(name) for name in posterior["hypothesis"].values]
    if test.hypothesis is not None and test.hypothesis not in names:
        known = ", ".join(names)
        raise ValueError(f"hypothesis: found {test.hypothesis}, expected one of {known}")
    rng = np.random.default_rng(np.random.SeedSequence(test.seed, spawn_key=(2,)))
    draws = {}
    for name in names if test.hypothesis is None else [test.hypothesis]:
        one = posterior.sel(hypothesis=name)
        _check_constants(path, name, one)
        values = np.stack([one[c].values.ravel() for c in CONSTANTS], axis=1)
        draws[name] = values[rng.choice(len(values), test.draws, replace=False)]
    return draws, float(study["material"]["bulk_ratio"])


def _check_constants(path: Path, name: str, posterior: Any) -> None:
    """Refuse a posterior of a law or a bulk ratio that the second test is not solved with."""
    lacking = [c for c in CONSTANTS if c not in posterior or np.isnan(posterior[c]).any()]
    if lacking:
        raise ValueError(
            f"{path}: hypothesis {name}: found no {', '.join(lacking)}, "
            "expected a posterior of the law mooney-rivlin-3"
        )
    if "bulk_ratio" in posterior and not np.isnan(posterior["bulk_ratio"]).any():
        raise ValueError(
            f"{path}: hypothesis {name}: found bulk_ratio among the unknowns, "
            "expected one that the study gives"
        )


def _against(
    test: SecondTest,
    data: SecondData,
    name: str,
    constants: Array,
    bulk_ratio: float,
    order: int,
    echo: Echo,
) -> tuple[dict[str, Any], Shown]:
    """Quantity -> how well it is predicted by draws of the constants, and what the figure shows."""
    echo(f"predict    {name}: {len(constants)} solves")
    difference = mesh_difference(test, data, constants.mean(axis=0), bulk_ratio)
    predicted = corrected(predict(test, data, constants, bulk_ratio), difference)
    rng = np.random.default_rng(np.random.SeedSequence(test.seed, spawn_key=(3, order)))
    again = replicates(test, data, predicted, difference, rng)
    answer_noise = float(
        np.sqrt(np.mean((data.stiffness_sd * data.softened(data.answer)) ** 2) / data.n_samples)
    )
    single = None if data.samples is None else Samples(data.samples, again.sample)
    judged = {
        "answer": judge(
            data.answer, predicted.answer.mean(axis=0), again.answer, answer_noise, single
        )
    }
    if data.field is not None and predicted.field is not None and again.field is not None:
        mean = predicted.field.mean(axis=0)
        for c, component in enumerate(COMPONENTS):
            judged[component] = judge(
                data.field.displacement[..., c],
                mean[..., c],
                again.field[..., c],
                float(data.field.noise_std[c]),
            )
    return _facts_of(test, data, judged, predicted, difference), Shown(name, again.answer, judged)


def _facts_of(
    test: SecondTest,
    data: SecondData,
    judged: dict[str, Prediction],
    predicted: Predicted,
    difference: Predicted,
) -> dict[str, Any]:
    requirement = Requirement(test.max_error, test.min_r2)
    asked = [name for name in ("answer", *test.judged) if name in judged]
    return {
        "quantities": {
            name: asdict(one) | {"passed": one.passes(requirement)} for name, one in judged.items()
        },
        "judged": asked,
        "passed": all(judged[name].passes(requirement) for name in asked),
        "n_draws": len(predicted.answer),
        "n_failed": predicted.n_failed,
        "mesh_difference": difference.answer[0] / data.answer,
    }


def _facts(test: SecondTest, data: SecondData, found: dict[str, Any]) -> dict[str, Any]:
    return {
        "test": test.name,
        "synthetic": data.synthetic,
        "data": data.name,
        "control": data.control,
        "quantity": data.quantity,
        "levels": data.levels,
        "answer": data.answer,
        "n_samples": data.n_samples,
        "requirement": Requirement(test.max_error, test.min_r2),
        "predictions": found,
    }
