"""The data of one study: mean forces with their spread between samples, and the field if any."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.data.csv_cells import csv_cells, csv_text, positive_number
from calib.data.readers.wrong_file import shown
from fe.response import Array

COLUMNS = ("travel_mm", "force_mean_N", "force_sd_N", "n_samples")


@dataclass(frozen=True)
class FieldData:
    """Displacement of the front face, and what is known of its noise.

    Raises ValueError when shapes disagree, values are not finite or the noise is impossible.
    """

    points: Array
    """(n_point, 2) reference x, y of the points, mm"""
    displacement: Array
    """(n_step, n_point, 3) displacement (x, y, z), mm"""
    noise_std: Array
    """(3,) SD of the noise of each component at one point and increment, mm"""
    correlation_length: float
    """length over which the noise of neighbouring points is correlated, mm"""
    reference_share: float
    """share of the noise variance that the reference image puts on all increments alike, [0, 1)"""
    patterns: Array | None = None
    """(q, n_step, n_point, 3) further errors of known shape, each of one SD, mm: the directions in
    which samples differ, as they enter the error of their mean; None where there are none"""
    nugget: float = 1e-6
    """share of the noise variance that is not correlated between points, (0, 1); the default only
    keeps the correlation of points much closer than the length from being singular"""
    scale_sd: float = 0.0
    """relative SD of the scale of the whole field, by the calibration of the cameras"""
    smoothing: float = 0.0
    """mm, over which the noise is smooth: its correlation is exp(-(sqrt(d^2 + b^2) - b) / length)
    with this b, exp(-d / length) where it is zero (`noise_shape`)"""

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 2:
            raise ValueError(f"points: expected shape (n_point, 2), found {self.points.shape}")
        shape = self.displacement.shape
        if len(shape) != 3 or shape[1:] != (self.points.shape[0], 3):
            expected = f"(n_step, {self.points.shape[0]}, 3)"
            raise ValueError(f"displacement: expected shape {expected}, found {shape}")
        for name in ("points", "displacement"):
            if not np.all(np.isfinite(getattr(self, name))):
                raise ValueError(f"{name}: expected finite values, found NaN or infinity")
        if self.noise_std.shape != (3,) or not np.all(self.noise_std > 0):
            raise ValueError(f"noise_std: expected three positive SDs in mm, got {self.noise_std}")
        if not 0 < self.correlation_length < np.inf:
            raise ValueError(
                f"correlation_length: expected a positive mm value, got {self.correlation_length}"
            )
        if not 0 <= self.reference_share < 1:
            raise ValueError(f"reference_share: expected in [0, 1), got {self.reference_share}")
        if not 0 < self.nugget < 1:
            raise ValueError(f"nugget: expected in (0, 1), got {self.nugget}")
        if not 0 <= self.scale_sd < 1:
            raise ValueError(f"scale_sd: expected in [0, 1), got {self.scale_sd}")
        if not 0 <= self.smoothing < np.inf:
            raise ValueError(f"smoothing: expected 0 mm or more, got {self.smoothing}")
        if self.patterns is not None:
            if self.patterns.ndim != 4 or self.patterns.shape[1:] != shape:
                expected = f"(q, {shape[0]}, {shape[1]}, 3)"
                raise ValueError(
                    f"patterns: expected shape {expected}, found {self.patterns.shape}"
                )
            if not np.all(np.isfinite(self.patterns)):
                raise ValueError("patterns: expected finite values, found NaN or infinity")

    def at_steps(self, steps: list[int]) -> FieldData:
        """The same at some of the steps."""
        patterns = None if self.patterns is None else self.patterns[:, steps]
        return replace(self, displacement=self.displacement[steps], patterns=patterns)


@dataclass(frozen=True)
class SampleData:
    """The samples one by one, for models of what differs between them.

    Raises ValueError when shapes disagree.
    """

    names: tuple[str, ...]
    force: Array
    """(n_sample, n_step) N"""
    displacement: Array
    """(n_sample, n_step, n_point, 3) mm; NaN where a sample has no such point"""
    noise_std: Array | None = None
    """(3,) SD of the noise of one sample's field, mm, where it is known; the correlations are those
    of the mean's, in `FieldData`"""

    def __post_init__(self) -> None:
        if self.force.ndim != 2:
            raise ValueError(f"force: expected (n_sample, n_step) N, found {self.force.shape}")
        n, n_step = self.force.shape
        if len(self.names) != n:
            raise ValueError(f"names: expected {n} as forces, found {len(self.names)}")
        shape = self.displacement.shape
        if len(shape) != 4 or shape[:2] != (n, n_step) or shape[3] != 3:
            raise ValueError(f"displacement: expected ({n}, {n_step}, n_point, 3), found {shape}")
        std = self.noise_std
        if std is not None and (std.shape != (3,) or not np.all(std > 0)):
            raise ValueError(f"noise_std: expected three positive SDs in mm, got {std}")

    def at_steps(self, steps: list[int]) -> SampleData:
        """The same at some of the steps."""
        force, displacement = self.force[:, steps], self.displacement[:, steps]
        return replace(self, force=force, displacement=displacement)


@dataclass(frozen=True)
class Dataset:
    """Mean force of `n_samples` samples at each travel, positive in compression, whole sample.

    `synthetic` is True for data made by a model; it goes into every output.
    Raises ValueError when shapes disagree or a value is impossible.
    """

    name: str
    synthetic: bool
    travel: Array
    """(n_step,) pin travel, increasing, mm"""
    force_mean: Array
    """(n_step,) mean over the samples, N"""
    force_sd: Array
    """(n_step,) standard deviation between the samples, N"""
    n_samples: int
    field: FieldData | None = None
    force_covariance: Array | None = None
    """(n_step, n_step) measured covariance of one sample's forces between samples, N^2; None where
    only the SDs are known"""
    samples: SampleData | None = None
    """the samples one by one; None where only their mean is known"""
    travel_zero_sd: float = 0.0
    """SD of the error that all samples have in common in where the pin touches, mm; what scatters
    between them is in the covariances"""

    def __post_init__(self) -> None:
        if self.travel.ndim != 1 or self.travel.size == 0:
            raise ValueError(f"travel: expected shape (n_step,), found {self.travel.shape}")
        for name in ("travel", "force_mean", "force_sd"):
            values = getattr(self, name)
            if values.shape != self.travel.shape:
                raise ValueError(
                    f"{name}: expected shape {self.travel.shape}, found {values.shape}"
                )
            if not (np.all(np.isfinite(values)) and np.all(values > 0)):
                raise ValueError(f"{name}: expected positive finite values, got {values}")
        if np.any(np.diff(self.travel) <= 0):
            raise ValueError(f"travel: expected increasing values in mm, got {self.travel}")
        if not (self.n_samples >= 1 and self.n_samples == int(self.n_samples)):
            raise ValueError(f"n_samples: expected a whole number from 1, got {self.n_samples}")
        if not 0 <= self.travel_zero_sd < np.inf:
            raise ValueError(f"travel_zero_sd: expected 0 mm or more, got {self.travel_zero_sd}")
        if self.field is not None and self.field.displacement.shape[0] != self.travel.size:
            found = self.field.displacement.shape[0]
            raise ValueError(
                f"field: expected {self.travel.size} steps as in travel, found {found}"
            )
        self._check_covariance()
        samples = self.samples
        if samples is not None and samples.force.shape != (self.n_samples, self.travel.size):
            expected = f"({self.n_samples}, {self.travel.size})"
            raise ValueError(f"samples: expected forces {expected}, found {samples.force.shape}")

    def _check_covariance(self) -> None:
        """A covariance is that of the SDs, and not singular: its inverse weighs the forces."""
        covariance, n = self.force_covariance, self.travel.size
        if covariance is None:
            return
        if covariance.shape != (n, n):
            raise ValueError(f"force_covariance: expected ({n}, {n}), found {covariance.shape}")
        if not np.allclose(np.diag(covariance), self.force_sd**2, rtol=1e-6):
            raise ValueError("force_covariance: expected the squares of force_sd on its diagonal")
        rounding = 1e-9 * float(covariance.diagonal().max())
        if not np.allclose(covariance, covariance.T, rtol=0.0, atol=rounding):
            raise ValueError("force_covariance: expected a symmetric matrix, found one that is not")
        if not np.linalg.eigvalsh(covariance).min() > 0:
            raise ValueError(
                "force_covariance: expected a positive definite matrix, which takes more samples "
                f"than increments; found one that is not, of {self.n_samples} samples"
            )

    def at_steps(self, steps: list[int]) -> Dataset:
        """The same at some of the steps, by their index in increasing order."""
        covariance = self.force_covariance
        return replace(
            self,
            travel=self.travel[steps],
            force_mean=self.force_mean[steps],
            force_sd=self.force_sd[steps],
            field=None if self.field is None else self.field.at_steps(steps),
            force_covariance=None if covariance is None else covariance[np.ix_(steps, steps)],
            samples=None if self.samples is None else self.samples.at_steps(steps),
        )


def read_force_csv(path: Path | str) -> Dataset:
    """Read mean forces from a csv with columns travel_mm, force_mean_N, force_sd_N, n_samples.

    Lines that start with # and empty lines are skipped; further columns are refused. The number
    of samples must be the same on all lines. The dataset takes the file's name.
    Raises ValueError with one sentence naming file, line, column, what was found and expected.
    """
    path = Path(path)
    rows = _rows(path)
    travel, mean, sd, count = (np.array(column) for column in zip(*rows, strict=True))
    try:
        return Dataset(path.stem, False, travel, mean, sd, int(count[0]))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _rows(path: Path) -> list[tuple[float, float, float, float]]:
    """Checked values of every line; at least one."""
    rows: list[tuple[float, float, float, float]] = []
    header: list[str] | None = None
    for number, line in enumerate(csv_text(path).splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = csv_cells(path, number, line)
        if header is None:
            header = _header(path, number, cells)
            continue
        rows.append(_row(path, number, header, cells))
        previous = rows[-2] if len(rows) > 1 else None
        _check_sequence(path, number, previous, rows[-1])
    if not rows:
        if header is not None:
            raise ValueError(f"{path}: found a header alone, expected a line for each travel")
        raise ValueError(f"{path}: found no data, expected the columns {', '.join(COLUMNS)}")
    return rows


def _header(path: Path, number: int, cells: list[str]) -> list[str]:
    if len(cells) == 1 and any(mark in cells[0] for mark in ";\t"):
        raise ValueError(
            f"{path}:{number}: found {shown(cells[0])}, expected commas between the columns (and "
            "decimal points)"
        )
    missing = [name for name in COLUMNS if name not in cells]
    if missing or len(cells) != len(COLUMNS):
        raise ValueError(
            f"{path}:{number}: found columns {shown(', '.join(cells))}, expected "
            f"{', '.join(COLUMNS)}"
        )
    return cells


def _row(
    path: Path, number: int, header: list[str], cells: list[str]
) -> tuple[float, float, float, float]:
    if len(cells) != len(header):
        raise ValueError(f"{path}:{number}: found {len(cells)} values, expected {len(header)}")
    values = {
        name: _number(path, number, name, cell) for name, cell in zip(header, cells, strict=True)
    }
    travel, mean, sd, count = (values[name] for name in COLUMNS)
    return travel, mean, sd, count


def _number(path: Path, number: int, column: str, cell: str) -> float:
    """A positive finite number; a whole one for n_samples."""
    whole = column == "n_samples"
    expected = "a whole number, 2 or more, as an SD needs" if whole else positive_number(cell)
    try:
        value = float(cell)
    except ValueError:
        value = np.nan
    if not (np.isfinite(value) and value > 0) or (whole and (value < 2 or value != int(value))):
        raise ValueError(f"{path}:{number}: {column}: found {shown(cell)}, expected {expected}")
    return value


def _check_sequence(
    path: Path,
    number: int,
    previous: tuple[float, float, float, float] | None,
    current: tuple[float, float, float, float],
) -> None:
    if previous is None:
        return
    if current[0] <= previous[0]:
        raise ValueError(
            f"{path}:{number}: travel_mm: found {current[0]:g}, expected more than {previous[0]:g}"
        )
    if current[3] != previous[3]:
        raise ValueError(
            f"{path}:{number}: n_samples: found {current[3]:g}, expected {previous[3]:g} as above"
        )
