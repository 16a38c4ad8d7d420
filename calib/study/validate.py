"""A finished study held against a second test: validation.json, a table and a figure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calib.data.dataset import FieldData
from calib.inference.laws import LawCoordinates
from calib.inference.validation import Prediction, Requirement, Samples, judge
from calib.study.answers import sampled
from calib.study.artifacts import plain, write_json
from calib.study.figure_style import save_png
from calib.study.findings import VALIDATIONS
from calib.study.finished import check_same_run
from calib.study.provenance_facts import space_in
from calib.study.second_data import Rubbers, SecondData, Study, second_data, stated
from calib.study.second_prediction import (
    Predicted,
    corrected,
    mesh_difference,
    predict,
    replicates,
)
from calib.study.second_test import SecondTest
from calib.study.validation_figures import Shown, validation_figure
from fe.progress_bar import Progress, progress_bar

COMPONENTS = ("x", "y", "z")
Echo = Callable[[str], None]


def validate(
    out: Path, test: SecondTest, folder: Path, echo: Echo, *, show_progress: bool = False
) -> tuple[dict[str, Any], list[Path]]:
    """Predict the second test by the study in `out`; returns what was found and the files written.

    `folder` is where the test's data are looked for. Raises ValueError when the study is not
    finished or has no such hypothesis, or the test cannot be read or solved.

    Of the posterior the law's constants and the bulk modulus are used; what else was unknown
    (friction, heights, errors) belongs to the first test and is averaged over by the draws.
    """
    draws, study = posterior_draws(out, test)
    asked_of = sampled(out, study.hypotheses)  # now: without locks a run may end meanwhile
    for index, given in enumerate(test.constants):
        if given.name in study.hypotheses:
            raise ValueError(
                f"{test.name}: constants[{index}].name: found {given.name}, expected another than "
                "that of a hypothesis of the study"
            )
    echo(f"data       {test.data.source}")
    data = second_data(test, folder, study)
    found: dict[str, Any] = {}
    shown = []
    points = {given.name: stated(given, study) for given in test.constants}
    for order, (name, rubbers) in enumerate([*draws.items(), *points.items()]):
        echo(f"predict    {name}: {len(rubbers.bulk)} solves")
        with progress_bar(f"predict {name}", "solve", shown=show_progress) as progress:
            found[name], picture = _against(test, data, name, rubbers, order, progress)
        shown.append(picture)
    facts = _facts(test, data, found) | {"posterior": asked_of}
    facts["of_another_material"] = data.synthetic and not study.synthetic
    target = out / VALIDATIONS / test.name
    write_json(target / "validation.json", facts)
    save_png(validation_figure(data, shown, test.max_error), target / "validation.png")
    return plain(facts), [target / "validation.json", target / "validation.png"]


def posterior_draws(out: Path, test: SecondTest) -> tuple[dict[str, Rubbers], Study]:
    """Hypothesis -> some posterior draws of the material; and what the study says beside."""
    from calib.inference.inference_data import load_inference_data, provenance_of

    path = out / "posterior.nc"
    if not path.is_file():
        raise ValueError(f"{path}: found no such file, expected the posterior of a finished study")
    check_same_run(out)
    stored = load_inference_data(path)
    provenance: Any = provenance_of(stored)
    file = provenance["study_file"]
    posterior = stored["posterior"]
    names = [str(name) for name in posterior["hypothesis"].values]
    study = Study(
        float(file["material"]["bulk_ratio"]),
        float(file["noise"]["sample_correlation"]),
        tuple(names),
        bool(provenance.get("synthetic", True)),  # posteriors of 0.2 do not say
    )
    if test.hypothesis is not None and test.hypothesis not in names:
        known = ", ".join(names)
        raise ValueError(
            f"{test.name}: hypothesis: found {test.hypothesis}, expected one of {known}"
        )
    rng = np.random.default_rng(np.random.SeedSequence(test.seed, spawn_key=(2,)))
    draws = {}
    for name in names if test.hypothesis is None else [test.hypothesis]:
        stated = provenance["hypotheses"][name]
        bulk_ratio = float(stated.get("contact", {}).get("bulk_ratio") or study.bulk_ratio)
        law = space_in(stated).law
        every = _rubbers(path, name, posterior.sel(hypothesis=name), law, bulk_ratio)
        if test.draws > len(every.bulk):
            expected = f"at most the {len(every.bulk)} that the posterior of {name} holds"
            raise ValueError(f"{test.name}: draws: found {test.draws}, expected {expected}")
        chosen = rng.choice(len(every.bulk), test.draws, replace=False)
        draws[name] = Rubbers(law.name, every.constants[chosen], every.bulk[chosen])
    return draws, study


def _rubbers(
    path: Path, name: str, posterior: Any, law: LawCoordinates, bulk_ratio: float
) -> Rubbers:
    """All draws of the material under one hypothesis; `bulk_ratio` where it is not among them.

    Raises ValueError where the file does not hold a constant of the hypothesis' law.
    """
    lacking = [c for c in law.constants if c not in posterior or np.isnan(posterior[c]).any()]
    if lacking:
        raise ValueError(
            f"{path}: hypothesis {name}: found no {', '.join(lacking)}, "
            f"expected the constants of its law {law.name}; run the study again"
        )
    *constants, mu = (posterior[c].values.ravel() for c in law.constants)
    bulk = bulk_ratio * mu
    if "bulk_ratio" in posterior and not np.isnan(posterior["bulk_ratio"]).any():
        bulk = posterior["bulk_ratio"].values.ravel() * mu
    return Rubbers(law.name, np.stack(constants, axis=1), bulk)


def _against(
    test: SecondTest,
    data: SecondData,
    name: str,
    rubbers: Rubbers,
    order: int,
    progress: Progress,
) -> tuple[dict[str, Any], Shown]:
    """Quantity -> how well it is predicted by draws of the material, and what the figure shows."""
    difference = mesh_difference(test, data, rubbers.mean)
    n = len(rubbers.bulk)
    predicted = corrected(predict(test, data, rubbers, lambda done: progress(done, n)), difference)
    rng = np.random.default_rng(np.random.SeedSequence(test.seed, spawn_key=(3, order)))
    again = replicates(test, data, predicted, difference, rng)
    single = None if data.samples is None else Samples(data.samples, again.sample)
    judged = {
        "answer": judge(data.answer, predicted.answer, again.answer, answer_noise(data), single)
    }
    if data.field is not None and predicted.field is not None and again.field is not None:
        for c, component in enumerate(COMPONENTS):
            judged[component] = judge(
                data.field.displacement[..., c],
                predicted.field[..., c],
                again.field[..., c],
                field_noise(data, data.field, c),
            )
    return _facts_of(test, data, judged, predicted, difference), Shown(name, again.answer, judged)


def answer_noise(data: SecondData) -> float:
    """Root mean square of what the test itself may have wrong of the mean answer, N or mm."""
    scatter = np.mean((data.stiffness_sd * data.softened(data.answer)) ** 2) / data.n_samples
    zero = np.mean((data.travel_zero_sd * data.by_travel(data.answer)) ** 2)
    return float(np.sqrt(scatter + zero))


def field_noise(data: SecondData, field: FieldData, component: int) -> float:
    """The same of a component of its field, mm, with the field's noise, scale and patterns."""
    u = field.displacement[..., component]
    patterns = 0.0
    if field.patterns is not None:
        patterns = float(np.mean(np.sum(field.patterns[..., component] ** 2, axis=0)))
    scale = np.mean((field.scale_sd * u) ** 2)
    zero = np.mean((data.travel_zero_sd * data.by_travel(u)) ** 2)
    stiffness = data.stiffness_sd[:, None] * data.softened(u)
    scatter = np.mean(stiffness**2) / data.n_samples
    return float(np.hypot(field.noise_std[component], np.sqrt(scale + zero + scatter + patterns)))


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
        "why_failed": predicted.why_failed,
        "not_measured": [name for name in test.judged if name not in judged],
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
