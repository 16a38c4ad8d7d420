"""Stage `map`: the maximum of each posterior by emulator, then by the FE model itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.inference.coordinates import theta_of
from calib.inference.fisher import laplace_covariance
from calib.inference.forward import DirectForward
from calib.inference.map_estimate import MapPoint, MapResult, MapStatus, emulator_map, refine_map
from calib.inference.mesh_correction import MeshCorrection
from calib.inference.posterior import Posterior
from calib.study import verification
from calib.study.artifacts import read_json, write_json
from calib.study.context import Context, stream
from calib.study.local_design import REFINEMENT, kept_box
from calib.study.maxima_table import confirmation, is_verified
from calib.study.mesh_error_file import load_mesh_error
from calib.study.posterior_setup import emulator_posterior
from calib.study.refine_outlook import refine_folder
from calib.study.refine_stage import load_refinement
from calib.study.sample_stage import StoredSamples, load_samples
from calib.study.sections import Hypothesis
from calib.study.simulate_stage import campaign_folder, load_design, manifest_files
from calib.study.simulations import StoredSimulate
from calib.study.unknowns import parameters_of
from calib.study.verification import MAP, added, map_folder
from fe.progress_bar import progress_bar
from fe.response import Array


@dataclass(frozen=True)
class MapTask:
    """The search for one hypothesis, to be run in a worker process."""

    posterior: Posterior
    simulate: StoredSimulate
    with_field: bool
    correction: MeshCorrection
    sd: Array
    """(n,) posterior SD of x"""
    start: MapPoint
    """the emulator's maximum"""


def search(task: MapTask) -> MapResult:
    """Refine the emulator's maximum with the FE model; every solve is kept on disk."""
    direct = DirectForward(task.simulate, with_field=task.with_field, correction=task.correction)
    return refine_map(task.posterior, direct, task.start, task.sd)


def run(context: Context) -> list[Path]:
    """Search for all hypotheses at once, each in its own process; returns map.json and FE runs."""
    hypotheses = context.study.hypotheses
    samples = [load_samples(context.out, hypothesis) for hypothesis in hypotheses]
    out = context.out.absolute()
    tasks = []
    for hypothesis, stored in zip(hypotheses, samples, strict=True):
        posterior = emulator_posterior(context, hypothesis)
        rng = stream(context.study, f"map {hypothesis.name}")
        simulate = StoredSimulate(
            context.sampling_model(hypothesis),
            # A worker elsewhere on the same file system may have another current folder.
            map_folder(out, hypothesis.name),
            (campaign_folder(out, hypothesis), refine_folder(out, hypothesis)),
            parameters_of(context.study, hypothesis),
        )
        start = emulator_map(posterior, stored.sd, rng)
        with_field = posterior.likelihood.field is not None
        correction = load_mesh_error(context.out, hypothesis).correction
        tasks.append(MapTask(posterior, simulate, with_field, correction, stored.sd, start))
    found: dict[int, MapResult] = {}
    with progress_bar("maximum by FE", "hypothesis", shown=context.show_progress) as progress:
        progress(0, len(tasks))
        for index, result in context.map_fn(search, tasks):
            found[index] = result
            progress(len(found), len(tasks))
    described = {
        hypothesis.name: describe(found[index], samples[index])
        | {"laplace": laplace(tasks[index].posterior, found[index], samples[index])}
        | {"fe_is_training_run": is_training_run(context, hypothesis, found[index])}
        for index, hypothesis in enumerate(hypotheses)
    }
    for name, facts in described.items():
        context.echo(f"  {name}: {facts['message']}")
        if not is_verified(facts):
            context.echo(f" {confirmation(name, facts)}")
    write_json(context.out / MAP, described)
    folders = [map_folder(context.out, hypothesis.name) for hypothesis in hypotheses]
    runs = [path for folder in folders if folder.exists() for path in manifest_files(folder)]
    return [context.out / MAP, *runs]


def add_round(context: Context, base: str) -> bool:
    """Choose training runs at the maxima just found; False when there is nothing left to do.

    `base` stands for all that the first maximum was made from; see `calib.study.verification`.
    """
    trained = {h.name: trained_at(context, h) for h in context.study.hypotheses}
    return verification.add_round(context, base, context.out / REFINEMENT, trained)


def describe(result: MapResult, samples: StoredSamples) -> dict[str, object]:
    """Both maxima as constants [MPa], their difference in posterior SDs, and how it went."""
    space = samples.space
    names = space.law.constants
    emulator = _named(names, space.constants(result.emulator.theta))
    direct, difference = None, None
    if result.direct is not None and result.maximum is not None:
        maximum = space.constants(theta_of(result.maximum))
        direct = _named(names, maximum)
        off = maximum - space.constants(result.emulator.theta)
        # A constant that the law fixes has no SD and no difference.
        sd = samples.constants_sd
        difference = _named(names, np.divide(off, sd, out=np.zeros_like(off), where=sd > 0))
    return {
        "units": "MPa",
        "emulator": emulator,
        "fe": direct,
        "difference_sd": difference,
        "x": space.x_names,
        "emulator_x": result.emulator.x,
        "fe_x": None if result.direct is None else result.direct.x,
        "maximum_x": result.maximum,
        "difference_sd_x": result.difference_sd,
        "foretold_sd_x": result.foretold_sd,
        "log_prob_emulator": result.emulator.log_prob,
        "log_prob_fe": None if result.direct is None else result.direct.log_prob,
        "projected_gradient_fe": None if result.direct is None else result.direct.gradient,
        "n_fe_solves": result.n_solves,
        "solved_at": result.solved,
        "converged": result.status is MapStatus.CONVERGED,
        "status": str(result.status),
        "by_secants": result.by_secants,
        "message": result.message,
    }


def laplace(
    posterior: Posterior, result: MapResult, samples: StoredSamples
) -> dict[str, object] | None:
    """The normal density with the curvature at the emulator's maximum beside the samples.

    SDs over those of the samples, and the largest difference of two correlations. None where the
    density does not fall in all directions.
    """
    covariance = laplace_covariance(posterior, result.emulator.x, samples.sd)
    if covariance is None:
        return None
    sd = np.sqrt(np.diag(covariance))
    sampled = np.atleast_2d(np.corrcoef(samples.result.draws, rowvar=False))
    off = np.abs(covariance / np.outer(sd, sd) - sampled)
    return {"sd_ratio": (sd / samples.sd).tolist(), "correlation_off": float(off.max())}


def is_training_run(context: Context, hypothesis: Hypothesis, result: MapResult) -> bool:
    """Whether the emulator was trained at the FE maximum, where the two agree by construction."""
    if result.direct is None:
        return False
    ratios = trained_at(context, hypothesis)
    at = result.direct.x[1 : 1 + ratios.shape[1]]
    return bool(np.isclose(ratios, at, rtol=0.0, atol=1e-9).all(axis=1).any())


def trained_at(context: Context, hypothesis: Hypothesis) -> Array:
    """(k, d) points of the runs that the emulator of a hypothesis learns from."""
    design = load_design(context, hypothesis).theta[: context.study.design.n_runs]
    refined = load_refinement(context, hypothesis).theta
    if kept_box(context.out, hypothesis) is None:
        local = read_json(context.out / REFINEMENT)[hypothesis.name].get("local", ())
        refined = np.delete(refined, local, axis=0)
    return np.concatenate([design, refined, added(context.out, hypothesis, design.shape[1])])


def _named(names: Sequence[str], values: Array) -> dict[str, float]:
    return dict(zip(names, np.asarray(values).tolist(), strict=True))
