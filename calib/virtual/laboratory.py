"""One laboratory's experiment as files: `experiment.toml`, static frames, a folder a sample."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from calib.virtual.dic_frames import dic_frames
from calib.virtual.front_view import FrontView, grid_spacing, view
from calib.virtual.laboratory_settings import BEFORE_APPROACH, LaboratorySettings
from calib.virtual.machine_files import MACHINE_WRITERS
from calib.virtual.machine_run import MachineRun, run_machine
from calib.virtual.placement import Placement, place
from calib.virtual.point_files import POINT_WRITERS, SYNTHETIC, write_frames
from calib.virtual.truth import TruthResponse
from fe.response import Array

TRUTH_FILE = "truth.json"


@dataclass(frozen=True)
class SampleTruth:
    """What is true of one sample and what no instrument says."""

    name: str
    placement: Placement
    travel: Array
    """(increments,) of the pin in each hold, mm"""
    force_at_rest: Array
    """(increments,) N"""
    contact: float
    """mm by which the pin touches before the steps begin"""
    clock_offset: float
    """s that the cameras' clock is ahead of the machine's"""
    frame_time: Array
    """(increments + 1,) of the frames by the machine's clock, s"""

    def as_json(self) -> dict[str, object]:
        """Values that JSON holds."""
        values = asdict(self)
        plain = ((k, v.tolist() if isinstance(v, np.ndarray) else v) for k, v in values.items())
        return dict(plain)


def make_laboratory(
    folder: Path,
    truth: TruthResponse,
    settings: LaboratorySettings,
    seed: int,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[SampleTruth, ...]:
    """Write a laboratory into the new or empty `folder` and return what is true of it.

    The same truth, settings and seed give the same bytes. Raises ValueError when the folder holds
    something already, and when the truth does not reach the protocol's last travel. Stopped or
    failed, nothing is left in it.
    """
    check_new(folder)
    try:
        return _written(folder, truth, settings, seed, say)
    except BaseException:
        # a part of a laboratory would be taken for one, and be in the way of the next try
        for path in folder.glob("*"):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
        raise


def _written(
    folder: Path,
    truth: TruthResponse,
    settings: LaboratorySettings,
    seed: int,
    say: Callable[[str], None],
) -> tuple[SampleTruth, ...]:
    """All files of a laboratory, `truth.json` last."""
    placing_seed, static_seed, *sample_seeds = np.random.SeedSequence(seed).spawn(
        settings.samples + 2
    )
    placements = place(settings.placing, settings.samples, np.random.default_rng(placing_seed))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "experiment.toml").write_text(experiment_toml(truth, settings), encoding="utf-8")
    _write_static(folder / "static", truth, settings, np.random.default_rng(static_seed))
    width = max(2, len(str(settings.samples)))
    samples = []
    for number, (placement, own) in enumerate(zip(placements, sample_seeds, strict=True), 1):
        name = f"S{number:0{width}d}"
        rng = np.random.default_rng(own)
        samples.append(_write_sample(folder / name, truth, placement, settings, rng))
        say(f"{name} written")
    content = {
        "note": SYNTHETIC,
        "seed": seed,
        "truth": asdict(truth.truth),
        "settings": asdict(settings),
        "samples": [sample.as_json() for sample in samples],
    }
    (folder / TRUTH_FILE).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return tuple(samples)


def check_new(folder: Path) -> None:
    """Raise ValueError where a laboratory cannot be written: something is there already."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(f"{folder}: found something there, expected a new or empty folder")


def _write_sample(
    folder: Path,
    truth: TruthResponse,
    placement: Placement,
    settings: LaboratorySettings,
    rng: np.random.Generator,
) -> SampleTruth:
    cameras, specimen = settings.cameras, truth.truth.specimen
    folder.mkdir()
    run = run_machine(truth, placement.stiffness, settings, rng)
    MACHINE_WRITERS[settings.machine_format](folder / "machine.csv", run, folder.name)
    offset = float(cameras.clock_s * rng.uniform(-1.0, 1.0))
    time = _trigger_times(run, settings, rng)
    seen = view(truth, placement, np.append(0.0, run.travel), cameras)
    spacing = grid_spacing(cameras, specimen.width, specimen.height)
    frames = dic_frames(seen, cameras, spacing, time + offset, rng)
    write_frames(folder / "dic", frames, POINT_WRITERS[cameras.format])
    rows = [f"{number},{at:.2f}" for number, at in enumerate(time + offset, start=1)]
    text = "\n".join([f"# {SYNTHETIC}", "frame,time_s", *rows]) + "\n"
    (folder / "frames.csv").write_text(text, encoding="utf-8")
    return SampleTruth(
        folder.name, placement, run.travel, run.force_at_rest, run.contact, offset, time
    )


def _trigger_times(
    run: MachineRun, settings: LaboratorySettings, rng: np.random.Generator
) -> Array:
    """The reference is taken before the approach, the others in the holds, all by hand."""
    cameras = settings.cameras
    at = np.append(
        run.programme.approach - BEFORE_APPROACH, run.programme.hold_start + cameras.trigger_s
    )
    times: Array = at + cameras.trigger_sd_s * rng.standard_normal(at.size)
    return times


def _write_static(
    folder: Path, truth: TruthResponse, settings: LaboratorySettings, rng: np.random.Generator
) -> None:
    """Frames of a sample at rest: what is measured is noise."""
    cameras, specimen = settings.cameras, truth.truth.specimen
    straight = Placement(0.0, 0.0, 0.0, 0.0, (0.4, -1.1, 2.0), 1.0, "")
    once = view(truth, straight, np.zeros(1), cameras)
    n = cameras.static_frames
    still = FrontView(
        once.position,
        once.material,
        np.repeat(once.displacement, n, axis=0),
        np.repeat(once.seen, n, axis=0),
    )
    spacing = grid_spacing(cameras, specimen.width, specimen.height)
    frames = dic_frames(
        still, cameras, spacing, np.arange(n, dtype=np.float64), rng, first_is_reference=False
    )
    write_frames(folder, frames, POINT_WRITERS[cameras.format])


def experiment_toml(truth: TruthResponse, settings: LaboratorySettings) -> str:
    """What the laboratory would write down of its experiment."""
    specimen, protocol, placing = truth.truth.specimen, settings.protocol, settings.placing
    x, y, z = POINT_WRITERS[settings.cameras.format].axes
    return f"""# {SYNTHETIC}
synthetic = true

[specimen]
width_mm = {specimen.width}
depth_mm = {specimen.depth}
height_mm = {specimen.height}

[protocol]
increment_mm = {protocol.increment_mm}
increments = {protocol.increments}
hold_s = {protocol.hold_s}
preconditioning_cycles = {protocol.preconditioning_cycles}
preconditioning_travel_mm = {protocol.preconditioning_travel_mm}
use = {list(settings.use)}

[machine]
compression_force_sign = -1
compliance_mm_per_N = {settings.machine.compliance_mm_per_N}

[axes]
x = "{x}"
y = "{y}"
z = "{z}"

[quality]
max_angle_deg = {placing.max_angle_deg}
max_x_shift_mm = {placing.max_x_shift_mm}
"""
