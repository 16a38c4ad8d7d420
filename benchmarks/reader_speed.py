"""Processor time to read 24 samples of 10 frames of 10,000 points, by format.

    python -m benchmarks.reader_speed [--samples 1]

Files are written to a temporary folder; a folder of ten frames is read `samples` times and the
time scaled to 24.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from calib.data.readers import PointFrame, read_dic, write_points

N_FRAMES, SIDE, N_SAMPLES = 10, 100, 24
N_POINTS = SIDE * SIDE
Rng = np.random.Generator


def _rows(separator: str, *columns: np.ndarray) -> str:
    rows = np.column_stack(columns).tolist()
    return "".join(separator.join(f"{value:.6g}" for value in row) + "\n" for row in rows)


def _field(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.indices((SIDE, SIDE)).reshape(2, -1) * 0.1
    return np.column_stack([x, y, 0 * x]), rng.normal(0, 0.1, (N_POINTS, 3))


def tecplot(path: Path, rng: Rng) -> None:
    """Seven columns."""
    names = [f"{a} [mm]" for a in "xyz"] + [f"{a}-displacement [mm]" for a in "XYZ"] + ["isValid"]
    quoted = ", ".join(f'"{name}"' for name in names)
    head = f'TITLE = "B"\nVARIABLES = {quoted}\nZONE T="0", I={SIDE}, J={SIDE}, F=POINT\n'
    head += "STRANDID=1, SOLUTIONTIME=0\n"
    path.write_text(head + _rows(" ", *_field(rng), np.ones(N_POINTS)))


def davis_csv(path: Path, rng: Rng) -> None:
    """29 columns, as the real files have."""
    names = [f"{a} [mm]" for a in "xyz"] + [f"{a}-displacement [mm]" for a in "XYZ"]
    names += [f"e{n} [S]" for n in range(23)]
    extra = rng.normal(size=(N_POINTS, 23))
    path.write_text(";".join(names) + "\n" + _rows(";", *_field(rng), extra))


def matchid_2023(path: Path, rng: Rng) -> None:
    """Fifteen columns."""
    position, displacement = _field(rng)
    extra = rng.normal(size=(N_POINTS, 7))
    head = "x_pic,y_pic,x,y,z,u,v,w,exx,eyy,exy,e1,e2,gamma,evm\n"
    path.write_text(head + _rows(",", position[:, :2], position, displacement, extra))


def vic3d(path: Path, rng: Rng) -> None:
    """Eight columns."""
    extra = rng.uniform(size=(N_POINTS, 2))
    head = '"X","Y","Z","U","V","W","sigma","exx"\n'
    path.write_text(head + _rows(", ", *_field(rng), extra))


def own(path: Path, rng: Rng) -> None:
    """Seven columns with all digits."""
    position, displacement = _field(rng)
    write_points(path, PointFrame("a", position, displacement, np.ones(N_POINTS, dtype=bool)))


WRITERS: dict[str, Callable[[Path, Rng], None]] = {
    "DaVis Tecplot": tecplot,
    "DaVis csv": davis_csv,
    "MatchID 2023 csv": matchid_2023,
    "VIC-3D csv": vic3d,
    "softcal points csv": own,
}


def seconds(name: str, samples: int) -> float:
    """Processor time of 24 samples in one format."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        for frame in range(N_FRAMES):
            WRITERS[name](Path(folder) / f"B{frame:04d}.txt", rng)
        start = time.process_time()
        for _ in range(samples):
            series = read_dic(folder)
        spent = time.process_time() - start
    if series.format != name or sum(frame.n_valid for frame in series.frames) != 100_000:
        raise RuntimeError(f"{name}: expected ten frames of 10,000 points, read {series.format}")
    return spent * N_SAMPLES / samples


def main() -> None:
    """Print a line for each format."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.reader_speed", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--samples", type=int, default=1, help="samples read, scaled to 24")
    options = parser.parse_args()
    for name in WRITERS:
        print(f"{name}: {seconds(name, options.samples):.1f} s", flush=True)


if __name__ == "__main__":
    main()
