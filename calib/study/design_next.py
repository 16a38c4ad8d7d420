"""What to measure next, given a finished study: experiments ranked by expected information gain."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from calib.data.dataset import Dataset, FieldData
from calib.inference.coordinates import theta_of
from calib.inference.forward import EmulatorForward
from calib.inference.information_gain import laplace_gain, nested_gain
from calib.inference.likelihood import DISCREPANCY, FIELD_NOISE, FORCE_NOISE, OF_FORCE
from calib.inference.noise import field_scale_sd, travel_zero_sd
from calib.inference.planned import Reduced, reduce_experiment
from calib.study.answers import keep_answer
from calib.study.artifacts import plain, write_json
from calib.study.context import Context, stream
from calib.study.data_stage import load_data
from calib.study.figure_style import save_png
from calib.study.finished import chosen, finished
from calib.study.information_figures import gains_figure
from calib.study.mesh_error_file import load_mesh_error
from calib.study.plans import ASSUMED_NOISE, Errors, Plan, by_emulator, by_runs
from calib.study.posterior_setup import emulator_posterior, noise_of
from calib.study.sample_stage import load_samples
from calib.study.sections import Hypothesis
from calib.study.tables import Table, number
from fe.response import Array

FOLDER = "design_next"
RATIOS_ALONE = (("ln kappa", "r"), ("ln kappa", "r", "s"))
"""unknowns by which runs of other blocks have derivatives"""
N_LAPLACE, N_OUTER, N_INNER = 400, 1500, 3000
ASSUMED_LENGTH, ASSUMED_SHARE, ASSUMED_NUGGET = 0.5, 0.5, 1e-6
Echo = Callable[[str], None]


def design_next(
    out: Path, hypothesis: str | None, echo: Echo, *, with_runs: bool = True
) -> tuple[dict[str, Any], list[Path]]:
    """Weigh experiments for the study in `out`; returns what was found and the files written.

    `hypothesis` may be left out where there is one only. Without FE runs, increments and
    instruments alone are weighed; so they are where the forward model has other unknowns than
    kappa, r and s (kappa and r of a law without C11), since cameras and other blocks have no
    derivatives by these. Sizes of the errors that are unknown are taken at their posterior means,
    in the logarithm.
    Raises ValueError when the study is not finished or has no such hypothesis.
    """
    context = replace(finished(out), echo=echo)
    study = context.study
    under = chosen(study, hypothesis)
    (draws, chain), data = _draws(context, under), load_data(out).dataset
    posterior = emulator_posterior(context, under)
    space = posterior.prior.space
    x, sizes = draws[:, : space.n_forward], np.exp(draws[:, space.n_forward :].mean(axis=0))
    names = ("ln kappa", *space.x_names[1 : space.n_forward])
    known = {unknown.name: float(size) for unknown, size in zip(space.errors, sizes, strict=True)}
    forward = posterior.likelihood.forward
    assert isinstance(forward, EmulatorForward)
    errors = errors_of(context, under, data, known, forward)
    theta = theta_of(x.mean(axis=0))
    points = None if data.field is None else data.field.points
    plans = list(by_emulator(forward, data.travel, points, errors, theta))
    if with_runs and study.geometry.pin_shift != 0.0:
        echo(
            "FE runs    left out: the pin is off the sample's centre, expected geometry.pin_shift 0"
        )
    elif with_runs and names in RATIOS_ALONE:
        plans += by_runs(study, under, errors, theta, echo, out / FOLDER / "runs")
    elif with_runs:
        unknown = ", ".join(names)
        echo(
            f"FE runs    left out: found the unknowns {unknown}, expected ln kappa, r and s at most"
        )
    rows = [weigh(p, x, names, stream(study, f"design {p.name}"), chain) for p in plans]
    rows.sort(key=lambda row: -row["gain"].mean)
    facts: dict[str, Any] = plain(
        {
            "study": study.name,
            "hypothesis": under.name,
            "synthetic": data.synthetic,
            "assumed_camera": data.field is None and any(plan.with_field for plan in plans),
            "left_out": _left_out(errors) if any(p.source != "emulator" for p in plans) else [],
            "now": dict(zip(names, x.std(axis=0), strict=True)),
            "plans": rows,
        }
    )
    paths = [out / FOLDER / name for name in ("design_next.json", "design_next.png")]
    write_json(paths[0], facts)
    save_png(gains_figure(facts), paths[1])
    keep_answer(context, "design-next", [gains_table(facts)], paths[1])
    return facts, paths


def _draws(context: Context, hypothesis: Hypothesis) -> tuple[Array, float]:
    """(n, d) draws of x for all of the weighing, and how many independent ones the chain has."""
    result = load_samples(context.out, hypothesis).result
    draws = result.draws
    rng = stream(context.study, f"design draws {hypothesis.name}")
    n = min(N_OUTER + N_INNER, len(draws))
    found: Array = draws[rng.choice(len(draws), n, replace=False)]
    return found, len(draws) / float(result.autocorrelation_time.max())


def errors_of(
    context: Context,
    hypothesis: Hypothesis,
    data: Dataset,
    sizes: Mapping[str, float],
    forward: EmulatorForward,
) -> Errors:
    """Errors of the study's experiment, of which plans change one at a time.

    `sizes` are those that the study leaves unknown, by name.
    The changes of the ratios and nuisances for which the mesh's error is mistaken are
    taken to be the same for all blocks and cameras. Where the study has no field they are not
    known, and left out, and the noise of a camera is assumed.
    """
    noise = noise_of(context.study)
    noise = replace(
        noise,
        travel_zero_sd=travel_zero_sd(data, noise),
        field_scale_sd=field_scale_sd(data, noise),
    )
    mesh = load_mesh_error(context.out, hypothesis)
    load_cell = min(noise.load_cell_sd, 0.99 * _least_sd(data))
    own = np.sqrt(data.force_sd**2 - load_cell**2) / data.force_mean
    between = _between(data, load_cell)
    by_force, by_field = sizes.get(FORCE_NOISE, 1.0), sizes.get(FIELD_NOISE, 1.0)
    field: FieldData | None = data.field
    return Errors(
        own_share=by_force * own,
        noise=replace(
            noise,
            load_cell_sd=by_force * load_cell,
            discrepancy=sizes.get(DISCREPANCY, noise.discrepancy),
            discrepancy_of_force=sizes.get(OF_FORCE, noise.discrepancy_of_force),
        ),
        n_samples=data.n_samples,
        discretisation=mesh.force,
        floor=mesh.field_floor,
        mistaken=mesh.mistaken(data, noise, forward),
        noise_std=by_field * (np.array(ASSUMED_NOISE) if field is None else field.noise_std),
        length=ASSUMED_LENGTH if field is None else field.correlation_length,
        reference_share=ASSUMED_SHARE if field is None else field.reference_share,
        nugget=ASSUMED_NUGGET if field is None else field.nugget,
        smoothing=0.0 if field is None else field.smoothing,
        between=None if between is None else by_force**2 * between,
        directions=None if field is None else field.patterns,
    )


def _left_out(errors: Errors) -> list[str]:
    """What is known at the study's own points alone, in words."""
    lacking = []
    if errors.floor.profile is not None:
        lacking.append("where on the face the mesh errs")
    if errors.directions is not None:
        lacking.append("the directions in which the fields of the samples differ")
    return lacking


def _between(data: Dataset, load_cell_sd: float) -> Array | None:
    """(n_step, n_step) measured covariance of samples over the forces, load cell left out."""
    if data.force_covariance is None:
        return None
    own = data.force_covariance - load_cell_sd**2 * np.eye(data.travel.size)
    relative: Array = own / np.outer(data.force_mean, data.force_mean)
    return relative


def _least_sd(data: Dataset) -> float:
    """N, of any mix of the increments: a load cell that is noisier contradicts the samples."""
    if data.force_covariance is None:
        return float(data.force_sd.min())
    return float(np.sqrt(np.linalg.eigvalsh(data.force_covariance).min()))


def weigh(
    plan: Plan, x: Array, names: tuple[str, ...], rng: np.random.Generator, chain: float
) -> dict[str, Any]:
    """Expected information gain of one plan, closed form and nested Monte Carlo, as JSON data.

    The draws x (n, d) are of a chain that is worth `chain` independent ones.
    """
    steps = np.array(plan.steps)
    planned = reduce_experiment(plan.likelihood, x, steps, with_field=plan.with_field)
    prior = np.cov(x, rowvar=False)
    gain = laplace_gain(planned.jacobian[:N_LAPLACE], planned.covariance, prior, len(x), chain)
    n = min(N_OUTER, len(x) // 3)
    nested = nested_gain(planned.mean[:n], planned.mean[n:], planned.covariance, rng, chain)
    return {
        "name": plan.name,
        "group": plan.group,
        "source": plan.source,
        "gain": gain,
        "nested": nested,
        "agree": nested.agrees_with(gain),
        "sd_after": dict(zip(names, _sd_after(planned, prior), strict=True)),
    }


def _sd_after(planned: Reduced, prior: Array) -> Array:
    """(d,) SDs of the linear problem at the mean derivatives."""
    slope = planned.jacobian.mean(axis=0)
    information = slope.T @ np.linalg.solve(planned.covariance, slope)
    after: Array = np.sqrt(np.diag(np.linalg.inv(np.linalg.inv(prior) + information)))
    return after


def gains_table(facts: dict[str, Any]) -> Table:
    """Experiments in the order of their gain; `facts` are design_next.json."""
    rows = []
    for row in facts["plans"]:
        lower, upper = row["nested"]["lower"], row["nested"]["upper"]
        error = max(lower["error"], upper["error"])
        rows.append(
            (
                row["name"],
                row["group"],
                f"{row['gain']['mean']:.3f} ± {row['gain']['error']:.3f}",
                f"{lower['mean']:.2f} to {upper['mean']:.2f} ± {error:.2f}",
                "yes" if row["agree"] else "NO",
                *(number(row["sd_after"][name] / facts["now"][name], 3) for name in facts["now"]),
                row["source"],
            )
        )
    kind = "SYNTHETIC data" if facts["synthetic"] else "measured data"
    camera = " The study has no camera: noise of one is assumed." if facts["assumed_camera"] else ""
    if facts["left_out"]:
        camera += (
            f" Plans by an FE run lack {' and '.join(facts['left_out'])}: compare them with the "
            "front camera by one FE run."
        )
    return Table(
        f"What to measure next: study {facts['study']} ({kind}), hypothesis {facts['hypothesis']}",
        (
            "experiment",
            "changes",
            "gain [nats]",
            "nested MC [nats]",
            "agree",
            *(f"SD {name}, after/now" for name in facts["now"]),
            "by",
        ),
        tuple(rows),
        "Expected information gain over the present posterior, if made once and with errors of its "
        "own, those of the mesh and a discrepancy of the model among them; a repeat cannot take "
        "away an error that it shares with the first, so that of the same block gains are upper "
        "bounds. gain: closed form of a linear experiment, mean over posterior draws with its "
        "Monte Carlo error, in part shared by all plans, which are weighed by the same draws. "
        "nested MC: lower and upper bound without linearity, with the larger error; agree: closed "
        "form within them, by three errors. Where it says NO, go by the bounds: the closed form "
        "takes the posterior as normal, and of all posteriors with its covariance a normal one "
        "gains most, so it is too large where a posterior fills its prior. What is not linear can "
        "move it either way." + camera,
    )
