"""Stage `posterior`: posterior.nc, which holds all that is needed to know what it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from calib import __version__
from calib.data import Dataset
from calib.inference.forward import EmulatorForward
from calib.inference.inference_data import (
    HypothesisSamples,
    build_inference_data,
    save_inference_data,
)
from calib.inference.noise import field_nuisances
from calib.study.artifacts import hash_of_file, plain, read_json
from calib.study.config import Study
from calib.study.context import Context, stream
from calib.study.data_stage import StudyData, load_data
from calib.study.early_runs import beyond_complete_runs
from calib.study.local_design import BOXES, LOCAL, REFINEMENT, kept_box
from calib.study.mesh_error_file import load_mesh_error, mesh_error_files
from calib.study.mesh_remarks import distance_sentence, errors_sentence
from calib.study.posterior_setup import emulator_posterior, noise_of
from calib.study.remarks import few_samples, of_chains, pulled
from calib.study.sample_stage import load_samples, samples_path
from calib.study.sections import Hypothesis
from calib.study.train_stage import emulator_path, load_diagnostics, load_emulator
from calib.study.unknowns import design_box, prior_of
from fe.progress_bar import progress_bar
from surrogate import ScaledEmulator


def run(context: Context) -> list[Path]:
    """Write posterior.nc; returns its path."""
    study, out = context.study, context.out
    data = load_data(out)
    hypotheses = {
        h.name: HypothesisSamples(
            posterior.likelihood, load_samples(out, h).result, posterior.prior.space
        )
        for h in study.hypotheses
        for posterior in [emulator_posterior(context, h)]
    }
    stated, rng = provenance(out, study, data), stream(study, "predictive")
    with progress_bar("densities", "draw", shown=context.show_progress) as progress:
        found = build_inference_data(hypotheses, data.dataset, stated, rng, progress)
    save_inference_data(found, out / "posterior.nc")
    return [out / "posterior.nc"]


def provenance(out: Path, study: Study, data: StudyData) -> dict[str, object]:
    """Where the samples come from, and everything by which they are to be judged (JSON data)."""
    maps = read_json(out / "map.json")
    compared = read_json(out / "comparison.json")["hypotheses"]
    diagnostics = load_diagnostics(out)
    in_use = {
        h.name: diagnostics[h.name]
        if kept_box(out, h) is None
        else load_diagnostics(out / LOCAL)[h.name]
        for h in study.hypotheses
    }
    sampler = study.sampler
    facts: dict[str, object] = {
        "study": study.name,
        "seed": study.seed,
        "version": __version__,
        "synthetic": data.dataset.synthetic,
        "data": data.dataset.name,
        "published": data.published,
        "truth": data.truth,
        "truth_hypothesis": data.truth_hypothesis,
        "limits": {"max_r_hat": sampler.max_r_hat, "min_ess": sampler.min_ess},
        "hypotheses": {
            h.name: _hypothesis(
                out, study, h, maps[h.name], diagnostics[h.name], data.dataset.field is not None
            )
            | _judged(out, study, h, data.dataset, compared[h.name], in_use[h.name])
            for h in study.hypotheses
        },
        "study_file": plain(study),
        "input_hashes": _hashes(out, study),
    }
    described: dict[str, object] = plain(facts)
    return described


def _hypothesis(
    out: Path,
    study: Study,
    hypothesis: Hypothesis,
    maximum: Any,
    diagnostics: dict[str, Any],
    with_field: bool,
) -> dict[str, object]:
    result = load_samples(out, hypothesis).result
    prior = prior_of(study, hypothesis, with_field=with_field)
    return {
        "contact": hypothesis,
        "space": load_samples(out, hypothesis).space,
        "bounds": prior.bounds,
        "constant_bounds": prior.constant_bounds,
        "map": maximum,
        "emulator": {
            key: diagnostics[key] for key in ("n_train", "n_excluded", "leave_one_out", "held_out")
        },
        "emulator_failures": diagnostics["failures"],
        "mesh_remark": _mesh_remark(out, study, hypothesis) if with_field else "",
        "emulator_box": kept_box(out, hypothesis),
        "sampling": {
            "status": str(result.status),
            "message": result.message,
            "autocorrelation_time": result.autocorrelation_time.max(axis=0),
            "acceptance": result.acceptance,
        },
    }


def _judged(
    out: Path,
    study: Study,
    hypothesis: Hypothesis,
    dataset: Dataset,
    compared: dict[str, Any],
    diagnostics: dict[str, Any],
) -> dict[str, object]:
    """How the forces fit, and what a reader should see; `compared` is of comparison.json."""
    stored = load_samples(out, hypothesis)
    sampled, inputs = stored.result, slice(1, 1 + len(design_box(study, hypothesis)))
    names = [name.removesuffix(" [MPa]") for name in stored.space.x_names[inputs]]
    ended = {"status": str(sampled.status), "message": sampled.message}
    remarks = [
        *beyond_complete_runs(diagnostics, sampled.draws[:, inputs], names),
        *of_chains(ended, compared["quadrature"]),
        *pulled(compared.get("nuisances", ())),
        *few_samples(study, hypothesis, dataset),
        *load_data(out).warnings,
    ]
    return {"predictive_p": compared["predictive_p"], "remarks": remarks}


def _mesh_remark(out: Path, study: Study, hypothesis: Hypothesis) -> str:
    """What the mesh errs by, and whether the posterior lies where that was measured."""
    mesh, stored = load_mesh_error(out, hypothesis), load_samples(out, hypothesis)
    dataset, noise, place = load_data(out).dataset, noise_of(study), mesh.ratios[-1]
    ratios = slice(1, 1 + place.size)
    mean, names = stored.result.draws[:, ratios].mean(axis=0), stored.space.x_names[ratios]
    extent = np.ptp(design_box(study, hypothesis), axis=1)
    emulator = load_emulator(out if kept_box(out, hypothesis) is None else out / LOCAL, hypothesis)
    forward = EmulatorForward(ScaledEmulator(emulator), with_field=True, correction=mesh.correction)
    units = tuple(error.unit for error in field_nuisances(dataset, noise))
    errors = errors_sentence(mesh.mistaken(dataset, noise, forward), names, units)
    far = distance_sentence(place, mean, stored.sd[ratios], extent, names)
    return " ".join(filter(None, (errors, far)))


def _hashes(out: Path, study: Study) -> dict[str, str]:
    paths = [out / "data.npz", out / "data.json", out / "map.json"]
    paths += [path for path in (out / BOXES, out / REFINEMENT) if path.is_file()]
    for hypothesis in study.hypotheses:
        paths += [emulator_path(out, hypothesis), samples_path(out, hypothesis.name)]
        paths += mesh_error_files(out, hypothesis)
        if kept_box(out, hypothesis) is not None:
            paths.append(emulator_path(out / LOCAL, hypothesis))
    return {path.relative_to(out).as_posix(): hash_of_file(path) for path in paths}
