"""Stage `refine`: more FE runs where the first emulator puts the posterior, and a better emulator.

The design covers the whole prior; the posterior is a small part of it. A few runs placed there cost
little and make the emulator exact where it matters, and the error that it had there is shown.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.inference.forward import EmulatorForward
from calib.inference.likelihood import build_likelihood
from calib.inference.map_estimate import emulator_map
from calib.inference.posterior import Posterior
from calib.inference.quadrature import Quadrature, integrate
from calib.study.artifacts import read_json, write_json
from calib.study.config import Study
from calib.study.context import Context, stream
from calib.study.data_stage import load_data
from calib.study.mesh_error import check_folder
from calib.study.posterior_setup import noise_of, prior_of
from calib.study.progress import progress_bar
from calib.study.sections import Hypothesis
from calib.study.simulate_stage import load_design, manifest_files
from calib.study.train_stage import FIRST, fit_and_judge, has_field, load_emulator, split
from fe.campaign import CampaignPlan, load_campaign, run_campaigns
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator, ScaledEmulator, TrainingSet

CANDIDATE_MASS = 0.94
"""posterior mass of the region in which runs are added"""
N_SECOND = 2
"""runs of the second round: at the maximum and at the mean; half of all runs where there is a
field, which narrows the posterior to much less than the forces alone do"""
CHECKED = [0, -1]
"""runs at which the error of the mesh is measured: the mean of either round"""
NOMINAL_FORCE_ERROR = 0.02
"""relative error of the force that stands in for the mesh's until it is measured"""
NOMINAL_FIELD_ERROR = 0.005
"""the same for the field, mm"""
REFINEMENT = "refinement.json"
SAME_POINT = 1e-4


def run(context: Context) -> list[Path]:
    """Add runs at the posterior, train again; returns emulators, diagnostics and runs.

    In two rounds: spread over the first emulator's posterior by the forces, then at the maximum
    and the mean of the better emulator's by all data, so that the final one has been at the place
    it names. The mean of either round is solved on the finer mesh too.
    """
    study = context.study
    sets = [_first_round(context, hypothesis) for hypothesis in study.hypotheses]
    campaigns = _run_with_checks(context, sets, CHECKED[:1], "refine")
    sets = [
        _second_round(context, hypothesis, run_set, added)
        for hypothesis, run_set, added in zip(study.hypotheses, sets, campaigns, strict=True)
    ]
    campaigns = _run_with_checks(context, sets, CHECKED[1:], "refine again")
    training = {}
    errors = {}
    for hypothesis, added in zip(study.hypotheses, campaigns, strict=True):
        errors[hypothesis.name] = _first_errors(context, hypothesis, added)
        training[hypothesis.name] = _training(context, hypothesis, added)
    write_json(context.out / REFINEMENT, errors)
    paths = fit_and_judge(context, context.out, training)
    runs = [path for run_set in sets for path in manifest_files(run_set.store)]
    return [*paths, context.out / REFINEMENT, *runs]


def load_refinement(context: Context, hypothesis: Hypothesis) -> Campaign:
    """The runs at the posterior that `run` kept; runs nothing."""
    return load_campaign(_kept_plan(context, hypothesis))


def check_sets(context: Context) -> list[CampaignPlan]:
    """The runs on the finer mesh at the posterior's means, one set a hypothesis."""
    sets = [_kept_plan(context, hypothesis) for hypothesis in context.study.hypotheses]
    return _check_sets(context, sets, CHECKED)


def _run_with_checks(
    context: Context, sets: list[CampaignPlan], checked: list[int], name: str
) -> list[Campaign]:
    # The long runs on the finer mesh, which the next stage wants, go first in the same pool.
    checks = _check_sets(context, sets, checked)
    with progress_bar(name, "run", shown=context.show_progress) as progress:
        return run_campaigns([*checks, *sets], context.map_fn, progress)[len(checks) :]


def _check_sets(
    context: Context, sets: list[CampaignPlan], checked: list[int]
) -> list[CampaignPlan]:
    return [
        CampaignPlan(
            context.model(hypothesis, context.study.check_cells(hypothesis)),
            run_set.theta[checked],
            check_folder(context.out, hypothesis),
            max_failure_rate=1.0,
        )
        for hypothesis, run_set in zip(context.study.hypotheses, sets, strict=True)
    ]


def _kept_plan(context: Context, hypothesis: Hypothesis) -> CampaignPlan:
    kept = read_json(context.out / REFINEMENT)[hypothesis.name]
    return _plan(context, hypothesis, np.asarray(kept["ratios"], dtype=float))


def _plan(context: Context, hypothesis: Hypothesis, ratios: Array) -> CampaignPlan:
    return CampaignPlan(
        context.sampling_model(hypothesis),
        ratios,
        refine_folder(context.out, hypothesis),
        design={"kind": "posterior", "seed": context.study.seed},
        max_failure_rate=1.0,
    )


def refine_folder(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the runs at the posterior are kept."""
    return out / "refine" / hypothesis.name


def refinement_points(quadrature: Quadrature, n: int, *given: Array) -> Array:
    """(n, 2) ratios (r, s) spread over the posterior: first its mean, then ever the farthest node.

    Farthest from the mean, the points `given` (2,) and those before, in posterior SDs, among the
    nodes that hold `CANDIDATE_MASS` of the posterior.
    """
    weights = quadrature.weights / quadrature.weights.sum()
    order = np.argsort(-weights)
    kept = order[: int(np.searchsorted(np.cumsum(weights[order]), CANDIDATE_MASS)) + 1]
    sd = quadrature.sd[1:]
    candidates = quadrature.x[kept][:, 1:]
    chosen = [quadrature.mean[1:]]
    while len(chosen) < n:
        distance = np.min(
            [np.linalg.norm((candidates - point) / sd, axis=1) for point in (*given, *chosen)],
            axis=0,
        )
        chosen.append(candidates[int(np.argmax(distance))])
    return np.array(chosen)


def _first_round(context: Context, hypothesis: Hypothesis) -> CampaignPlan:
    emulator = load_emulator(context.out / FIRST, hypothesis)
    first = integrate(_posterior(context.study, context.out, emulator, with_field=False))
    n = context.study.design.n_refine - _n_second(context.study)
    return _plan(context, hypothesis, refinement_points(first, n))


def _second_round(
    context: Context, hypothesis: Hypothesis, first: CampaignPlan, added: Campaign
) -> CampaignPlan:
    """The runs of the first round, then those by the emulator with them: the mean comes last."""
    training, _ = _training(context, hypothesis, added)
    emulator = Emulator.fit(training, context.study.seed)
    posterior = _posterior(context.study, context.out, emulator, with_field=True)
    quadrature = integrate(posterior)
    rng = stream(context.study, f"refine {hypothesis.name}")
    maximum = emulator_map(posterior, quadrature.sd, rng).x[1:]
    n = _n_second(context.study)
    points = np.array([maximum, *refinement_points(quadrature, n - 1, maximum)[::-1]])
    return replace(first, theta=np.concatenate([first.theta, points]))


def _n_second(study: Study) -> int:
    return max(N_SECOND, study.design.n_refine // 2) if has_field(study) else N_SECOND


def _training(
    context: Context, hypothesis: Hypothesis, added: Campaign
) -> tuple[TrainingSet, TrainingSet | None]:
    """Training runs of the design and those added, and the runs held out."""
    design, held_out = split(load_design(context, hypothesis), context.study.design.n_runs)
    return _joined(design, added), held_out


def _posterior(study: Study, out: Path, emulator: Emulator, *, with_field: bool) -> Posterior:
    """The posterior by an emulator and the forces, and if asked the field where there is one.

    The mesh's error is not known yet; a nominal one stands in. By a field the region would be
    narrower than a first emulator can tell.
    """
    dataset = load_data(out).dataset
    if not with_field:
        dataset = replace(dataset, field=None)
    likelihood = build_likelihood(
        dataset,
        EmulatorForward(ScaledEmulator(emulator), with_field=dataset.field is not None),
        noise_of(study),
        force_discretisation=NOMINAL_FORCE_ERROR,
        field_floor=NOMINAL_FIELD_ERROR,
    )
    return Posterior(prior_of(study), likelihood)


def _first_errors(context: Context, hypothesis: Hypothesis, added: Campaign) -> dict[str, object]:
    """Error of the first emulator where the posterior is, found by runs it had not seen."""
    emulator = load_emulator(context.out / FIRST, hypothesis)
    ok = added.reached
    if not ok.any():
        context.echo(f"  {hypothesis.name}: no run at the posterior reached the last increment")
        return {"ratios": added.theta}
    mean, covariance = emulator.unit_force(added.theta[ok])
    relative = mean / added.force[ok] - 1.0
    std = np.sqrt(np.einsum("nii->ni", covariance))
    z = (mean - added.force[ok]) / std
    context.echo(
        f"  {hypothesis.name}: at the posterior the first emulator was off by "
        f"{100 * np.sqrt(np.mean(relative**2, axis=0)).max():.2g} % (RMS, worst increment), "
        f"{np.sqrt(np.mean(z**2)):.2g} of its stated SDs"
    )
    return {
        "ratios": added.theta,
        "relative_force_error": relative,
        "standardised_error": z,
        "units": {"relative_force_error": "relative", "standardised_error": "stated SD"},
    }


def _joined(design: TrainingSet, added: Campaign) -> TrainingSet:
    """The design's training runs with those added that reached the last increment.

    Runs closer than `SAME_POINT` of the design's span to another are left out: to a Gaussian
    process they are the same point, and would make its matrix singular.
    """
    span = np.ptp(design.ratios, axis=0)
    ratios = list(design.ratios)
    new = []
    for index in np.flatnonzero(added.reached):
        distance = np.abs((np.array(ratios) - added.theta[index]) / span).max(axis=1)
        if distance.min() > SAME_POINT:
            ratios.append(added.theta[index])
            new.append(index)
    displacement = design.displacement
    if displacement is not None:
        displacement = np.concatenate([displacement, added.displacement[new]])
    return TrainingSet(
        ratios=np.array(ratios),
        force=np.concatenate([design.force, added.force[new]]),
        displacement=displacement,
        n_excluded=design.n_excluded + int((~added.reached).sum()),
    )
