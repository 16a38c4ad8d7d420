"""A laboratory's files from closed forms: every number that the analysis should find is known.

Nothing here uses the code that reads the files, but for the writers of softcal's own formats.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib.data.readers import MachineRecord, PointFrame, write_machine, write_points

WIDTH, HEIGHT = 10.0, 2.5
INCREMENT, INCREMENTS, HOLD = 0.2, 4, 4.0
EDGE = 0.1
"""mm from the sample's edge without points"""

EXPERIMENT = f"""
synthetic = true

[protocol]
increment_mm = {INCREMENT}
increments = {INCREMENTS}
hold_s = {HOLD}
preconditioning_cycles = 3
preconditioning_travel_mm = 0.8
use = [2, 3, 4]

[machine]
compliance_mm_per_N = 0.004

[field]
spacing_mm = 0.4
"""


@dataclass(frozen=True)
class Truth:
    """One sample: how it stands and how stiff it is."""

    angle: float = 0.0
    """degrees, dz/dx seen from above"""
    tilt: float = 0.0
    """degrees, dz/dy"""
    roll: float = 0.0
    """degrees in the plane of the face"""
    x_shift: float = 0.0
    """mm, pin from the sample's middle"""
    origin: tuple[float, float, float] = (0.31, -1.17, 2.05)
    """mm, place of our origin in the DIC file"""
    stiffness: float = 1.0
    slack: float = 0.5
    """mm, position of the machine at contact"""
    clock: float = 0.7
    """s, camera's clock ahead of the machine's"""
    noise: float = 0.0
    """mm, independent from point to point"""
    force_noise: float = 0.0
    """N"""
    rigid: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """shift along x [mm], turns about z and y [rad] of the whole sample at full load"""
    outliers: int = 0
    """points a frame with a wild value"""

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) columns are our axes in the DIC file's."""
        turns = [self.tilt, -self.angle, self.roll]
        return Rotation.from_euler("XYZ", turns, degrees=True).as_matrix()


def force_at(travel: np.ndarray, stiffness: float = 1.0) -> np.ndarray:
    """N at rest."""
    depth = np.maximum(np.asarray(travel, dtype=float), 0.0)
    return stiffness * (1.5 * depth + 0.8 * depth**3)


def field_at(points: np.ndarray, travel: float) -> np.ndarray:
    """(n, 3) mm of points (n, 2) in our frame: even and odd about the pin at x = 0."""
    x, y = points.T
    bell = np.exp(-(x**2) / 6.0)
    across = 0.5 * x * np.exp(-(x**2) / 15.0) * (0.4 + y / HEIGHT)
    down = -bell * (y / HEIGHT) ** 2
    out = 0.6 * bell * (0.5 + y * (HEIGHT - y) / HEIGHT**2)
    return np.stack([across, down, out], axis=1) * (travel + 0.2 * travel**2)


def write_laboratory(
    folder: Path,
    truths: dict[str, Truth],
    *,
    text: str = EXPERIMENT,
    static: int = 6,
    seed: int = 1,
) -> Path:
    """Write a laboratory; static frames have the first sample's noise."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True)
    (folder / "experiment.toml").write_text(text)
    for name, truth in truths.items():
        write_sample(folder / name, truth, rng)
    if static:
        still = replace(next(iter(truths.values())), x_shift=0.0, angle=0.0, tilt=0.0, roll=0.0)
        (folder / "static").mkdir()
        for number, frame in enumerate(frames(still, [0.0] * static, rng)):
            write_points(folder / "static" / f"B{number:03d}.csv", frame)
    return folder


def write_sample(folder: Path, truth: Truth, rng: np.random.Generator) -> None:
    (folder / "dic").mkdir(parents=True)
    record, hold_start, travel = machine_record(truth, rng)
    write_machine(folder / "machine.csv", record)
    taken = frames(truth, [0.0, *travel], rng)
    for number, frame in enumerate(taken):
        write_points(folder / "dic" / f"B{number:03d}.csv", frame)
    at = np.concatenate([[hold_start[0] - 6.0], hold_start + 0.6 * HOLD]) + truth.clock
    rows = [f"{number},{time:.3f}" for number, time in enumerate(at)]
    (folder / "frames.csv").write_text("frame,time_s\n" + "\n".join(rows) + "\n")


def machine_record(
    truth: Truth, rng: np.random.Generator, compliance: float = 0.004
) -> tuple[MachineRecord, np.ndarray, np.ndarray]:
    """The record in the signs of Bluehill, starts of the holds, and true travels in them."""
    corners = [(0.0, 0.0)]

    def go(position: float, seconds: float) -> None:
        corners.append((corners[-1][0] + seconds, position))

    go(0.0, 3.0)
    for _ in range(3):
        go(truth.slack + 0.8, 2.6)
        go(0.0, 2.6)
    go(0.0, 4.0)
    go(truth.slack, 1.0)
    go(truth.slack, 2.0)
    holds = []
    for step in range(1, INCREMENTS + 1):
        go(truth.slack + step * INCREMENT, 0.4)
        holds.append(corners[-1][0])
        go(truth.slack + step * INCREMENT, HOLD)
    go(0.0, 2.0)
    go(0.0, 4.0)
    times, places = np.array(corners).T
    time = np.arange(0.0, times[-1], 0.05)
    position = np.interp(time, times, places)
    travel = position - truth.slack
    for _ in range(30):  # the machine gives way under the force
        travel = position - truth.slack - compliance * force_at(travel, truth.stiffness)
    force = force_at(travel, truth.stiffness)
    for start in holds:
        during = time >= start
        excess = 0.05 * force_at(INCREMENT, truth.stiffness)
        force = force + np.where(during & (time < start + HOLD), excess, 0.0) * np.exp(
            -np.maximum(time - start, 0.0) / 0.5
        )
    reading = force + 0.3 + 0.002 * time + truth.force_noise * rng.standard_normal(time.size)
    record = MachineRecord("softcal machine csv", time, -reading, -position, "unknown")
    at = [int(np.searchsorted(time, start + 0.9 * HOLD)) for start in holds]
    return record, np.array(holds), travel[at]


def frames(truth: Truth, travel: list[float], rng: np.random.Generator) -> list[PointFrame]:
    """One frame a travel on a regular grid of the DIC file's x and y, the first the reference."""
    x, y = np.arange(-5.8, 5.8, 0.14), np.arange(-0.5, 3.0, 0.1)
    shape = (y.size, x.size)
    grid = np.stack([g.ravel() for g in np.meshgrid(x, y)], axis=1) + truth.origin[:2]
    axes = truth.rotation
    # the place on the face that is seen at x, y of the file
    places = np.linalg.solve(axes[:2, :2], (grid - truth.origin[:2]).T).T
    position = np.column_stack([places, np.zeros(len(places))]) @ axes.T + truth.origin
    middle = np.abs(places[:, 0] + truth.x_shift) <= WIDTH / 2 - EDGE
    on_face = middle & (places[:, 1] >= EDGE) & (places[:, 1] <= HEIGHT - EDGE)
    found = []
    for number, depth in enumerate(travel):
        moved = field_at(places, depth) + _rigid(places, truth, depth)
        hidden = (np.abs(places[:, 0]) < 2.0) & (places[:, 1] > HEIGHT - 0.2 - 0.2 * depth)
        seen = on_face & ~(hidden & (depth > 0))
        moved = moved + truth.noise * rng.standard_normal(moved.shape)
        wild = rng.choice(np.flatnonzero(seen), truth.outliers, replace=False)
        moved[wild] += 0.4
        moved[~seen] = 0.0
        if number == 0 and len(set(travel)) > 1:
            moved[:] = 0.0  # the reference: all is where it is
        valid = np.ones(len(places), dtype=bool) if number == 0 else seen
        shown = np.where(valid[:, None], moved @ axes.T, 0.0)
        found.append(PointFrame(f"B{number:03d}", position, shown, valid, grid_shape=shape))
    return found


def _rigid(places: np.ndarray, truth: Truth, depth: float) -> np.ndarray:
    share = depth / (INCREMENT * INCREMENTS)
    shift, about_z, about_y = (share * value for value in truth.rigid)
    x, y = places.T
    return np.stack([shift - about_z * y, about_z * x, -about_y * x], axis=1)
