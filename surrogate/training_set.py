"""What an emulator learns from: complete runs at kappa = 1 MPa, and how many were left out."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class TrainingSet:
    """Runs that reached every travel; forces of the whole sample at kappa = 1 MPa.

    Raises ValueError for arrays of different lengths, values that are not finite, forces that
    are not positive (errors are relative to them) and points that occur twice.
    """

    ratios: Array
    """(n, d) design points"""
    force: Array
    """(n, n_step) force at kappa = 1 MPa, N"""
    displacement: Array | None
    """(n, n_step, n_point, 3) front-face displacement, mm; None without fields"""
    n_excluded: int = 0
    """runs of the design that are not here because they did not reach every travel"""

    def __post_init__(self) -> None:
        n = len(self.ratios)
        for name, n_axes in (("ratios", 2), ("force", 2), ("displacement", 4)):
            value = getattr(self, name)
            if value is None:
                continue
            if value.ndim != n_axes or len(value) != n:
                raise ValueError(f"{name}: expected {n} runs on {n_axes} axes, got {value.shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"{name}: must be finite; leave out runs that were not reached")
        if self.displacement is not None and self.displacement.shape[1] != self.force.shape[1]:
            raise ValueError(
                f"displacement: expected {self.force.shape[1]} steps as in force, "
                f"got {self.displacement.shape[1]}"
            )
        if (self.force <= 0.0).any():
            run, step = np.argwhere(self.force <= 0.0)[0]
            raise ValueError(
                f"force: must be positive (compression), got {self.force[run, step]:.6g} N "
                f"in run {run}, step {step}; leave out the run"
            )
        if len(np.unique(self.ratios, axis=0)) != n:
            raise ValueError("ratios: must differ between runs, found a point twice")

    @classmethod
    def from_runs(
        cls,
        ratios: Array,
        force: Array,
        displacement: Array | None,
        reached: npt.NDArray[np.bool_],
    ) -> TrainingSet:
        """Keep the runs that reached every travel and count the others.

        `ratios` (n, d), `force` (n, n_step) N at kappa = 1 MPa, `displacement` (n, n_step,
        n_point, 3) mm or None, `reached` (n,). Raises ValueError as the class does.
        """
        keep = np.asarray(reached, dtype=bool)
        if keep.shape != (len(ratios),):
            raise ValueError(f"reached: expected {len(ratios)} values, got shape {keep.shape}")
        return cls(
            ratios=np.asarray(ratios, dtype=np.float64)[keep],
            force=np.asarray(force, dtype=np.float64)[keep],
            displacement=(
                None if displacement is None else np.asarray(displacement, dtype=np.float64)[keep]
            ),
            n_excluded=int(np.count_nonzero(~keep)),
        )

    @property
    def fingerprint(self) -> str:
        """SHA-256 (hex) of all numbers and shapes: equal sets, and only they, agree."""
        digest = hashlib.sha256()
        for value in (self.ratios, self.force, self.displacement):
            if value is None:
                digest.update(b"none")
            else:
                digest.update(repr(value.shape).encode())
                digest.update(np.ascontiguousarray(value, dtype="<f8").tobytes())
        return digest.hexdigest()
