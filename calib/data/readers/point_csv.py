"""The plain csv of softcal for DIC points, one file a frame; written and read without loss.

    # softcal points 1
    # name: B0001
    # time_s: 12.5
    # grid: 35 24
    # planar: no
    # scale_sd: 0.0002
    # correlation_length_mm: 0.31
    # points: 840
    x_mm,y_mm,z_mm,u_mm,v_mm,w_mm,valid,sigma_u_mm,sigma_v_mm,sigma_w_mm
    0.0,0.1,0.0,0.01,-0.02,0.0,1,0.001,0.001,0.002

time_s, grid, scale_sd (relative SD of all lengths by the calibration), correlation_length_mm (of
exp(-d / length), over which errors of neighbouring points go together) and the three sigma columns
may be left out.  `nan` is a value that is not known.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from calib.data.readers.frames import DicSeries, PointFrame
from calib.data.readers.number_table import Layout, cells, number, read_numbers
from calib.data.readers.source import Source
from calib.data.readers.tagged_head import head_lines, read_head, whole_number
from calib.data.readers.units import LARGEST
from calib.data.readers.wrong_file import WrongFile, shown
from fe.atomic_file import write_text

NAME = "softcal points csv"
MARK = "# softcal points 1"
COLUMNS = ["x_mm", "y_mm", "z_mm", "u_mm", "v_mm", "w_mm", "valid"]
KEYS = {"name", "time_s", "grid", "planar", "scale_sd", "correlation_length_mm", "points"}
SIGMA = ["sigma_u_mm", "sigma_v_mm", "sigma_w_mm"]


def recognises(source: Source) -> bool:
    """Whether the first line is the mark of this format."""
    head = source.first(1)
    return bool(head) and head[0].strip() == MARK


def write_points(path: Path | str, frame: PointFrame) -> None:
    """Write one frame so that `read` gives the same bits."""
    grid = None if frame.grid_shape is None else f"{frame.grid_shape[0]} {frame.grid_shape[1]}"
    head = {
        "name": frame.name,
        "time_s": _exact(frame.time),
        "grid": grid,
        "planar": "yes" if frame.is_planar else "no",
        "scale_sd": _exact(frame.scale_sd),
        "correlation_length_mm": _exact(frame.correlation_length),
        "points": str(frame.valid.size),
    }
    parts = [frame.position, frame.displacement]
    sigma = [] if frame.sigma is None else [frame.sigma]
    rows = np.hstack([*parts, frame.valid[:, None].astype(float), *sigma]).tolist()
    names = COLUMNS + (SIGMA if sigma else [])
    lines = [*head_lines(MARK, head), ",".join(names)]
    for row in rows:
        row[6] = int(row[6])
        lines.append(",".join(map(repr, row)))
    write_text(Path(path), "\n".join(lines) + "\n")


def _exact(value: float | None) -> str | None:
    return None if value is None else repr(float(value))


def read(source: Source, mm_per_px: float | None = None) -> DicSeries:
    """One frame; raises WrongFile for anything else than what `write_points` writes."""
    path = source.path
    head, start = read_head(source, MARK, KEYS)
    layout = Layout(start + 1, ",", cells(source.lines[start], ","))
    if layout.header not in (COLUMNS, COLUMNS + SIGMA):
        expected = f"the columns {','.join(COLUMNS)}, and perhaps {','.join(SIGMA)}"
        raise WrongFile(path, start + 1, expected, shown(source.lines[start]))
    table = read_numbers(source, layout, list(range(len(layout.header))))
    n = whole_number(source, head, "points")
    if n != len(table.lines):
        raise WrongFile(
            path, len(source.lines), f"{n} points as the head says", f"{len(table.lines)}"
        )
    values = table.values
    valid = values[:, 6] == 1
    lengths = values[:, [*range(6), *range(7, values.shape[1])]]
    finite = np.isfinite(lengths)
    wrong = (valid & ~finite[:, :6].all(axis=1)) | (~valid & (values[:, 6] != 0))
    wrong |= (np.abs(lengths) > LARGEST["length"]).any(axis=1) | (values[:, 7:] < 0).any(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        limit = f"{LARGEST['length']:g} mm"
        expected = f"valid 0 or 1, and with 1 finite values below {limit}, no sigma below 0"
        raise WrongFile(path, table.line(row), expected, shown(source.lines[table.line(row) - 1]))
    sigma = values[:, 7:] if len(layout.header) > len(COLUMNS) else None
    time = _time(source, head)
    grid = _grid(source, head, n)
    is_planar = _is_planar(source, head)
    name = head.get("name", ("", 0))[0]
    frame = PointFrame(
        name, values[:, :3], values[:, 3:6], valid, sigma, time, grid, is_planar=is_planar,
        scale_sd=_scale_sd(source, head), correlation_length=_correlation_length(source, head),
    )  # fmt: skip
    return DicSeries(NAME, (frame,))


def _time(source: Source, head: dict[str, tuple[str, int]]) -> float | None:
    if "time_s" not in head:
        return None
    text, line = head["time_s"]
    time = number(source.path, line, "time_s", text)
    if not abs(time) < LARGEST["time"]:
        raise WrongFile(source.path, line, "a finite time_s", shown(text))
    return time


def _scale_sd(source: Source, head: dict[str, tuple[str, int]]) -> float | None:
    if "scale_sd" not in head:
        return None
    text, line = head["scale_sd"]
    scale_sd = number(source.path, line, "scale_sd", text)
    if not 0 <= scale_sd < 1:
        raise WrongFile(source.path, line, "a scale_sd from 0 to below 1", shown(text))
    return scale_sd


def _correlation_length(source: Source, head: dict[str, tuple[str, int]]) -> float | None:
    if "correlation_length_mm" not in head:
        return None
    text, line = head["correlation_length_mm"]
    length = number(source.path, line, "correlation_length_mm", text)
    if not 0 < length < LARGEST["length"]:
        expected = f"a correlation_length_mm above 0 and below {LARGEST['length']:g}"
        raise WrongFile(source.path, line, expected, shown(text))
    return length


def _grid(source: Source, head: dict[str, tuple[str, int]], n: int) -> tuple[int, int] | None:
    if "grid" not in head:
        return None
    text, line = head["grid"]
    match = re.fullmatch(r"(\d{1,9}) (\d{1,9})", text, re.ASCII)
    if match is None or int(match.group(1)) * int(match.group(2)) != n:
        raise WrongFile(source.path, line, f"rows and columns of {n} points in grid", shown(text))
    return int(match.group(1)), int(match.group(2))


def _is_planar(source: Source, head: dict[str, tuple[str, int]]) -> bool:
    text, line = head.get("planar", ("", 1))
    if text not in ("yes", "no"):
        raise WrongFile(source.path, line, "planar: yes or no", shown(text))
    return text == "yes"
