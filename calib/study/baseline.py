"""`calib baseline`: the thesis' own calibration on a field of a study, beside its posterior."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.data import PUBLISHED_CONSTANTS, FieldData
from calib.data.thesis import optimization_runs
from calib.inference.baseline import Baseline, RatioBox, is_known, thesis_baseline
from calib.inference.coordinates import CONSTANTS, constants_of, theta_of, theta_of_constants
from calib.inference.field_noise import field_covariance
from calib.inference.forward import EmulatorForward, ForwardModel, GivenInputs
from calib.study.answers import keep_answer
from calib.study.artifacts import write_json
from calib.study.baseline_figure import baseline_figure
from calib.study.context import Context, stream
from calib.study.data_stage import load_data
from calib.study.figure_style import save_png
from calib.study.finished import check_constants, chosen, finished
from calib.study.mesh_error_file import load_mesh_error
from calib.study.sample_stage import load_samples, samples_path
from calib.study.sections import Hypothesis
from calib.study.tables import Table, number
from calib.study.train_stage import load_emulator
from calib.study.unknowns import inputs_of
from fe.response import Array
from surrogate import ScaledEmulator

FILE = "baseline.json"
FIGURE = "baseline.png"
NOISE = (0.01, 0.01, 0.02)
"""SD of x, y, z of a synthetic field made here, mm; as of the embedded study `virtual`"""
LENGTH = 0.5
"""mm, of its correlation"""
REFERENCE_SHARE = 0.5
VARIANTS = (
    ("feasible-directions", False),
    ("feasible-directions", True),
    ("slsqp", True),
    ("trust-constr", True),
)
"""method and whether gradients are exact; the first is the thesis'"""


@dataclass(frozen=True)
class BaselineStudy:
    """The thesis' method on one field."""

    hypothesis: str
    synthetic: bool
    truth: Array | None
    """(3,) C10, C01, C11 behind a synthetic field, MPa; None where they are not known"""
    travel: Array
    """(n_step,) mm"""
    runs: tuple[Baseline, ...]
    error_at_truth: float | None
    """mean field error at the truth, mm: what the noise alone gives; None for a truth that is not
    known or lies outside the emulator's box"""


def baseline(
    out: Path, hypothesis: str | None = None, truth: tuple[float, float, float] | None = None
) -> tuple[list[str], list[Path]]:
    """Run it on a finished study; returns the lines to print and the files.

    On the study's own field where it has one, else on a synthetic one: the emulator's field at
    `truth` (C10, C01, C11 in MPa; default those of thesis Table 5.4) with noise.
    The thesis knows the constants alone: further unknowns of the forward model (friction, height,
    ...) are at their posterior means. `hypothesis` may be left out where there is one only.
    The emulator is asked in the box of ratios in which it was trained.
    Raises ValueError where the folder holds no finished study, for a truth beside a field or
    outside that box, and for a hypothesis that the study does not have or of another law than
    mooney-rivlin-3.
    """
    context = finished(out)
    under = chosen(context.study, hypothesis)
    check_constants(context.study, under)
    found = _run(context, under, truth)
    write_json(out / FILE, facts(found))
    draws = _draws(context, under)
    save_png(baseline_figure(found, draws), out / "figures" / FIGURE)
    tables = (starts_table(found), methods_table(found))
    keep_answer(context, "baseline", tables, out / "figures" / FIGURE)
    lines = []
    for table in tables:
        lines += [table.text(), ""]
    return lines, [out / FILE, out / "figures" / FIGURE]


def _run(
    context: Context, hypothesis: Hypothesis, truth: tuple[float, float, float] | None
) -> BaselineStudy:
    data = load_data(context.out)
    forward, box = _forward(context, hypothesis)
    field = data.dataset.field
    constants: Array | None = None
    if field is not None:
        if truth is not None:
            raise ValueError("--truth: found constants, expected none: the study has a field")
        observed = field.displacement
        if data.truth is not None:
            constants = np.array([data.truth[name] for name in CONSTANTS[:3]])
    else:
        chosen_truth = truth or tuple(PUBLISHED_CONSTANTS[name] for name in CONSTANTS[:3])
        constants = np.array(chosen_truth)
        _check_known(constants, box)
        observed = synthetic_field(context, hypothesis, forward, constants)
    runs = tuple(
        thesis_baseline(forward, observed, exact=exact, method=method, ratio_box=box)
        for method, exact in VARIANTS
    )
    at_truth = None
    theta = None if constants is None else theta_of_constants(*constants)
    if theta is not None and is_known(theta, box):
        weights, basis = forward.predict(theta[None]).weights, forward.field_basis
        assert weights is not None and basis is not None
        off = basis.fields(weights)[0] - observed
        at_truth = float(np.linalg.norm(off, axis=-1).mean())
    synthetic = data.dataset.synthetic or field is None
    travel = data.dataset.travel
    return BaselineStudy(hypothesis.name, synthetic, constants, travel, runs, at_truth)


def _check_known(constants: Array, box: RatioBox) -> None:
    """Raise ValueError for a synthetic truth (3,) that the emulator does not know."""
    if not (np.isfinite(constants).all() and constants[0] + constants[1] > 0):
        found = " ".join(f"{value:g}" for value in constants)
        raise ValueError(
            f"--truth: expected C10, C01 and C11 in MPa with C10 + C01 above 0, found {found}"
        )
    theta = theta_of_constants(*constants)
    if not is_known(theta, box):
        (r_low, r_high), (s_low, s_high) = box
        raise ValueError(
            f"--truth: expected r from {r_low:g} to {r_high:g} and s from {s_low:g} to {s_high:g}, "
            f"where the emulator was trained, found r = {theta[1]:.3g}, s = {theta[2]:.3g}"
        )


def _forward(context: Context, hypothesis: Hypothesis) -> tuple[ForwardModel, RatioBox]:
    """The emulator over (kappa, r, s) and where it knows (r, s); others at their posterior mean."""
    forward = EmulatorForward(
        ScaledEmulator(load_emulator(context.out, hypothesis)),
        with_field=True,
        correction=load_mesh_error(context.out, hypothesis).correction,
    )
    (r_low, r_high), (s_low, s_high) = forward.bounds[:2].tolist()
    box: RatioBox = ((r_low, r_high), (s_low, s_high))
    n = len(inputs_of(context.study, hypothesis))
    if not n:
        return forward, box
    draws = load_samples(context.out, hypothesis).result.draws
    return GivenInputs(forward, draws.mean(axis=0)[3 : 3 + n]), box


def synthetic_field(
    context: Context, hypothesis: Hypothesis, forward: ForwardModel, constants: Array
) -> Array:
    """(n_step, n_point, 3) field of the emulator at constants (3,) MPa, with correlated noise."""
    weights = forward.predict(theta_of_constants(*constants)[None]).weights
    basis = forward.field_basis
    assert weights is not None and basis is not None
    clean: Array = basis.fields(weights)[0]
    points = context.sampling_model(hypothesis).points()
    data = FieldData(points, clean, np.array(NOISE), LENGTH, REFERENCE_SHARE)
    noise: Array = field_covariance(data).sample(stream(context.study, "baseline field"), 1)[0]
    noisy: Array = clean + noise
    return noisy


def _draws(context: Context, hypothesis: Hypothesis) -> Array | None:
    """(n, 4) constants of the study's posterior, MPa; None where it was not sampled."""
    if not samples_path(context.out, hypothesis.name).is_file():
        return None
    draws: Array = constants_of(theta_of(load_samples(context.out, hypothesis).result.draws))
    return draws


def facts(found: BaselineStudy) -> dict[str, Any]:
    """The results as JSON data."""
    return {
        "hypothesis": found.hypothesis,
        "synthetic": found.synthetic,
        "truth": found.truth,
        "error_at_truth_mm": found.error_at_truth,
        "units": {"constants": "MPa", "error": "mm", "force": "N"},
        "runs": [
            {
                "method": run.method,
                "exact_gradients": run.exact,
                "start": run.start,
                "result": run.result,
                "error": run.error,
                "force": run.force,
                "status": [minimum.message for minimum in run.minima],
                "n_objective": [minimum.n_objective for minimum in run.minima],
            }
            for run in found.runs
        ],
    }


def starts_table(found: BaselineStudy) -> Table:
    """Table 5.3 again: nine starts, where they end, beside what the thesis printed."""
    run, printed = found.runs[0], optimization_runs()
    rows = []
    for i, minimum in enumerate(run.minima):
        rows.append(
            (
                str(i + 1),
                *(number(value, 3) for value in run.result[i]),
                f"{run.error[i]:.4f}" if np.isfinite(run.error[i]) else "-",
                number(run.force[i, -1], 3),
                minimum.status.name.lower(),
                *(number(value, 3) for value in printed.result[i]),
                f"{printed.rmse[i]:.4f}",
            )
        )
    kind = "SYNTHETIC field" if found.synthetic else "measured field"
    note = "Left of the bar: this program. Right: thesis Table 5.3, real data, as printed."
    if found.truth is not None:
        at = "" if found.error_at_truth is None else f"; error there {found.error_at_truth:.4f} mm"
        note += " Truth: " + ", ".join(number(v, 3) for v in found.truth) + f" MPa{at}."
    return Table(
        f"Nine starts of the thesis' method on a {kind} ({found.hypothesis}), central differences",
        (
            "start",
            "C10 [MPa]",
            "C01",
            "C11",
            "error [mm]",
            f"force at {found.travel[-1]:g} mm [N]",
            "end",
            "| thesis C10",
            "C01",
            "C11",
            "RMSE [mm]",
        ),
        tuple(rows),
        note,
    )


def methods_table(found: BaselineStudy) -> Table:
    """The spread of the nine answers by method."""
    rows = []
    for run in found.runs:
        ended = np.isfinite(run.error)
        rows.append(
            (
                run.method,
                "exact" if run.exact else "differences 0.1",
                _spread(run.error[ended], "{:.4f}".format),
                _spread(run.kappa[ended], lambda value: number(value, 3)),
                _spread(run.force[ended, -1], lambda value: number(value, 3)),
                f"{np.mean([m.n_objective for m in run.minima]):.0f}",
            )
        )
    return Table(
        "Spread of the answers from nine starts",
        (
            "method",
            "gradients",
            "error [mm]",
            "C10 + C01 [MPa]",
            f"force at {found.travel[-1]:g} mm [N]",
            "evaluations a start",
        ),
        tuple(rows),
        "The error of the field is the same along every ray through the origin: it cannot see "
        "C10 + C01, and each answer keeps the stiffness that its start and steps gave it. A force "
        "would decide; none is in the thesis' objective.",
    )


def _spread(values: Array, told: Callable[[float], str]) -> str:
    """Smallest and largest of values (n,), a dash where no start was one that the model knows."""
    return f"{told(values.min())} to {told(values.max())}" if values.size else "-"
