"""Measure what docs/verification/inference.json states about the inference, part by part.

    python -m benchmarks.verify_inference [--only PART ...] [--n 300] [--store DIR] [--out FILE]

Parts: sbc and power (virtual experiments drawn from the prior), finer-stuck, finer-stuck-new and
finer (the same with truths on finer meshes; new: emulator on the sampling mesh of new studies),
fresh-stuck-new and fresh (as the last two, other truths of the prior), wide-stuck, default-stuck
and init-stuck (by a check mesh of few layers, of more, and that of studies that name none), refined
(with emulators refined as a study's are), mesh-stuck, mesh-stuck-new, mesh, mesh-wide-stuck,
mesh-default-stuck and mesh-init-stuck (whether a mesh's stated error covers finer truths),
mesh-order (at which order that of a field with friction falls), mesh-places (where on the face it
is), mesh-directions (which direction of a mesh errs), mesh-pairs (as mesh, on the runs kept by
benchmarks.verify_fe), emcee (some of their posteriors by a chain), misspecified (truths of another
law and contact, with and without a discrepancy), direct (posterior by FE at every node of a
quadrature, and the two maxima), local (how many runs in the posterior's box its emulator needs),
fixed (how many a design over the whole prior needs in place of that). FE runs and posteriors are
kept in --store, so that an interrupted part goes on where it was.
Each part replaces its own figures in FILE and leaves the others.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # read when numpy and MKL are loaded

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import (
    calibration_direct,
    calibration_emcee,
    calibration_figures,
    calibration_finer,
    calibration_misspecified,
    calibration_refined,
    fixed_runs,
    local_runs,
    mesh_directions,
    mesh_order,
    mesh_pairs,
    mesh_places,
    mesh_statement,
)
from benchmarks.calibration_runs import ROOT, STORE
from benchmarks.verify_fe import merge

OUT = ROOT / "docs" / "verification" / "inference.json"

PARTS: dict[str, Callable[[Path, int], dict[str, Any]]] = {
    "sbc": calibration_figures.sbc,
    "finer-stuck": lambda store, n: calibration_finer.finer(store, "finer-stuck", n),
    "finer-stuck-new": lambda store, n: calibration_finer.finer(store, "finer-stuck-new", n),
    "finer": lambda store, n: calibration_finer.finer(store, "finer", n // 2),
    "fresh": lambda store, n: calibration_finer.finer(store, "fresh", n // 2),
    "fresh-stuck-new": lambda store, n: calibration_finer.finer(store, "fresh-stuck-new", n),
    "wide-stuck": lambda store, n: calibration_finer.finer(store, "wide-stuck", n),
    "default-stuck": lambda store, n: calibration_finer.finer(store, "default-stuck", n),
    "init-stuck": lambda store, n: calibration_finer.finer(store, "init-stuck", n),
    "refined": calibration_refined.figures,
    "mesh-stuck": lambda store, n: mesh_statement.figures(store, "finer-stuck", n),
    "mesh-stuck-new": lambda store, n: mesh_statement.figures(store, "finer-stuck-new", n),
    "mesh": lambda store, n: mesh_statement.figures(store, "finer", n // 2),
    "mesh-wide-stuck": lambda store, n: mesh_statement.figures(store, "wide-stuck", n),
    "mesh-default-stuck": lambda store, n: mesh_statement.figures(store, "default-stuck", n),
    "mesh-init-stuck": lambda store, n: mesh_statement.figures(store, "init-stuck", n),
    "mesh-order": lambda store, n: mesh_order.rubbing(store),
    "mesh-places": lambda store, n: mesh_places.figures(store),
    "mesh-directions": lambda store, n: mesh_directions.figures(store),
    "mesh-pairs": lambda store, n: mesh_pairs.figures(),
    "emcee": calibration_emcee.against_emcee,
    "power": calibration_figures.power,
    "misspecified": lambda store, n: calibration_misspecified.figures(store, max(n // 3, 1)),
    "direct": lambda store, n: calibration_direct.figures(store),
    "local": lambda store, n: local_runs.figures(store),
    "fixed": lambda store, n: fixed_runs.figures(store),
}


def main(arguments: list[str] | None = None) -> None:
    """Measure the parts asked for and merge their figures into the file."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.verify_inference", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    parser.add_argument("--n", type=int, default=300, help="virtual experiments of an arm")
    parser.add_argument("--store", type=Path, default=STORE, metavar="DIR")
    parser.add_argument("--out", type=Path, default=OUT, metavar="FILE")
    options = parser.parse_args(arguments)
    for name in options.only:
        print(f"{name}:", flush=True)
        merge(options.out, PARTS[name](options.store, options.n))
    print(f"written to {options.out}")


if __name__ == "__main__":
    main()
