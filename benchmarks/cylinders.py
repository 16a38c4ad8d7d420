"""Ecoflex 00-30: real cylinders calibrated, left-out repeats and another laboratory predicted.

    python -m benchmarks.cylinders [--json FILE] [--figure PNG] [--runs DIR] [--quick]

Five compression tests of one specimen (Dawood et al. 2026, CC BY 4.0, repository
abubakardawood/tissue-phantom-material-database on GitHub) are fitted by the axisymmetric model
under four laws and three contacts at the plates, whose friction is not documented: sliding without
friction, an unknown coefficient of friction, bonded. Every repeat is predicted from the other four.
Then uniaxial tension of the same product by another laboratory (Marechal et al. 2020, doi
10.1089/soro.2019.0115) is predicted and held against its record.

The data are no part of softcal: SOFTCAL_DATA names the folder that holds
ecoflex_compression_cylinders and soft_robotics_tension, else ../shared/data is read.
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cylinder_fit import ENDS, LAWS, Model, fit, predict_left_out, scatter_of
from benchmarks.cylinder_runs import TRAVEL, emulator
from calib.data.readers import read_machine
from calib.inference.box_posterior import BoxSamples
from calib.inference.repeats import Repeats
from calib.study.artifacts import plain
from fe.closed_forms import uniaxial
from fe.materials.material import material
from fe.response import Array

DIAMETER, HEIGHT = 50.0, 30.0  # mm
NOISE_SD = 0.02
"""N, residual of a cubic through one millimetre of the records at 10 Hz"""
LENGTH = 5.0
"""mm of travel over which the discrepancy is correlated, assumption"""
COMMON_ZERO_SD = 0.1
"""mm, assumption: the faces of a cast cylinder touch over about this travel"""
STRETCHES = (1.1, 1.25, 1.5, 2.0)
N_TENSION = 300
SEED = 20261122


def data_folder() -> Path:
    """Where the real files are, or would be."""
    beside = Path(__file__).parents[2] / "shared" / "data"
    return Path(os.environ.get("SOFTCAL_DATA", beside))


def cylinders(folder: Path) -> Repeats:
    """The five repeats at `TRAVEL`, by the reader of machine records."""
    rows = []
    for index in range(1, 6):
        path = folder / "ecoflex_compression_cylinders" / f"EF30_0T_A{index}.csv"
        record = read_machine(path).in_compression()
        assert record.travel is not None  # this format has one
        rows.append(np.interp(TRAVEL, record.travel, record.force))
    return Repeats(np.array(TRAVEL), np.array(rows), NOISE_SD, LENGTH, COMMON_ZERO_SD)


def tension(folder: Path) -> Array:
    """(n,) engineering stress at `STRETCHES` of the other laboratory, MPa."""
    path = folder / "soft_robotics_tension" / "Ecoflex 00-30.csv"
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("Time (s)"))
    rows = np.array([line.split(";")[:5] for line in lines[start + 1 :] if line], dtype=float)
    found: Array = np.interp(np.array(STRETCHES) - 1.0, rows[:, 3], rows[:, 4])
    return found


def published(folder: Path, repeats: Repeats) -> list[dict[str, Any]]:
    """Published fits in the homogeneous formula for which they were made: error by travel."""
    path = folder / "ecoflex_compression_cylinders" / "hyperelastic_parameters.json"
    fits = json.loads(path.read_text())["engineering"]["EF30_0T"]
    named = {
        "neo-Hookean": ("neo-hookean", "Neo Hookean", lambda p: [p[0] / 2.0]),
        "Mooney-Rivlin, 2 constants": ("mooney-rivlin-2", "Mooney Rivlin_o1", list),
        "Mooney-Rivlin with C20": ("mooney-rivlin-c20", "Mooney Rivlin_o2", list),
        "Yeoh": ("yeoh", "Yeoh_o3", list),
    }
    stretch = 1.0 - repeats.travel / HEIGHT
    area = np.pi * DIAMETER**2 / 4.0
    mean = np.exp(repeats.mean)
    rows = []
    for name, (law, key, convert) in named.items():
        constants = [1e-3 * value for value in convert(fits[key]["parameters"])]
        rubber = material(law, constants)
        error = -area * uniaxial(rubber, stretch) / mean - 1.0
        rows.append(
            {
                "law": name,
                "kappa_kPa": 500.0 * rubber.shear_modulus,
                "constants_MPa": constants,
                "relative_error": error,
                "rms_error": float(np.sqrt(np.mean(error**2))),
            }
        )
    return rows


def fitted(model: Model, repeats: Repeats, measured: Array, steps: int) -> dict[str, Any]:
    """Everything that is reported of one law under one contact."""
    streams = np.random.default_rng(SEED).spawn(len(repeats.force) + 2)
    found = fit(model, repeats, streams[0], steps)
    left = [
        predict_left_out(model, repeats, k, streams[1 + k], max(steps // 2, 100))
        for k in range(len(repeats.force))
    ]
    z = np.array([one.z for one in left])
    error = np.array([one.error for one in left])
    return {
        "law": model.law.name,
        "ends": model.ends,
        **_posterior(model, found, repeats),
        "log_evidence": found.log_evidence,
        "log_evidence_sd": found.log_evidence_sd,
        "importance_ess": found.importance_ess,
        "autocorrelation": found.autocorrelation,
        "left_out_log_density": sum(one.log_density for one in left),
        "left_out_rms_error": float(np.sqrt(np.mean(error**2))),
        "left_out_largest_z": float(np.abs(z).max()),
        "left_out_within_94": float(np.mean(np.abs(z) < 1.881)),
        "tension": _tension(model, found.draws, measured, streams[-1]),
    }


def _posterior(model: Model, found: BoxSamples, repeats: Repeats) -> dict[str, Any]:
    x = found.draws
    kappa, scales = 1e3 * np.exp(x[:, 0]), np.array(scatter_of(x)).T
    log_force, _ = model.predict(x[:: max(1, len(x) // 2000)])
    off = np.exp(np.median(log_force, axis=0) - repeats.mean) - 1.0
    facts: dict[str, Any] = {
        "kappa_kPa": [float(kappa.mean()), float(kappa.std())],
        "stiffness_sd": float(np.median(scales[:, 0])),
        "zero_sd_mm": float(np.median(scales[:, 1])),
        "own_sd": float(np.median(scales[:, 2])),
        "discrepancy_sd": float(np.median(scales[:, 3])),
        "misfit": off,
        "rms_misfit": float(np.sqrt(np.mean(off**2))),
    }
    constants = 1e3 * model.constants(x)
    facts["constants_kPa"] = [[float(c.mean()), float(c.std())] for c in constants.T]
    if model.law.name.startswith("Mooney"):
        facts["probability_C01_negative"] = float((constants[:, 1] < 0).mean())
    if model.ends == "friction":
        facts["friction_median_94"] = np.quantile(model.friction(x), [0.5, 0.03, 0.97])
    return facts


def _tension(
    model: Model, draws: Array, measured: Array, rng: np.random.Generator
) -> dict[str, Any]:
    x = draws[rng.choice(len(draws), min(N_TENSION, len(draws)), replace=False)]
    stress = np.array([uniaxial(each, STRETCHES) for each in model.materials(x)])
    low, middle, high = np.quantile(stress, [0.03, 0.5, 0.97], axis=0)
    return {
        "stretch": STRETCHES,
        "measured_kPa": 1e3 * measured,
        "predicted_kPa": 1e3 * middle,
        "low_kPa": 1e3 * low,
        "high_kPa": 1e3 * high,
        "ratio": middle / measured,
    }


def main() -> None:
    """Fit all laws under all contacts, print three tables, write the figures asked for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--json", type=Path, metavar="FILE", help="all numbers")
    parser.add_argument("--figure", type=Path, metavar="PNG", help="misfits and tension")
    parser.add_argument("--runs", type=Path, default=Path("runs") / "cylinders", metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="short chains, one law")
    asked = parser.parse_args()
    folder = data_folder()
    if not (folder / "ecoflex_compression_cylinders").is_dir():
        parser.error(f"found no ecoflex_compression_cylinders in {folder}; set SOFTCAL_DATA")
    facts = run(folder, asked.runs, quick=asked.quick)
    if asked.json is not None:
        asked.json.write_text(json.dumps(plain(facts), indent=2) + "\n")
    if asked.figure is not None:
        from benchmarks.cylinder_figure import cylinder_figure
        from calib.study.figure_style import save_png

        save_png(cylinder_figure(facts), asked.figure)


def run(folder: Path, runs: Path, *, quick: bool = False) -> dict[str, Any]:
    """All numbers; with `quick` Mooney-Rivlin 2 between bonded plates alone, on short chains."""
    from benchmarks.cylinder_tables import print_row, print_tables

    repeats, measured = cylinders(folder), tension(folder)
    laws, ends = (LAWS[1:2], ENDS[2:]) if quick else (LAWS, ENDS)
    models = []
    known: dict[tuple[str, str], Any] = {}
    errors: dict[str, float] = {}
    for law in laws:
        for end in ends:
            contact = "bonded" if end == "bonded" else "friction"
            key = (law.family, contact)
            if key not in known:
                known[key], off = emulator(law.family, contact, runs)
                errors[" ".join(key)] = float(np.sqrt(np.mean(off**2)))
            models.append(Model(law, end, known[key]))
    found = []
    for model in models:
        found.append(fitted(model, repeats, measured, 200 if quick else 1500))
        print_row(found[-1])
    facts = {
        "travel": TRAVEL,
        "force_mean": np.exp(repeats.mean),
        "force_sd_share": np.log(repeats.force).std(axis=0, ddof=1),
        "emulator_rms_error": errors,
        "models": found,
        "published": published(folder, repeats),
    }
    print_tables(facts)
    return facts


if __name__ == "__main__":
    main()
