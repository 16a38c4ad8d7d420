"""Posteriors of three embedded studies on a closed-form block, and the file that keeps them.

    python tests/posterior_baseline.py        (make baseline)

writes tests/posterior_baseline.json anew and prints what has moved, by how many Monte-Carlo errors.
The studies are those that come with softcal, with fewer runs and walkers; the block is
`analytic_block`, so that emulator, likelihood, prior and sampler are the product's and no FE run is
needed.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])
    sys.path.insert(0, str(Path(__file__).resolve().parent))

import numpy as np
from analytic_block import analytic_block
from scipy.special import ndtri

from calib.data import Dataset
from calib.inference import (
    CONSTANTS,
    Posterior,
    SamplerSettings,
    constants_of,
    sample_posterior,
    theta_of,
)
from calib.study.config import Study, load_study
from calib.study.context import stream
from calib.study.data_stage import measured
from calib.study.judgement import has_field
from calib.study.mesh_error import mesh_error
from calib.study.posterior_setup import noise_of, posterior_of
from calib.study.sections import Cells, Hypothesis
from calib.study.training_runs import training_set
from calib.study.unknowns import design_box, design_points
from calib.study.virtual_stage import noise, truth_of
from calib.virtual import virtual_experiment
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator, ScaledEmulator

FILE = Path(__file__).with_suffix(".json")
TEMPLATE = Path(__file__).resolve().parents[1] / "calib" / "study" / "template" / "study.toml"
STUDIES = {
    "thesis-forces": ("thesis-forces", "sliding"),
    "virtual": ("virtual", "sliding"),
    "template": (str(TEMPLATE), "stuck"),
}
"""study and hypothesis by the name in the file"""
FALSE_ALARM = 1e-3
"""probability that any figure of all studies is flagged though no posterior has changed"""
SETTINGS = SamplerSettings(n_ensembles=2, n_walkers=200, n_autocorrelation=20, max_steps=3000)


@dataclass(frozen=True)
class Figure:
    """A number of a posterior and its Monte-Carlo error."""

    value: float
    error: float


@dataclass(frozen=True)
class Move:
    """A number that is not what it was."""

    name: str
    old: Figure
    new: Figure

    @property
    def z(self) -> float:
        """Change in its Monte-Carlo errors."""
        return (self.new.value - self.old.value) / float(np.hypot(self.new.error, self.old.error))

    @property
    def text(self) -> str:
        """One line for a reviewer."""
        old, new = (f"{f.value:.5g} ± {f.error:.1g}" for f in (self.old, self.new))
        return f"{self.name}: {old} -> {new} ({self.z:+.1f} Monte-Carlo errors)"


def figures(name: str) -> dict[str, Figure]:
    """Mean and SD of every constant (MPa) of one study's posterior."""
    source, contact = STUDIES[name]
    study = load_study(source)
    hypothesis = next(found for found in study.hypotheses if found.name == contact)
    result = sample_posterior(
        _posterior(study, hypothesis), SETTINGS, stream(study, f"baseline {contact}")
    )
    values = constants_of(theta_of(result.chains))
    # Draws that are worth one: by the slowest coordinate, for all.
    effective = values[..., 0].size / result.autocorrelation_time.max()
    found = {}
    for index, constant in enumerate(CONSTANTS):
        off = values[..., index] - values[..., index].mean()
        sd = float(off.std())
        kurtosis = float(np.mean(off**4)) / sd**4
        found[f"{name} {constant} mean"] = Figure(
            float(values[..., index].mean()), sd / effective**0.5
        )
        # Of the variance: SD^2 sqrt((kurtosis - 1) / n); half of it, relative, for the SD.
        found[f"{name} {constant} SD"] = Figure(
            sd, 0.5 * sd * float(np.sqrt((kurtosis - 1.0) / effective))
        )
    return found


def _posterior(study: Study, hypothesis: Hypothesis) -> Posterior:
    ratios = design_points(study, hypothesis)[:12]
    training = training_set(
        [_runs(study, hypothesis, study.sampling_cells(hypothesis), ratios)], gradients=True
    )
    places = np.array([[0.3, 0.1], [0.6, 0.3]])
    fine, coarse = (
        _runs(study, hypothesis, cells, places)
        for cells in (study.check_cells(hypothesis), study.sampling_cells(hypothesis))
    )
    emulator = ScaledEmulator(Emulator.fit(training, study.seed))
    extent = np.ptp(design_box(study, hypothesis), axis=1) if has_field(study) else None
    error = mesh_error(fine, coarse, 1.5, hypothesis.name, extent)
    return posterior_of(
        study, _data(study, hypothesis), emulator, error, noise_of(study), hypothesis
    )


def _runs(study: Study, hypothesis: Hypothesis, cells: Cells, ratios: Array) -> Campaign:
    model = analytic_block(study, hypothesis, cells)
    return Campaign(ratios, tuple(model(row) for row in ratios), n_reused=0)


def _data(study: Study, hypothesis: Hypothesis) -> Dataset:
    if study.virtual is None:
        return measured(study).dataset
    model = analytic_block(study, hypothesis, study.virtual.cells)
    rng = stream(study, "baseline data")
    return virtual_experiment(
        model, truth_of(study), noise(study), rng, points=model.points(), name="baseline"
    )


def stored() -> dict[str, Figure]:
    """What the file keeps."""
    return {name: Figure(*pair) for name, pair in json.loads(FILE.read_text()).items()}


def limit(n: int) -> float:
    """Monte-Carlo errors beyond which one of n changes is flagged (Bonferroni, two-sided)."""
    return float(-ndtri(0.5 * FALSE_ALARM / n))


def moved(old: dict[str, Figure], new: dict[str, Figure], most: float) -> list[Move]:
    """Numbers of `new` that are further than `most` Monte-Carlo errors from the old."""
    moves = [Move(name, old[name], figure) for name, figure in new.items() if name in old]
    return [move for move in moves if not abs(move.z) <= most]


def main() -> None:
    """Renew the file and say what has moved."""
    old = stored() if FILE.exists() else {}
    new = {key: figure for name in STUDIES for key, figure in figures(name).items()}
    flagged = limit(len(new))
    for move in moved(old, new, 0.0):
        print(f"{'MOVED ' if abs(move.z) > flagged else '      '}{move.text}")
    for name in sorted(set(old) ^ set(new)):
        print(f"{'added' if name in new else 'removed'} {name}")
    # Six digits: a reviewer reads the change of a number, not of its last bits.
    rounded = {
        name: [float(f"{figure.value:.6g}"), float(f"{figure.error:.2g}")]
        for name, figure in new.items()
    }
    lines = [f"  {json.dumps(name)}: {json.dumps(pair)}" for name, pair in rounded.items()]
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    print(f"written to {FILE}; flagged beyond {flagged:.1f} Monte-Carlo errors")


if __name__ == "__main__":
    main()
