"""Speed of the FE model beside the thesis, FElupe, CalculiX and scikit-fem, in one run.

    python -m benchmarks.fe [--json FILE] [--quick] [--only PART ...]
    python benchmarks/fe.py --json FILE

Prints one table a comparison and writes the figures as JSON.  One process with one thread; compiled
code is warm.  --quick takes tiny meshes to see that everything runs; its figures mean nothing.
--only samples, kernels, codes, thesis or memory leaves the other figures of FILE as they are.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # read when numpy and MKL are loaded
if __name__ == "__main__" and not __package__:
    # as a script, this folder comes first on the path, and this file would be imported as `fe`
    sys.path[0] = str(Path(__file__).resolve().parents[1])

import argparse
import json
import platform
from dataclasses import replace
from typing import Any

from benchmarks import first_order_block, kernel, other_codes, thesis_meshes
from benchmarks.meshes import SAMPLING_CELLS, name_of
from benchmarks.thesis_meshes import TABLE_3_7, TRAVEL, BarRun, press_bar
from benchmarks.timing import median_seconds, peak_memory_gb, peak_memory_of
from fe import BlockPin, BlockPinModel, Contact

BAR_CELLS = ((8, 4, 2), (12, 6, 2), (14, 8, 3), (20, 14, 5))
"""coarse to fine: a study's of a stuck bar is the second, its fitting mesh the last"""
TABLE_N = 20
FIRST_ORDER_N = (5, 10)
"""meshes of the thesis that are pressed here, too; `benchmarks.first_order_block` has the others"""
CONTACTS = {
    "frictionless": Contact("slide", "slide"),
    "friction": Contact(0.3, 0.3),
    "friction 0.1": Contact(0.1, 0.1),
    "stick": Contact("stick", "stick"),
}


SAMPLES = SAMPLING_CELLS | {"bar, friction 0.1": SAMPLING_CELLS["bar, friction"]}
"""design samples that are timed"""


def main(arguments: list[str] | None = None) -> None:
    """Run all comparisons."""
    parser = argparse.ArgumentParser(prog="benchmarks.fe", description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    parser.add_argument("--quick", action="store_true", help="tiny meshes, meaningless figures")
    parts = {part.__name__: part for part in (samples, kernels, codes, thesis, memory)}
    parser.add_argument("--only", nargs="+", choices=parts, default=list(parts), metavar="PART")
    options = parser.parse_args(arguments)
    figures: dict[str, Any] = {}
    if options.json and options.json.exists() and len(options.only) < len(parts):
        figures = json.loads(options.json.read_text())
        if (figures["quick"], figures["machine"]) != (options.quick, machine()):
            parser.error(f"--only: {options.json} is of other meshes or of another machine")
    figures |= {"quick": options.quick, "machine": machine()}
    for name in options.only:
        figures |= parts[name](options.quick)
    if options.quick:
        print("\n--quick: these figures mean nothing")
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2) + "\n")
        print(f"\nwritten to {options.json}")


def machine() -> str:
    """Processor and number of cores, for whoever reads the figures."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores, one thread"


def samples(quick: bool) -> dict[str, Any]:
    """One design sample: five increments on the sampling mesh, sensitivities included."""
    travel = (0.1,) if quick else TRAVEL
    seconds = {}
    print(f"Design sample to {travel[-1]} mm:")
    for case, cells in SAMPLES.items():
        pin, touch = case.split(", ")
        model = BlockPinModel(
            BlockPin(pin="bar" if pin == "bar" else "round"),
            CONTACTS[touch],
            (4, 2, 1) if quick else cells,
            travel,
        )
        run, seconds[case] = median_seconds(lambda m=model: m([0.5, 0.05]), 1 if quick else 3)
        print(
            f"  {case}, {name_of(model.cells)}: {seconds[case]:.2f} s, "
            f"{run.n_factorisations} factorisations, {run.status} at {run.reached:g} mm"
        )
    return {"sample_seconds": max(seconds.values()), "sample_seconds_by_contact": seconds}


def kernels(quick: bool) -> dict[str, Any]:
    """Residual and tangent of one Q2 mesh, against scikit-fem's assembly of the same form."""
    times = kernel.compare(1 if quick else 6, 5)
    speedup = times.skfem_seconds / times.seconds
    print(
        f"\nAssembly of {times.n_elements} Q2 elements: {1e3 * times.seconds:.1f} ms with law, "
        f"pressure and condensation; scikit-fem {1e3 * times.skfem_seconds:.0f} ms, displacement "
        f"part only: {speedup:.0f} times (tangents differ by {times.largest_difference:.0e})"
    )
    return {"kernel_speedup_vs_skfem": speedup}


def codes(quick: bool) -> dict[str, Any]:
    """FElupe and CalculiX on the glued footprint, at equal unknowns."""
    runs = other_codes.compare(quick=quick)
    own = runs[0].run
    print("\n| code | unknowns | s | linear solves | error of the force % | softcal is faster by |")
    print("|---|---|---|---|---|---|")
    table = []
    for entry in runs:
        ratio = entry.run.seconds / own.seconds
        print(
            f"| {entry.run.code} | {entry.run.n_unknowns} | {entry.run.seconds:.2f} "
            f"| {entry.run.n_iterations} | {entry.error_percent:.2f} | {ratio:.1f} |"
        )
        table.append(
            {
                "code": entry.run.code,
                "n_unknowns": entry.run.n_unknowns,
                "seconds": entry.run.seconds,
                "force_error_percent": entry.error_percent,
                "speedup": ratio,
            }
        )
    speedups = {row["code"].split()[0]: row["speedup"] for row in reversed(table)}
    if "CalculiX" not in speedups:
        print("CalculiX (ccx) is not installed: not compared")
    return {
        "speedup_vs_felupe": speedups["FElupe"],  # with softcal's element: the first of its rows
        "speedup_vs_calculix": speedups.get("CalculiX"),
        "codes": table,
    }


def thesis(quick: bool) -> dict[str, Any]:
    """The stuck bar on ever finer meshes, against Table 3.7."""
    cells = ((2, 2, 1), (4, 2, 1)) if quick else BAR_CELLS
    travel = (0.1,) if quick else TRAVEL
    press_bar(cells[0], travel[:1])  # compile
    bars = [press_bar(c, travel) for c in cells]
    measured = (2,) if quick else tuple(n for n in TABLE_3_7 if n <= TABLE_N)
    fine = replace(thesis_meshes.PATCH, cells=(2, 3, 2, 2)) if quick else thesis_meshes.FINE
    theirs, ours = thesis_meshes.footprint_errors(measured, list(cells), fine)
    print(f"\nStuck bar to {travel[-1]} mm; error: force on the glued footprint at 0.1 mm")
    print("| mesh | unknowns | s | factorisations | error % | from our finest, % |")
    print("|---|---|---|---|---|---|")
    for n, seconds in TABLE_3_7.items():
        error = f"{theirs[n]:.2f}" if n in theirs else "not measured"
        unknowns = 3 * (n + 1) * (2 * n + 1) ** 2
        print(f"| thesis, n = {n}, Q1 | about {unknowns} | {seconds:.0f} | not given | {error} | |")
    for bar in bars:
        print(_row(bar, "Q2/P1", f"{ours[bar.cells]:.2f}", bars[-1]))
    first_order_block.press(2, travel=travel[:1])  # compile
    first = [first_order_block.press(n, travel=travel) for n in ((2,) if quick else FIRST_ORDER_N)]
    for bar in first:
        print(_row(bar, "Q1/P0", "", bars[-1]))
    return thesis_figures(bars, theirs, ours) | {
        "first_order_bars": [
            vars(bar) | {"from_finest_percent": bar.from_other_percent(bars[-1])} for bar in first
        ]
    }


def _row(bar: BarRun, element: str, error: str, finest: BarRun) -> str:
    """Of the table; last how far the first and the last force are from those of our finest mesh."""
    off = bar.from_other_percent(finest)
    return (
        f"| {' x '.join(map(str, bar.cells))} {element} | {bar.n_unknowns} | {bar.seconds:.1f} "
        f"| {bar.n_factorisations} | {error} | {off[0]:+.1f} to {off[-1]:+.1f} |"
    )


def thesis_figures(
    bars: list[BarRun], theirs: dict[int, float], ours: dict[tuple[int, int, int], float]
) -> dict[str, Any]:
    """Speed-up at n = 20 by meshes whose error is no larger, and growth of the cost."""
    table_error = theirs[max(theirs)]
    stopped = [bar.cells for bar in bars if any(f != f for f in bar.force)]
    good = [b for b in bars if b.cells not in stopped and ours[b.cells] <= table_error]
    finest = TABLE_3_7[TABLE_N] / good[-1].seconds if good else None
    cheapest = TABLE_3_7[TABLE_N] / min(b.seconds for b in good) if good else None
    exponent = thesis_meshes.cost_exponent(bars)
    if good:
        print(
            f"n = {TABLE_N}: {finest:.0f} times faster on the finest mesh, {cheapest:.0f} times on "
            f"the cheapest with no larger error; cost ~ unknowns^{exponent:.2f}"
        )
    if stopped:
        print(f"did not reach the last travel: {stopped}")
    return {
        "speedup_vs_thesis_n20": finest,
        "speedup_vs_thesis_n20_same_error": cheapest,
        "cost_exponent": exponent,
        "bars": [vars(bar) | {"footprint_error_percent": ours[bar.cells]} for bar in bars],
        "thesis_footprint_error_percent": theirs,
    }


def memory(quick: bool) -> dict[str, Any]:
    """Peak memory of this run, and of an iteration on the nodes of n = 20."""
    code = thesis_meshes.MEMORY_OF_N20
    if quick:
        code = code.replace("(8, 12, 10, 20)", "(1, 1, 1, 1)")
    peak = peak_memory_of(code)
    print(f"\nPeak memory on the nodes of n = {TABLE_N}: {peak:.2f} GB (this run: ", end="")
    print(f"{peak_memory_gb():.2f} GB)")
    return {"peak_memory_gb_n20": peak}


if __name__ == "__main__":
    main()
