"""Measure what docs/verification/data.json states about measured data, part by part.

    python -m benchmarks.verify_data [--only PART ...] [--mutants 10000] [--data DIR] [--out FILE]

Parts: readers (10,000 damaged files a reader, some 20 minutes; and the real files, where
SOFTCAL_DATA or --data names their folder), qc (50 virtual laboratories, some 8 minutes), pipeline
(one of full size: agreement with the truth, and time).  The truth of the last two is simulated
once, in minutes, and kept in runs/laboratory.  Each part replaces its own figures in FILE and
leaves the others.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.laboratory_qc import full_size, over_seeds
from benchmarks.reader_mutants import seeds_of, try_mutants
from benchmarks.sample_field import MM_PER_PX
from benchmarks.verify_fe import merge
from calib.data.readers import (
    DIC_FORMATS,
    MACHINE_FORMATS,
    WrongFile,
    read_dic,
    read_machine,
)
from calib.data.readers.source import Source
from calib.virtual import BlockTruth, solve_truth

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "docs" / "verification" / "data.json"
TRUTH = ROOT / "runs" / "laboratory"
PIPELINE_SEED = 8100
FIRST_SEED = 8000
"""of part qc: on seeds below, estimators, thresholds and the form of the truth were chosen"""
FOLDERS = ("dic_exports", "utm_exports", "ecoflex_compression_cylinders", "stereo_static_pair")
FORMATS = (*DIC_FORMATS, *MACHINE_FORMATS)


@dataclass(frozen=True)
class Settings:
    """What the parts need from the command line."""

    data: Path
    """folder of the real files, which are no part of softcal"""
    mutants: int
    """damaged files a reader"""
    formats: tuple[str, ...]
    """names of the readers to measure"""
    out: Path
    """file of figures; those of other readers in it are kept"""
    seeds: int = 50
    """virtual laboratories"""
    store: Path | None = None
    """folder of what is known of single laboratories, so that an interrupted part goes on"""


def data_folder() -> Path:
    """Folder of the real files: SOFTCAL_DATA, else shared/data beside the project."""
    beside = ROOT.parent / "shared" / "data"
    return Path(os.environ.get("SOFTCAL_DATA", beside))


def real_files(data: Path) -> dict[str, list[Path]]:
    """Real files by the name of the format that recognises them; one format for each file."""
    found: dict[str, list[Path]] = {form.name: [] for form in FORMATS}
    for path in sorted(p for folder in FOLDERS for p in (data / folder).rglob("*") if p.is_file()):
        names = [form.name for form in FORMATS if form.recognises(Source(path))]
        if len(names) > 1:
            raise ValueError(f"{path}: expected one format, recognised as {', '.join(names)}")
        for name in names:
            found[name].append(path)
    return found


def readers(settings: Settings) -> dict[str, Any]:
    """Real files read and refused by each reader, and what became of the damaged ones."""
    files = real_files(settings.data)
    figures: dict[str, Any] = {}
    for form in FORMATS:
        if form.name not in settings.formats:
            continue
        read, refused = _read_all(form.name, files[form.name])
        start = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            seeds = seeds_of(form.name, files[form.name])
            outcome = try_mutants(form.name, seeds, settings.mutants, Path(folder))
        for failure in outcome.failures:
            print(failure, flush=True)
        figures[form.name] = {
            "files_read": read,
            "files_refused": refused,
            "mutants_tried": outcome.mutants_tried,
            "mutants_still_read": outcome.still_read,
            "tracebacks": outcome.tracebacks,
            "slowest_file_s": round(outcome.slowest_s, 3),
            "seconds": round(time.perf_counter() - start, 1),
        }
        print(f"{form.name}: {json.dumps(figures[form.name])}", flush=True)
    known = json.loads(settings.out.read_text()) if settings.out.exists() else {}
    return {"readers": known.get("readers", {}) | figures}


def _read_all(name: str, files: list[Path]) -> tuple[int, int]:
    """How many real files of one format are read, and refused with a sentence."""
    is_dic = name in {form.name for form in DIC_FORMATS}
    refused = 0
    for path in files:
        try:
            read_dic(path, MM_PER_PX) if is_dic else read_machine(path)
        except WrongFile as error:
            print(f"refused: {error}", flush=True)
            refused += 1
    return len(files) - refused, refused


def qc(settings: Settings) -> dict[str, Any]:
    """Who is rejected of 24 samples in each of the virtual laboratories."""
    truth = solve_truth(BlockTruth(), TRUTH)
    seeds = range(FIRST_SEED, FIRST_SEED + settings.seeds)
    return {"qc": over_seeds(truth, seeds, settings.store)}


def pipeline(_: Settings) -> dict[str, Any]:
    """One virtual laboratory of full size."""
    return {"pipeline": full_size(solve_truth(BlockTruth(), TRUTH), PIPELINE_SEED)}


PARTS: dict[str, Callable[[Settings], dict[str, Any]]] = {
    "readers": readers,
    "qc": qc,
    "pipeline": pipeline,
}


def main(arguments: list[str] | None = None) -> None:
    """Measure the parts asked for and merge their figures into the file."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.verify_data", description=__doc__.splitlines()[0]
    )
    names = [form.name for form in FORMATS]
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    parser.add_argument("--mutants", type=int, default=10_000, help="damaged files a reader")
    parser.add_argument("--seeds", type=int, default=50, help="virtual laboratories of part qc")
    parser.add_argument("--store", type=Path, help="folder that part qc goes on from, of one code")
    parser.add_argument("--formats", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--data", type=Path, default=data_folder(), help="folder of real files")
    parser.add_argument("--out", type=Path, default=OUT, metavar="FILE")
    options = parser.parse_args(arguments)
    settings = Settings(
        options.data,
        options.mutants,
        tuple(options.formats),
        options.out,
        options.seeds,
        options.store,
    )
    for name in options.only:
        print(f"{name}:", flush=True)
        merge(options.out, PARTS[name](settings))
    print(f"written to {options.out}")


if __name__ == "__main__":
    main()
