"""How often the posterior of the study `virtual` holds its truth, over noise drawn anew.

    calib run virtual && python -m benchmarks.virtual_coverage [runs/virtual] [30]

The truth, its run on the finer mesh, the emulator and the mesh's error are those of the finished
study; only the (synthetic) noise is new, so this says nothing of other truths. Posteriors are
integrated by quadrature. Draws whose SD between samples is below that of the load cell are left
out: no likelihood can be built for them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from calib.inference.coordinates import CONSTANTS, constants_of
from calib.inference.quadrature import integrate
from calib.study.config import load_study
from calib.study.context import Context, block_pin_model, stream
from calib.study.data_stage import load_data
from calib.study.mesh_error_file import load_mesh_error
from calib.study.posterior_setup import noise_of, posterior_of
from calib.study.train_stage import load_emulator
from calib.study.virtual_stage import noise, truth_model, truth_of, truth_run
from calib.virtual import virtual_experiment
from fe.executors import serial_map
from fe.response import Array
from surrogate import ScaledEmulator


def z_scores(out: Path, n: int) -> Array:
    """(m, 4) posterior mean minus truth in posterior SDs for (C10, C01, C11, mu), m <= n."""
    study = load_study("virtual")
    name = load_data(out).truth_hypothesis
    hypothesis = next(h for h in study.hypotheses if h.name == name)
    theta = truth_of(study)
    context = Context(study, out, block_pin_model, serial_map, print, show_progress=False)
    truth, response = constants_of(theta), truth_run(context)
    emulator = ScaledEmulator(load_emulator(out, hypothesis))
    mesh = load_mesh_error(out, hypothesis)
    points = truth_model(context).points()
    settings, found = noise_of(study), []
    for index in range(n):
        rng = stream(study, f"coverage {index}")
        dataset = virtual_experiment(lambda _: response, theta, noise(study), rng, points=points)
        if dataset.force_sd.min() <= settings.load_cell_sd:
            continue
        posterior = integrate(
            posterior_of(study, dataset, emulator, mesh, settings, hypothesis), 18
        )
        found.append((posterior.constants_mean - truth) / posterior.constants_sd)
        print(len(found), np.round(found[-1], 2), flush=True)
    return np.array(found)


def main() -> None:
    """Print mean, SD and coverage of the scores."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "out", nargs="?", type=Path, default=Path("runs/virtual"), help="where results are kept"
    )
    parser.add_argument("n", nargs="?", type=int, default=30, help="synthetic experiments")
    args = parser.parse_args()
    z = z_scores(args.out, args.n)
    print(f"synthetic experiments: {len(z)}; (mean - truth) / SD")
    for name, column in zip(CONSTANTS, z.T, strict=True):
        within = " ".join(f"{100 * np.mean(np.abs(column) < k):.0f} %" for k in (0.674, 1.88))
        print(
            f"{name:4} mean {column.mean():+.2f} SD {column.std(ddof=1):.2f} in 50, 94 %: {within}"
        )


if __name__ == "__main__":
    main()
