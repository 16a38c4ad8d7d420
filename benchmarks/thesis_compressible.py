"""Compressible or not: the stuck bar at several bulk moduli, by forces and largest displacements.

    python -m benchmarks.thesis_compressible --json docs/verification/thesis_compressible.json \\
        [--runs runs/thesis-revisited] [--bulk 5 10 200]

The readings and FE runs of `benchmarks.thesis_revisited`, but no run on a finer mesh: its error is
taken as nominal for all alike, so that a difference between them is the bulk modulus' alone.  Each
reading replaces its own figures in the file.  Units mm, N, MPa.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks.meshes import SAMPLING_CELLS
from benchmarks.run_key import kept_campaign
from benchmarks.thesis_claims import field_claims, implied_maxima, quadrature_of, stiffness
from benchmarks.thesis_hypotheses import (
    NOMINAL_MESH_ERROR,
    READINGS,
    SEED,
    TRAVEL,
    Reading,
    TrainedReading,
    design,
)
from calib.inference import fit_of
from calib.study.artifacts import read_json, write_json
from calib.study.training_runs import training_set
from surrogate import Emulator


def main() -> None:
    """Run what is missing and write the JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=Path, default=Path("runs") / "thesis-revisited")
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--bulk", type=float, nargs="+", default=sorted(bulk_ratios()))
    arguments = parser.parse_args()
    found = read_json(arguments.json) if arguments.json.exists() else {}
    for bulk in arguments.bulk:
        reading = bulk_ratios()[bulk]
        found[reading.name] = figures(reading, arguments.runs)
        print(f"{reading.name}: ln evidence {found[reading.name]['log_evidence'][0]:.2f}")
        write_json(arguments.json, found | {"about": about()})


def bulk_ratios() -> dict[float, Reading]:
    """The stuck bars of 2.5 mm, by the bulk modulus over the shear modulus."""
    bars = [reading for reading in READINGS if reading.mesh == "bar, stick"]
    return {reading.bulk_ratio: reading for reading in bars if reading.height == 2.5}


def about() -> dict[str, Any]:
    """What all readings are held against."""
    return {
        "command": "python -m benchmarks.thesis_compressible",
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "travel_mm": TRAVEL,
        "nominal_mesh_error": NOMINAL_MESH_ERROR,
        "implied_maxima": implied_maxima(),
    }


def figures(reading: Reading, store: Path) -> dict[str, Any]:
    """Evidence, fit and stiffness by the forces, and the largest displacements that go with it."""
    campaign = kept_campaign(
        reading.model(SAMPLING_CELLS[reading.mesh]),
        design(),
        store / reading.folder / "design",
        max_failure_rate=0.34,
    )
    emulator = Emulator.fit(training_set([campaign], gradients=True), SEED)
    entry = TrainedReading(reading, campaign, emulator, None)
    quadrature = quadrature_of(entry)
    fit = fit_of(reading.name, entry.posterior(), quadrature)
    seen = field_claims(entry, quadrature)["seen"]
    return {
        "bulk_ratio": reading.bulk_ratio,
        "n_runs": int(campaign.reached.sum()),
        "log_evidence": [fit.log_evidence, fit.log_evidence_error],
        "predictive_p": fit.p_value,
        "mu_MPa": [fit.mu_mean, fit.mu_sd],
        "ratios_mean": quadrature.mean[1:],
        "ratios_sd": quadrature.sd[1:],
        "stiffness": stiffness(entry, quadrature),
        "maxima_mm": seen["all points"]["mean_mm"],
        "maxima_sd_mm": seen["all points"]["sd_mm"],
        "p_of_maxima": {points: found["p_of_maxima"] for points, found in seen.items()},
    }


if __name__ == "__main__":
    main()
