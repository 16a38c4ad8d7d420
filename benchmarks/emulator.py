"""Emulators on held-out FE runs: error, coverage, time, and peers on the same runs.

    python benchmarks/emulator.py [--json FILE] [--designs 1 2 3] [--contact stick slide]
                                  [--held-out N] [--held-out-seed K] [--store FOLDER]
                                  [--no-peers] [--keep] [--no-refinement]

Simulations are stored one by one and reused, so that a killed benchmark goes on where it was; its
figures are written design by design, and `--keep` leaves those of other designs as they are.  One
process with one thread.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # read when numpy and MKL are loaded
if __name__ == "__main__" and not __package__:
    sys.path[0] = str(Path(__file__).resolve().parents[1])

import argparse
import json
import time
import timeit
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np

from benchmarks.emulator_peers import PeerFigures, peer_figures
from benchmarks.emulator_refinement import refinement_figures
from benchmarks.emulator_runs import CELLS, DESIGNS, HELD_OUT_SEED, Design, family, simulate
from fe.campaign_result import Campaign
from surrogate import (
    Emulator,
    TrainingSet,
    held_out_residuals,
    leave_one_out_residuals,
    named_gradient,
)

N_THETA = 1000
DERIVATIVE_COST = {"stick": 0.116, "slide": 0.019, "friction": 0.097}
"""share of a run's time that all derivatives take (`verify_fe --only taylor`, 2026-11-26)"""


def main(arguments: list[str] | None = None) -> None:
    """Run the designs asked for and write the figures."""
    options = _parser().parse_args(arguments)
    figures: dict[str, Any] = {"cells": CELLS, "designs": []}
    if options.json and options.json.exists() and options.keep:
        figures = json.loads(options.json.read_text()) | {"cells": CELLS}
    for number in options.designs:
        design = DESIGNS[number - 1]
        # Where friction is a factor, it is the contact.
        for contact in ("friction",) if "friction" in design.names else options.contact:
            _put(figures["designs"], _design(design, contact, options))
            _write(figures, options.json)
    if not options.no_refinement:
        figures |= refinement_figures()
        for found in figures["refinement"]:
            print(f"Refinement, {found['waves']:g} waves: {found['refined']}, {found['fixed']}")
        _write(figures, options.json)


def _put(tables: list[dict[str, Any]], table: dict[str, Any]) -> None:
    """In the place of the row with the same design and contact, or at the end."""
    for place, other in enumerate(tables):
        if (other["design"], other["contact"]) == (table["design"], table["contact"]):
            tables[place] = table
            return
    tables.append(table)
    tables.sort(key=lambda row: len(row["design"]))


def _write(figures: dict[str, Any], path: Path | None) -> None:
    if path:
        path.write_text(json.dumps(figures, indent=2) + "\n")
        print(f"written to {path}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="benchmarks.emulator", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    parser.add_argument("--keep", action="store_true", help="keep FILE's rows of other designs")
    parser.add_argument("--no-refinement", action="store_true", help="leave the refinement out")
    parser.add_argument("--designs", type=int, nargs="*", default=[1, 2, 3], choices=[1, 2, 3])
    parser.add_argument(
        "--contact", nargs="+", default=["stick", "slide"], choices=["stick", "slide"]
    )
    parser.add_argument("--held-out", type=int, default=32, metavar="N")
    seed = "of the Sobol sequence of held-out runs: another one for a set never looked at"
    parser.add_argument("--held-out-seed", type=int, default=HELD_OUT_SEED, help=seed)
    parser.add_argument("--store", type=Path, default=Path("runs/emulator_benchmark"))
    parser.add_argument("--no-peers", action="store_true", help="leave the other codes out")
    return parser


def _design(design: Design, contact: str, options: argparse.Namespace) -> dict[str, Any]:
    """Figures of one row of the table with one contact."""
    print(f"\n{', '.join(design.names)}: {design.n_runs} runs, {contact}")
    model = family(design.names, contact, CELLS[contact])
    folder = options.store / contact
    held_out = design.held_out(options.held_out, options.held_out_seed)
    points = np.vstack([design.training(), held_out])
    campaign = simulate(points, model, folder, _progress)
    training = _runs(design, campaign, slice(None, design.n_runs))
    unseen = _runs(design, campaign, slice(design.n_runs, None))
    by_kind = {
        "gradient_enhanced": _figures(training, unseen),
        "plain": _figures(training.without_gradients, unseen),
    }
    # As many runs with derivatives as take the time of all without.
    n_equal = int(design.n_runs / (1.0 + DERIVATIVE_COST[contact]))
    at_equal_time = _figures(_first(training, n_equal), unseen)
    fe_seconds = float(np.mean([run.seconds for run in campaign.responses]))
    table: dict[str, Any] = {
        "design": list(design.names),
        "contact": contact,
        "n_runs": design.n_runs,
        "n_excluded": training.n_excluded,
        "n_held_out": len(unseen.ratios),
        "held_out_seed": options.held_out_seed,
        "to_reach": {
            "field_rmse_mm": design.max_field_mm,
            "force_max_percent": design.max_force_percent,
        },
        **by_kind["gradient_enhanced"],
        **by_kind,
        "at_equal_fe_time": {"n_runs": n_equal, **at_equal_time},
        "fe_seconds_a_run": fe_seconds,
    }
    if not options.no_peers:
        plain_seconds = fe_seconds / (1.0 + DERIVATIVE_COST[contact])
        table |= _beside_peers(training, unseen, fe_seconds, design.n_runs * plain_seconds)
    _print(table)
    return table


def _beside_peers(
    training: TrainingSet, held_out: TrainingSet, run_seconds: float, peer_fe_seconds: float
) -> dict[str, Any]:
    """Errors of the peers, and what ours and theirs take in all for the same error of the field.

    A run of ours takes `run_seconds`, derivatives included, all runs of a peer `peer_fe_seconds`.
    """
    peers = peer_figures(training, held_out)
    return {
        "peers": {name: asdict(figures) for name, figures in peers.items()},
        "at_error_of": {
            name: {
                "n_runs": found.n_runs,
                "seconds": found.n_runs * run_seconds + found.train_seconds,
                "peer_seconds": peer_fe_seconds + peers[name].train_seconds,
            }
            for name, found in _at_error_of(training, held_out, peers).items()
        },
    }


def _runs(design: Design, campaign: Campaign, rows: slice) -> TrainingSet:
    """Runs of a campaign with the derivatives that the FE model gives, by their names."""
    responses = campaign.responses[rows]
    gradients = {
        kind: np.stack(
            [
                named_gradient(getattr(run, f"{kind}_gradient"), run.parameters, design.names)
                for run in responses
            ]
        )
        for kind in ("force", "displacement")
    }
    factors = campaign.theta[rows]
    return TrainingSet.from_runs(
        design.coordinates(factors),
        campaign.force[rows],
        campaign.displacement[rows],
        campaign.reached[rows],
        force_gradient=design.by_coordinates(gradients["force"], factors),
        displacement_gradient=design.by_coordinates(gradients["displacement"], factors),
        smooth=np.array([(run.negative_pivots <= 0).all() for run in responses]),
        good=campaign.good[rows],
    )


def _figures(training: TrainingSet, held_out: TrainingSet) -> dict[str, Any]:
    """Errors, coverage and times of our emulator."""
    start = time.process_time()  # one thread; other work on the machine is not counted
    emulator = Emulator.fit(training, 1)
    seconds = time.process_time() - start
    scales = leave_one_out_residuals(emulator, training).told_scales
    residuals = held_out_residuals(emulator, held_out, scales)
    errors = residuals.errors()
    assert errors.field_rms is not None and errors.field_coverage is not None
    return {
        "field_rmse_mm": float(np.sqrt(np.mean(np.square(errors.field_rms)))),
        "field_rmse_mm_by_step": errors.field_rms,
        "force_max_percent": 100.0 * errors.force_max,
        "force_max_percent_by_step": _force_max(residuals.force_error / residuals.force),
        "coverage_95": {
            "force": errors.force_coverage.overall[-1],
            "field": errors.field_coverage.overall[-1],
        },
        "coverage": {
            "force": asdict(errors.force_coverage),
            "field": asdict(errors.field_coverage),
        },
        "train_seconds": seconds,
        "predict_us": _microseconds(emulator, training),
    }


class Enough(NamedTuple):
    """Runs with which our field is no worse than a peer's, and what their fit takes."""

    n_runs: int
    train_seconds: float


def _at_error_of(
    training: TrainingSet, held_out: TrainingSet, peers: dict[str, PeerFigures]
) -> dict[str, Enough]:
    """Fewest runs with which our field is no worse than that of a peer with all of them.

    In eighths of the design, from its start (it is nested); not there where all are not enough.
    """
    n, found = len(training.ratios), dict[str, Enough]()
    for eighths in range(2, 9):
        part = n * eighths // 8
        start = time.process_time()
        emulator = Emulator.fit(_first(training, part), 1)
        seconds = time.process_time() - start
        error = emulator.displacement(held_out.ratios) - held_out.displacement
        rmse = float(np.sqrt(np.mean(error**2)))
        for name, peer in peers.items():
            if name not in found and rmse <= peer.field_rmse_mm:
                found[name] = Enough(part, seconds)
        if len(found) == len(peers):
            break
    return found


def _first(training: TrainingSet, n: int) -> TrainingSet:
    """The first n runs alone: no other, not one that ended early either, teaches or takes time."""
    return replace(training.subset(slice(0, n)), partial=None)


def _force_max(relative: np.ndarray) -> list[float]:
    largest: list[float] = (100.0 * np.abs(relative).max(axis=0)).tolist()
    return largest


def _microseconds(emulator: Emulator, training: TrainingSet) -> float:
    """A parameter vector's share of mean and covariance in the reduced space, 1000 at a time."""
    low, high = emulator.bounds.T
    x = np.random.default_rng(0).uniform(low, high, (N_THETA, len(low)))
    parts = [emulator.force.processes]
    if emulator.field is not None:
        parts.append(emulator.field.processes)

    def predict() -> None:
        for part in parts:
            part.predict(x)

    predict()
    best = min(timeit.repeat(predict, timer=time.process_time, number=3, repeat=9))
    return best / 3 / N_THETA * 1e6


def _print(table: dict[str, Any]) -> None:
    peers = table.get("peers", {})
    equal = table["at_equal_fe_time"]
    rows = {
        "gradient-enhanced": table["gradient_enhanced"],
        f"gradient-enhanced, {equal['n_runs']} runs: the FE time of plain": equal,
        "plain": table["plain"],
        **peers,
    }
    print("| emulator | field mm | force max % | covers 95 % (force, field) | train s | us |")
    print("|---|---|---|---|---|---|")
    for name, row in rows.items():
        covered = row.get("coverage_95")
        cover = "-" if covered is None else f"{covered['force']:.3f}, {covered['field']:.3f}"
        predict = f"{row['predict_us']:.1f}" if "predict_us" in row else "-"
        print(
            f"| {name} | {row['field_rmse_mm']:.2e} | {row['force_max_percent']:.3f} | {cover} "
            f"| {row['train_seconds']:.2f} | {predict} |"
        )
    for name, row in table.get("at_error_of", {}).items():
        print(
            f"the field error of {name}: {row['n_runs']} runs, {row['seconds']:.0f} s in all, its "
            f"own {row['peer_seconds']:.0f} s: {row['peer_seconds'] / row['seconds']:.1f} times"
        )


def _progress(done: int, total: int) -> None:
    print(f"\r  simulations {done}/{total}", end="\n" if done == total else "", flush=True)


if __name__ == "__main__":
    main()
