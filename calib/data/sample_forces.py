"""Forces of samples one by one, from a csv file with one line a sample and travel."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.data.csv_cells import csv_cells, csv_text, positive_number
from calib.data.dataset import Dataset, SampleData
from calib.data.readers.wrong_file import shown
from fe.response import Array

COLUMNS = ("sample", "travel_mm", "force_N")


def has_samples(path: Path | str) -> bool:
    """Whether the first line of a csv file that is no remark names these columns, in any order."""
    path = Path(path)
    try:
        lines = _lines(path)
        return bool(lines) and sorted(csv_cells(path, *lines[0])) == sorted(COLUMNS)
    except ValueError:
        return False


def read_sample_forces(path: Path | str) -> Dataset:
    """Read forces from a csv with the columns sample, travel_mm, force_N; the rest is computed.

    Lines that start with # and empty lines are skipped. All samples are measured at the same
    travels, in any order. The covariance between samples is the measured one where there are two
    samples more than travels, as of an experiment. The dataset takes the file's name.
    Raises ValueError with one sentence naming file, line, what was found and expected.
    """
    path = Path(path)
    forces: dict[str, dict[float, float]] = {}
    lines = _lines(path)
    header = csv_cells(path, *lines[0]) if lines else []
    if sorted(header) != sorted(COLUMNS):
        found = f"columns {shown(', '.join(header))}" if lines else "no line"
        raise ValueError(f"{path}: found {found}, expected {', '.join(COLUMNS)}")
    for number, line in lines[1:]:
        name, travel, force = _row(path, number, header, csv_cells(path, number, line))
        own = forces.setdefault(name, {})
        if travel in own:
            raise ValueError(f"{path}:{number}: found {name} at {travel:g} mm again, expected once")
        own[travel] = force
    if len(forces) < 2:
        raise ValueError(f"{path}: found {len(forces)} samples, expected two or more")
    travels = sorted(next(iter(forces.values())))
    for name, own in forces.items():
        if sorted(own) != travels:
            known = ", ".join(f"{value:g}" for value in travels)
            raise ValueError(f"{path}: {name}: found other travels, expected {known} mm as before")
    _check_different(path, forces)
    array = np.array([[own[travel] for travel in travels] for own in forces.values()])
    try:
        return _dataset(path.stem, tuple(forces), np.array(travels), array)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _check_different(path: Path, forces: dict[str, dict[float, float]]) -> None:
    """Raise ValueError where all samples have one force: they are copies, or of one sample."""
    for travel in next(iter(forces.values())):
        if len({own[travel] for own in forces.values()}) == 1:
            found = f"{next(iter(forces.values()))[travel]:g} N in all samples"
            raise ValueError(
                f"{path}: force_N: found {found} at {travel:g} mm, expected forces that differ"
            )
    first: dict[tuple[tuple[float, float], ...], str] = {}
    for name, own in forces.items():
        if (same := first.setdefault(tuple(sorted(own.items())), name)) != name:
            raise ValueError(
                f"{path}: {name}: found the forces of {same} at all travels, expected its own: a "
                "copy counts as a sample that was never measured"
            )


def _dataset(name: str, names: tuple[str, ...], travel: Array, force: Array) -> Dataset:
    """Mean, covariance and samples of forces (n, n_step), N; no field."""
    n, n_step = force.shape
    covariance = np.atleast_2d(np.cov(force, rowvar=False, ddof=1))
    return Dataset(
        name=name,
        synthetic=False,
        travel=travel,
        force_mean=force.mean(axis=0),
        force_sd=np.sqrt(np.diag(covariance)),
        n_samples=n,
        force_covariance=covariance if n >= n_step + 2 else None,
        samples=SampleData(names, force, np.zeros((n, n_step, 0, 3))),
    )


def _lines(path: Path) -> list[tuple[int, str]]:
    """Numbers and texts of the lines that say something."""
    numbered = enumerate(csv_text(path).splitlines(), start=1)
    return [(n, line) for n, line in numbered if line.strip() and not line.lstrip().startswith("#")]


def _row(path: Path, number: int, header: list[str], cells: list[str]) -> tuple[str, float, float]:
    if len(cells) != len(COLUMNS):
        raise ValueError(
            f"{path}:{number}: found {len(cells)} values, expected {', '.join(COLUMNS)}"
        )
    texts = dict(zip(header, cells, strict=True))
    if not texts["sample"]:
        raise ValueError(f"{path}:{number}: sample: found an empty cell, expected a name")
    values = []
    for column in COLUMNS[1:]:
        cell = texts[column]
        try:
            value = float(cell)
        except ValueError:
            value = np.nan
        if not (np.isfinite(value) and value > 0):
            raise ValueError(
                f"{path}:{number}: {column}: found {shown(cell)}, expected {positive_number(cell)}"
            )
        values.append(value)
    return texts["sample"], values[0], values[1]
