"""The figures of a report, drawn from the artifacts of all stages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from calib.inference.coordinates import theta_of
from calib.study.config import Study
from calib.study.emulator_figures import refinement_loop
from calib.study.figure_style import save_png, symbol
from calib.study.findings import VALIDATIONS, Findings
from calib.study.force_figures import MeasuredForce, PredictedForce, force_travel
from calib.study.population_report import population_figures
from calib.study.posterior_figures import Chains, Samples, chains, marginals, pairs
from calib.study.predictive_report import predictive_figures
from calib.study.prior_stage import FIGURE
from calib.study.report import Picture
from calib.study.sample_stage import StoredSamples
from calib.study.train_report import emulator_figure, worst_figure
from fe.response import Array


def draw(
    findings: Findings, samples: dict[str, StoredSamples], study: Study, out: Path
) -> dict[str, Picture]:
    """Draw all figures into the study's folder; name -> picture."""
    data = findings.data
    kind = "synthetic" if data["synthetic"] else "measured"
    drawn: dict[str, tuple[Figure, str]] = {
        "forces": (
            _force_figure(findings, samples),
            f"Force against travel: {kind} mean with standard error (thick) and SD between "
            "samples (thin); bands hold 94 % of the posterior predictive draws of the mean force.",
        ),
        "marginals": (
            marginals(_posterior_samples(findings, samples), data["published"], data["truth"]),
            "Marginal posterior of each constant under each hypothesis, each on its own axis.",
        ),
        "pairs": (
            pairs(_posterior_samples(findings, samples, without="mu"), data["truth"]),
            "Posterior draws and contours that hold 50 % and 94 % of them; note that every "
            "hypothesis has its own axes.",
        ),
        "chains": (
            chains([_chains(name, stored) for name, stored in samples.items()]),
            "Chains of every ensemble after burn-in; they should be indistinguishable.",
        ),
        "emulator": (
            emulator_figure(findings.diagnostics, study),
            "Error of the emulators' force on FE runs that were held out.",
        ),
        "emulator_worst": (
            worst_figure(out, findings.diagnostics, study),
            "Largest force error of every run by an emulator that had not seen it; error of the "
            "emulated field at each point of the front face, the worst ten ringed.",
        ),
        "refinement": (
            refinement_loop(findings.refinement),
            "How far the posterior mean may move, and the emulators' error at the runs added.",
        ),
    }
    drawn |= predictive_figures(findings.predictive, study, out)
    drawn |= population_figures(findings.summaries, out)
    pictures = {}
    for name, (figure, caption) in drawn.items():
        save_png(figure, out / "figures" / f"{name}.png")
        pictures[name] = Picture(out / "figures" / f"{name}.png", caption)
    return pictures | _drawn_before(findings, out)


def _drawn_before(findings: Findings, out: Path) -> dict[str, Picture]:
    """Pictures that are there: of validations and of what the priors expect."""
    pictures = {}
    for name in findings.validations:
        pictures[f"validation_{name}"] = Picture(
            out / VALIDATIONS / name / "validation.png",
            "Measured and predicted answers to the second test, and the error by increment.",
        )
    pictures["prior"] = Picture(
        out / FIGURE,
        "Forces that the priors expect, with all errors, before the data were looked at: bands "
        "hold 50 % and 94 % of the draws.",
    )
    return pictures


def _force_figure(findings: Findings, samples: dict[str, StoredSamples]) -> Figure:
    data = findings.data
    measured = MeasuredForce(
        label="synthetic" if data["synthetic"] else "measured",
        travel=np.asarray(data["travel"]),
        mean=np.asarray(data["force_mean"]),
        sd=np.asarray(data["force_sd"]),
        n_samples=data["n_samples"],
    )
    predicted = []
    for name, stored in samples.items():
        published = findings.comparison["hypotheses"][name]["published"]
        force = None if published is None else np.asarray(published["force"], dtype=float)
        predicted.append(PredictedForce(name, stored.predictive, force))
    return force_travel(measured, predicted)


def _posterior_samples(
    findings: Findings,
    samples: dict[str, StoredSamples],
    without: str = "",
) -> list[Samples]:
    """Draws of the constants and of what else was unknown, by hypothesis."""
    found = []
    for hypothesis, stored in samples.items():
        space = stored.space
        x = stored.chains.reshape(-1, space.size)
        values = dict(zip(space.law.constants, space.constants(theta_of(x)).T, strict=True))
        units = dict(zip(space.law.constants, space.law.units, strict=True))
        for unknown, column in zip(space.unknowns, space.natural(x).T, strict=True):
            if unknown in (*space.inputs, *space.errors):
                values[unknown.name], units[unknown.name] = column, unknown.unit
        values.pop(without, None)
        shown = {name: "-" if unit == "1" else unit for name, unit in units.items()}
        maximum = findings.maps[hypothesis]
        found.append(Samples(hypothesis, values, maximum["emulator"], maximum["fe"] or {}, shown))
    return found


def _chains(name: str, stored: StoredSamples) -> Chains:
    natural: Array = stored.space.natural(stored.chains)
    walkers = natural.transpose(3, 0, 2, 1)
    labels = [
        f"{symbol(u.name)} [{'-' if u.unit == '1' else u.unit}]" for u in stored.space.unknowns
    ]
    return Chains(name, dict(zip(labels, walkers, strict=True)))
