"""What an emulator learns from: runs at kappa = 1 MPa, complete or good up to some step."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from surrogate.partial_runs import PartialRuns

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class TrainingSet:
    """Runs that reached every travel; forces of the whole sample at kappa = 1 MPa.

    Raises ValueError for arrays of different lengths, values that are not finite, forces that
    are not positive (errors are relative to them), points that occur twice and runs known in part
    that have other steps, points or factors.
    """

    ratios: Array
    """(n, d) design points"""
    force: Array
    """(n, n_step) force at kappa = 1 MPa, N"""
    displacement: Array | None
    """(n, n_step, n_point, 3) front-face displacement, mm; None without fields"""
    n_excluded: int = 0
    """runs of the design that did not reach every travel, those of `partial` among them"""
    force_gradient: Array | None = None
    """(n, n_step, d) derivative of the force by the ratios, N per unit; None without"""
    displacement_gradient: Array | None = None
    """(n, n_step, n_point, 3, d) derivative of the displacement, mm per unit; None without.

    In both, NaN marks what cannot be used: the derivative of a run by an input teaches nothing
    unless it is finite at all steps and points.
    """
    partial: PartialRuns | None = None
    """runs that are good up to some step"""

    def __post_init__(self) -> None:
        for name in ("ratios", "force", "displacement", "force_gradient", "displacement_gradient"):
            if (given := getattr(self, name)) is not None:  # one fingerprint, one set of numbers
                # in one order in memory, too: sums along another axis round differently
                object.__setattr__(self, name, np.ascontiguousarray(given, dtype=np.float64))
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
                f"at step {step} of the run at ratios {self.ratios[run].tolist()}; leave it out by "
                "`reached`, or its steps from there on by `good`"
            )
        if len(np.unique(self.ratios, axis=0)) != n:
            raise ValueError("ratios: must differ between runs, found a point twice")
        self._check_gradients()
        self._check_partial()

    def _check_partial(self) -> None:
        if self.partial is None:
            return
        early = self.partial
        if early.ratios.shape[1:] != self.ratios.shape[1:]:
            raise ValueError(
                f"partial: expected {self.ratios.shape[1]} ratios a run as of the complete runs, "
                f"got {early.ratios.shape[1]}"
            )
        for name in ("force", "displacement"):
            value, own = getattr(self, name), getattr(early, name)
            shape, found = (None if of is None else of.shape[1:] for of in (value, own))
            if shape != found:
                raise ValueError(
                    f"partial: expected a {name} of {shape} a run as of the complete runs, "
                    f"got {found}"
                )

    def _check_gradients(self) -> None:
        for name in ("force", "displacement"):
            value, gradient = getattr(self, name), getattr(self, f"{name}_gradient")
            if gradient is None:
                continue
            expected = None if value is None else (*value.shape, self.ratios.shape[1])
            if gradient.shape != expected:
                raise ValueError(
                    f"{name}_gradient: expected shape {expected}, found {gradient.shape}"
                )

    @classmethod
    def from_runs(
        cls,
        ratios: Array,
        force: Array,
        displacement: Array | None,
        reached: npt.NDArray[np.bool_],
        *,
        force_gradient: Array | None = None,
        displacement_gradient: Array | None = None,
        smooth: npt.NDArray[np.bool_] | None = None,
        good: npt.NDArray[np.bool_] | None = None,
    ) -> TrainingSet:
        """Keep the runs that reached every travel; count the others, or keep what is good of them.

        `ratios` (n, d), `force` (n, n_step) N at kappa = 1 MPa, `displacement` (n, n_step,
        n_point, 3) mm or None, `reached` (n,); gradients as in the class, see `named_gradient`.
        `smooth` (n,) tells runs with derivatives that hold along the design, not those of an
        unstable equilibrium, from others, whose values alone are used. With `good` (n, n_step) the
        steps at which it holds of runs that ended early are kept as `partial`. Raises ValueError as
        the class does.
        """
        keep = np.asarray(reached, dtype=bool)
        stable = (
            np.ones(len(ratios), dtype=bool) if smooth is None else np.asarray(smooth, dtype=bool)
        )
        if good is not None and np.shape(good) != np.shape(force):
            raise ValueError(f"good: expected shape {np.shape(force)}, got {np.shape(good)}")
        for name, mask in (("reached", keep), ("smooth", stable)):
            if mask.shape != (len(ratios),):
                raise ValueError(f"{name}: expected {len(ratios)} values, got shape {mask.shape}")

        def kept(values: Array | None) -> Array | None:
            return None if values is None else np.asarray(values, dtype=np.float64)[keep]

        def kept_smooth(gradient: Array | None) -> Array | None:
            slopes = kept(gradient)
            if slopes is not None and not stable[keep].all():
                slopes[~stable[keep]] = np.nan
            return slopes

        return cls(
            ratios=np.asarray(ratios, dtype=np.float64)[keep],
            force=np.asarray(force, dtype=np.float64)[keep],
            displacement=kept(displacement),
            n_excluded=int(np.count_nonzero(~keep)),
            force_gradient=kept_smooth(force_gradient),
            displacement_gradient=kept_smooth(displacement_gradient),
            partial=None
            if good is None
            else _partial(
                np.asarray(ratios, dtype=np.float64),
                np.asarray(force, dtype=np.float64),
                None if displacement is None else np.asarray(displacement, dtype=np.float64),
                np.asarray(good, dtype=bool) & ~keep[:, None],
            ),
        )

    def subset(self, rows: npt.NDArray[np.int64] | slice) -> TrainingSet:
        """The complete runs of these rows; those known in part, and their count, are kept."""

        def part(values: Array | None) -> Array | None:
            return None if values is None else values[rows]

        return TrainingSet(
            self.ratios[rows],
            self.force[rows],
            part(self.displacement),
            self.n_excluded,
            part(self.force_gradient),
            part(self.displacement_gradient),
            self.partial,
        )

    @property
    def without_gradients(self) -> TrainingSet:
        """The same runs, values alone."""
        return replace(self, force_gradient=None, displacement_gradient=None)

    @property
    def fingerprint(self) -> str:
        """SHA-256 (hex) of all numbers and shapes trained on: equal ones, and only they, agree."""
        digest = hashlib.sha256()
        for value in (self.ratios, self.force, self.displacement):
            _update(digest, value)
        if self.force_gradient is not None or self.displacement_gradient is not None:
            _update(digest, self.force_gradient)
            _update(digest, self.displacement_gradient)
        if self.partial is not None:
            for value in (self.partial.ratios, self.partial.force, self.partial.displacement):
                _update(digest, value)
        return digest.hexdigest()


def named_gradient(gradient: Array, found: Sequence[str], wanted: Sequence[str]) -> Array:
    """(..., len(wanted)) columns of a gradient (..., len(found)) by name; NaN where there is none.

    Raises ValueError when `found` does not name the columns.
    """
    if gradient.shape[-1] != len(found):
        raise ValueError(
            f"gradient: expected {len(found)} columns ({', '.join(found)}), "
            f"found {gradient.shape[-1]}"
        )
    columns = np.full((*gradient.shape[:-1], len(wanted)), np.nan)
    for place, name in enumerate(wanted):
        if name in found:
            columns[..., place] = gradient[..., list(found).index(name)]
    return columns


def _partial(
    ratios: Array, force: Array, displacement: Array | None, good: npt.NDArray[np.bool_]
) -> PartialRuns | None:
    """What is good (n, n_step) of runs, NaN elsewhere; None where nothing is.

    A step at which the force is not positive is not good, nor are those after it.
    """
    good = good & np.logical_and.accumulate(np.where(np.isfinite(force), force, 1.0) > 0.0, axis=1)
    kept = good.any(axis=1) & ~good.all(axis=1)
    if not kept.any():
        return None
    field = None
    if displacement is not None:
        field = np.where(good[kept, :, None, None], displacement[kept], np.nan)
    return PartialRuns(ratios[kept], np.where(good[kept], force[kept], np.nan), field)


def _update(digest: hashlib._Hash, value: Array | None) -> None:
    if value is None:
        digest.update(b"none")
    else:
        digest.update(repr(value.shape).encode())
        digest.update(np.ascontiguousarray(value, dtype="<f8").tobytes())
