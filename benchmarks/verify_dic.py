"""Measure what docs/verification/dic.json states about image correlation, part by part.

    python -m benchmarks.verify_dic [--only PART ...] [--data DIR] [--peers DIR] [--out FILE]

Parts on synthetic images, whose truth is exact: shift (bias, noise against the Cramer-Rao bound),
sigma (is the stated deviation right, with and without glare), compression (to 60 %). Parts on the
images of the DIC Challenge and others, in the folder of --data or SOFTCAL_DATA: sample5,
sample12, sample14, stretch, strip; of two cameras: plates, static. Two cameras, rendered: stereo
(accuracy), end_to_end (20 posteriors from photographs, some 17 minutes). Part sample14 also runs
the other programs whose environments are in --peers. Each part replaces its own figures in FILE,
leaves the others.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks import (
    dic_challenge,
    dic_synthetic,
    sample14,
    sample14_efficiency,
    sample14_programs,
    verify_stereo,
)
from benchmarks.verify_data import data_folder
from benchmarks.verify_fe import merge

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "docs" / "verification" / "dic.json"


@dataclass(frozen=True)
class Settings:
    """What the parts need from the command line."""

    data: Path
    """folder of the real images, which are no part of softcal"""
    peers: Path
    """folder with an environment of each other program, for sample14: see `benchmarks/dic.py`"""


def sample14_figures(settings: Settings) -> dict[str, Any]:
    """Trade-off of loss and noise by setting, against what is published and other programs."""
    sample = sample14.read_sample(settings.data)
    figures = sample14.by_settings(sample)
    best = figures["order_2_subset_51"]["L5"]
    beside = sample14_programs.programs(sample, settings.data, settings.peers)
    return {
        "sample14_amplitude_error_px": best["amplitude_error_px"],
        "sample14_noise_px": best["noise_px"],
        "sample14": figures,
        "sample14_dice_bound": sample14.dice_bound(sample),
        "sample14_efficiency": sample14_efficiency.efficiency(sample),
        "sample14_interpolation": sample14_efficiency.interpolation(sample),
        # those of an earlier run stay where no other program is installed
        **({"sample14_programs": beside} if beside else {}),
    }


Part = Callable[[Settings], dict[str, Any]]
PARTS: dict[str, Part] = {
    "shift": lambda _: dic_synthetic.shift(),
    "sigma": lambda _: dic_synthetic.sigma(),
    "compression": lambda _: dic_synthetic.compression(),
    "sample5": lambda s: dic_challenge.sample5(s.data),
    "sample12": lambda s: dic_challenge.sample12(s.data),
    "sample14": lambda s: sample14_figures(s),
    "stretch": lambda s: dic_challenge.stretch(s.data),
    "strip": lambda s: dic_challenge.strip(s.data),
    "plates": lambda s: verify_stereo.plates(s.data),
    "static": lambda s: verify_stereo.static(s.data),
    "stereo": lambda _: verify_stereo.accuracy(),
    "end_to_end": lambda _: verify_stereo.end_to_end(ROOT / "runs" / "end_to_end"),
}


def main(arguments: list[str] | None = None) -> None:
    """Measure the parts asked for and merge their figures into the file."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.verify_dic", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    parser.add_argument("--data", type=Path, default=data_folder(), help="folder of real files")
    parser.add_argument("--peers", type=Path, default=ROOT / "runs" / "dic-peers", metavar="DIR")
    parser.add_argument("--out", type=Path, default=OUT, metavar="FILE")
    options = parser.parse_args(arguments)
    for name in options.only:
        start = time.perf_counter()
        figures = PARTS[name](Settings(options.data, options.peers))
        print(f"{name} ({time.perf_counter() - start:.0f} s): {json.dumps(figures)}", flush=True)
        merge(options.out, figures)


if __name__ == "__main__":
    main()
