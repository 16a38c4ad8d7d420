"""How many runs the emulators of an embedded study need, with and without derivatives.

    python -m benchmarks.study_runs [STUDY] --runs 8 12 20 --held-out 16 [--out FOLDER]

Simulates the study's design (nested: one campaign serves all numbers of runs; kept in FOLDER and
reused) and prints errors on the runs held out, which follow the largest number of training runs.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

from calib.study import load_study
from calib.study.context import Context, block_pin_model
from calib.study.simulate_stage import load_design, run_design
from calib.study.training_runs import held_out_set, rows, training_set
from fe.campaign_result import Campaign
from fe.executors import process_map
from surrogate import Emulator, held_out_residuals


def main() -> None:
    """Print one line for each hypothesis, number of runs and kind of training."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", nargs="?", default="thesis-forces")
    parser.add_argument("--runs", type=int, nargs="+", default=[8, 12, 20])
    parser.add_argument("--held-out", type=int, default=16)
    parser.add_argument("--seed", type=int, help="of the fits; default: the study's")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    study = load_study(arguments.study)
    seed = study.seed if arguments.seed is None else arguments.seed
    design = replace(study.design, n_runs=max(arguments.runs), n_held_out=arguments.held_out)
    with tempfile.TemporaryDirectory() as folder:
        context = Context(
            study=replace(study, design=design),
            out=arguments.out or Path(folder),
            simulate_factory=block_pin_model,
            map_fn=process_map(0),
            echo=print,
            show_progress=True,
        )
        run_design(context)
        for hypothesis in study.hypotheses:
            campaign = load_design(context, hypothesis)
            for n in arguments.runs:
                for gradients in (False, True):
                    line = errors(campaign, n, max(arguments.runs), gradients, seed)
                    print(f"{hypothesis.name:<10} {line}", flush=True)


def errors(campaign: Campaign, n: int, n_train: int, gradients: bool, seed: int) -> str:
    """Errors of the emulator of the first n runs on those from `n_train` on, in words."""
    training = training_set([rows(campaign, slice(n))], gradients=gradients)
    held_out = held_out_set(rows(campaign, slice(n_train, None)))
    if held_out is None:
        return f"{n} runs: no run held out reached the last increment"
    found = held_out_residuals(Emulator.fit(training, seed), held_out).errors()
    what = "values and derivatives" if gradients else "values"
    field = "" if found.field_rms is None else f", field RMS {1e3 * max(found.field_rms):.1f} µm"
    return (
        f"{n} runs, {what}: force RMS {100 * max(found.force_rms):.2f} % at the worst increment, "
        f"largest {100 * found.force_max:.2f} %, RMS z {found.force_rms_z:.2f}, within 95 % "
        f"{found.force_coverage_95:.2f}{field}"
    )


if __name__ == "__main__":
    main()
