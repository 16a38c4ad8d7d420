"""Figure of calibration: how far the posterior probabilities below truths are from uniform.

    python -m benchmarks.calibration_ranks ARM ... [--store DIR] [--out FILE]

An arm is a folder of posteriors that `benchmarks.verify_inference` kept in the store (the newest
set of it is drawn); without one all are drawn.  For each the distribution function of the
probabilities less that of the uniform, by parameter, with the band that uniform numbers leave once
in a hundred figures (Kolmogorov), and how often the 50, 80 and 95 % intervals hold their truth.
The truths are SYNTHETIC.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.calibration_figures import FALSE_ALARM
from benchmarks.calibration_runs import ROOT, STORE
from calib.inference import PARAMETERS
from calib.inference.rank_uniformity import coverage, uniformity
from calib.study.figure_style import COLOURS, INK, LINES, save_png, tidy
from fe.response import Array

OUT = ROOT / "docs" / "images" / "calibration.png"
N_COLUMNS = 3


def main(arguments: list[str] | None = None) -> None:
    """Draw the arms asked for."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.calibration_ranks", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("arms", nargs="*", metavar="ARM", help="folders of the store, all if none")
    parser.add_argument("--store", type=Path, default=STORE, metavar="DIR")
    parser.add_argument("--out", type=Path, default=OUT, metavar="FILE")
    options = parser.parse_args(arguments)
    kept = options.store / "placed"
    known = sorted(path.name for path in kept.iterdir()) if kept.is_dir() else []
    missing = [name for name in options.arms if name not in known]
    if missing or not known:
        parser.error(
            f"{kept}: found no arm {', '.join(missing) or 'at all'}, expected some of "
            f"{', '.join(known) or 'those that verify_inference makes'}"
        )
    arms = {name: below_of(kept / name) for name in options.arms or known}
    save_png(ranks_figure(arms), options.out)
    print(f"written to {options.out}")


def below_of(folder: Path) -> Array:
    """(n, 3) probabilities below the truths of the newest set of an arm's chunks.

    Raises ValueError where the set is not whole.
    """
    chunks = sorted(folder.glob("*.npz"), key=lambda path: path.stat().st_mtime)
    if not chunks:
        raise ValueError(f"{folder}: found no posteriors, expected chunks of an arm")
    n, seed, _ = chunks[-1].stem.split("_")
    members = sorted(
        folder.glob(f"{n}_{seed}_*.npz"), key=lambda path: int(path.stem.split("_")[2])
    )
    parts = []
    for path in members:
        with np.load(path, allow_pickle=False) as stored:
            parts.append(stored["below"])
    below = np.concatenate(parts)
    if len(below) != int(n):
        raise ValueError(f"{folder}: found posteriors of {len(below)} experiments, expected {n}")
    return below


def ranks_figure(arms: dict[str, Array]) -> Figure:
    """One panel for each arm's probabilities (n, 3)."""
    n_rows = -(-len(arms) // N_COLUMNS)
    n_columns = min(N_COLUMNS, len(arms))
    figure = Figure(figsize=(3.6 * n_columns, 3.0 * n_rows), layout="constrained")
    panels = figure.subplots(n_rows, n_columns, squeeze=False).ravel()
    for axis in panels[len(arms) :]:
        axis.set_axis_off()
    for axis, (name, below) in zip(panels, arms.items(), strict=False):
        n = len(below)
        band = uniformity(below[:, 0], false_alarm=FALSE_ALARM).ecdf_band
        axis.axhspan(-band, band, color=INK, alpha=0.1, lw=0)
        axis.axhline(0.0, color=INK, lw=0.8)
        held = np.round(100.0 * coverage(below)).astype(int)
        for index, parameter in enumerate(PARAMETERS):
            ordered = np.sort(below[:, index])
            off = (np.arange(n) + 0.5) / n - ordered
            label = f"{parameter} {' / '.join(map(str, held[:, index]))} %"
            style = {"color": COLOURS[index], "ls": LINES[index], "lw": 1.2}
            axis.plot(ordered, off, label=label, **style)
        axis.set_xlim(0.0, 1.0)
        axis.set_title(f"{name} (n = {n})", fontsize=9)
        axis.set_xlabel("posterior probability below the truth [-]", fontsize=8)
        axis.legend(fontsize=7, title="held by 50 / 80 / 95 % intervals", title_fontsize=7)
        tidy(axis)
    figure.suptitle("Distribution function less the uniform one (SYNTHETIC truths)", fontsize=10)
    return figure


if __name__ == "__main__":
    main()
