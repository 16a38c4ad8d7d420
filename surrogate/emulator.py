"""Emulator of force and front-face field over the ratios (r, s), at kappa = 1 MPa."""

from __future__ import annotations

from dataclasses import dataclass, replace
from numbers import Integral
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from surrogate.emulator_file import Header, read_arrays, write_arrays
from surrogate.field_prediction import FieldPrediction, Wanted, compress, select
from surrogate.force_scale import ForceScale, choose_scale
from surrogate.gp import Array
from surrogate.gp_fit import Sharing, at_bounds, too_few
from surrogate.modal import ModalEmulator, fit_modal, modal_from_arrays, modal_to_arrays
from surrogate.partial_runs import PartialRuns, taught
from surrogate.training_set import TrainingSet

FIELD_TOLERANCE = 1e-4
"""Share of the field's variation (root mean square) that its modes may leave out"""
FEWEST_RUNS = 3
MAX_FIELD_MODES = 28


@dataclass(frozen=True)
class Emulator:
    """Predictions of a new FE run at ratios x (m, d), each with the emulator's own uncertainty.

    The force is emulated itself or by its logarithm, whichever makes the training forces more
    probable. Each step is divided by its mean training force, so that the small forces of the first
    steps count as much as the large ones of the last; all modes are kept. The field keeps few: what
    they leave out is described by `field_truncation_std` (or in full by `field_truncation_factor`)
    and is not part of the weights' variance. Field values are flattened in the order (step, point,
    component).
    """

    force: ModalEmulator
    """force at kappa = 1 MPa on its scale, n_obs = n_step"""
    force_scale: ForceScale
    field: ModalEmulator | None
    """displacement [mm], n_obs = n_step * n_point * 3; None when trained on forces only"""
    field_shape: tuple[int, int, int] | None
    """(n_step, n_point, 3)"""
    header: Header

    def __post_init__(self) -> None:
        mean = self.force_scale.mean
        if mean.shape != (self.n_step,) or not ((mean > 0.0) & np.isfinite(mean)).all():
            raise ValueError(f"force_scale: expected {self.n_step} positive forces, got {mean}")
        if (self.field is None) != (self.field_shape is None):
            raise ValueError("field_shape: must be given with a field and only with one")
        if self.field is not None and self.field_shape is not None:
            n_obs = len(self.field.pod.offset)
            if n_obs != np.prod(self.field_shape):
                raise ValueError(f"field_shape: {self.field_shape} does not hold {n_obs} values")

    @classmethod
    def fit(
        cls,
        training_set: TrainingSet,
        seed: int,
        *,
        n_restarts: int = 1,
        sharing: Sharing = "auto",
        field_tolerance: float = FIELD_TOLERANCE,
    ) -> Emulator:
        """Fit to the training runs; the same set and seed give the same bits.

        Derivatives that the training set holds are used; `training_set.without_gradients` fits to
        the values alone. `field_tolerance` is the share of the fields' scatter that their modes may
        leave out. See `fit_processes` for the other arguments.
        Raises ValueError for fewer than 3 runs, inputs, forces or fields that do not vary, a
        tolerance or a number of restarts below 0.
        """
        if not (isinstance(n_restarts, Integral) and n_restarts >= 0):
            raise ValueError(
                f"n_restarts: expected a whole number of 0 or more, found {n_restarts!r}"
            )
        if not field_tolerance >= 0.0:
            raise ValueError(f"field_tolerance: expected 0 or more, found {field_tolerance}")
        _check_varied(training_set)
        x, displacement = training_set.ratios, training_set.displacement
        # One thread: sums in another order would change last bits, and the matrices are small.
        with threadpool_limits(limits=1):
            force, scale = _fit_force(training_set, seed, n_restarts, sharing)
            field = None
            if displacement is not None:
                slopes = training_set.displacement_gradient
                field = fit_modal(
                    x,
                    displacement.reshape(len(x), -1),
                    seed,
                    slopes=None if slopes is None else slopes.reshape(len(x), -1, x.shape[1]),
                    tolerance=field_tolerance,
                    max_modes=MAX_FIELD_MODES,
                    n_restarts=n_restarts,
                    sharing=sharing,
                    n_step=displacement.shape[1],
                )
            if training_set.partial is not None:
                force, field = _taught(training_set.partial, force, scale, field)
        header = Header(training_set.fingerprint, seed, len(x), training_set.n_excluded)
        return cls(force, scale, field, _field_shape(displacement), header)

    def save(self, path: str | Path) -> None:
        """Write one npz file with a JSON header, atomically."""
        arrays = modal_to_arrays(self.force, "force_") | {
            "scale": self.force_scale.mean,
            "log": np.array(float(self.force_scale.log)),
        }
        if self.field is not None and self.field_shape is not None:
            arrays |= modal_to_arrays(self.field, "field_")
            arrays["shape"] = np.array(self.field_shape, dtype=np.float64)
        write_arrays(Path(path), self.header, arrays)

    @classmethod
    def load(cls, path: str | Path, fingerprint: str | None = None) -> Emulator:
        """Read what `save` wrote; predictions are the same bit for bit.

        Raises ValueError naming the file when it is damaged, of another version, or, with a
        `fingerprint`, trained on another `TrainingSet` than the one of this fingerprint.
        """
        header, arrays = read_arrays(Path(path), fingerprint)
        shape = arrays.pop("shape", None)
        try:
            scale = ForceScale(arrays.pop("scale"), bool(arrays.pop("log")))
            force = modal_from_arrays(arrays, "force_")
            if shape is None:
                return cls(force, scale, None, None, header)
            n_step, n_point, n_dim = (int(value) for value in shape)
            field = modal_from_arrays(arrays, "field_")
            return cls(force, scale, field, (n_step, n_point, n_dim), header)
        except (KeyError, ValueError, IndexError, TypeError) as error:
            raise ValueError(f"{path}: not a complete emulator ({error}); train again") from error

    @property
    def by_complete_runs(self) -> Emulator:
        """The emulator as complete runs alone make it: those known in part can judge this one."""
        force = replace(self.force, processes=self.force.processes.without_further)
        field = self.field
        if field is not None:
            field = replace(field, processes=field.processes.without_further)
        return replace(self, force=force, field=field)

    @property
    def n_step(self) -> int:
        """Number of travels."""
        return len(self.force.pod.offset)

    @property
    def bounds(self) -> Array:
        """(d, 2) box of the training points; outside it the emulator extrapolates."""
        low = self.force.processes.low
        return np.column_stack([low, low + self.force.processes.span])

    def unit_force(self, ratios: Array) -> tuple[Array, Array]:
        """Mean (m, n_step) N and covariance (m, n_step, n_step) N^2 of the force at 1 MPa.

        On a logarithmic scale the mean is the median (see `ForceScale.force`). On the other nothing
        keeps it positive where the emulator is bad or extrapolates: check it before taking its
        logarithm.
        """
        return self.force_scale.force(*self.force.predict(self._checked(ratios)))

    def unit_force_gradient(self, ratios: Array) -> Array:
        """(m, n_step, d) derivative of the mean force at 1 MPa by the ratios, N."""
        ratios = self._checked(ratios)
        mean = self.force.pod.reconstruct(self.force.processes.mean(ratios))
        return self.force_scale.gradient(mean, self.force.gradient(ratios))

    def unit_force_leave_one_out(self) -> tuple[Array, Array]:
        """As `unit_force` at each training point given the other runs only."""
        return self.force_scale.force(*self.force.leave_one_out())

    def field_weights(self, ratios: Array) -> tuple[Array, Array]:
        """Mean (m, k) and variance (m, k) of the weights of the field's modes, mm and mm^2."""
        return self._modal_field.processes.predict(self._checked(ratios))

    def field_weights_gradient(self, ratios: Array) -> Array:
        """(m, k, d) derivative of the mean weights by the ratios, mm."""
        return self._modal_field.processes.gradient(self._checked(ratios))

    def displacement(self, ratios: Array) -> Array:
        """(m, n_step, n_point, 3) mean displacement of the front face, mm."""
        mean, _ = self.field_weights(ratios)
        return self._modal_field.pod.reconstruct(mean).reshape(len(mean), *self._shape)

    def predict_field(
        self,
        ratios: Array,
        *,
        steps: Wanted | None = None,
        points: Wanted | None = None,
        n_truncation: int = 8,
    ) -> FieldPrediction:
        """Mean and covariance of a new run's field at some steps and points (default: all).

        Steps and points by their places or by a mask of all of them, else ValueError is raised.
        The covariance is that of the modes' weights, exactly, plus that of what they leave out, of
        which `n_truncation` directions are kept with their correlations and the rest as variances.
        Memory is linear in the number of points.
        """
        mean, variance = self.field_weights(ratios)
        pod, kept = self._modal_field.pod, select(self._shape, steps, points)
        factor, rest = compress(pod.truncation_factor[kept.rows], n_truncation)
        return FieldPrediction(
            shape=kept.shape,
            mean=(pod.offset[kept.rows] + mean @ pod.modes[kept.rows].T).reshape(-1, *kept.shape),
            modes=pod.modes[kept.rows],
            weight_variance=variance,
            truncation=factor,
            rest=rest,
        )

    @property
    def notes(self) -> list[str]:
        """What makes a fit doubtful, one sentence each: too few runs, a bound of its search met."""
        parts = {"force": self.force, "field": self.field}
        return [
            f"{name} emulator: {what}"
            for name, part in parts.items()
            if part is not None
            for what in [*too_few(part.processes), *at_bounds(part.processes)]
        ]

    @property
    def field_offset(self) -> Array:
        """(n_obs,) field of zero weights, mm."""
        return self._modal_field.pod.offset

    @property
    def field_modes(self) -> Array:
        """(n_obs, k) modes of the field, per unit of their weights."""
        return self._modal_field.pod.modes

    @property
    def field_truncation_std(self) -> Array:
        """(n_step, 3) root mean square over points of what the modes leave out, mm."""
        variance = self._modal_field.pod.truncation_variance.reshape(self._shape)
        std: Array = np.sqrt(variance.mean(axis=1))
        return std

    @property
    def field_truncation_factor(self) -> Array:
        """(n_obs, n) factor L of the covariance L @ L.T of what the modes leave out, mm."""
        return self._modal_field.pod.truncation_factor

    @property
    def _modal_field(self) -> ModalEmulator:
        if self.field is None:
            raise ValueError("emulator: was trained on forces only; train it with displacements")
        return self.field

    @property
    def _shape(self) -> tuple[int, int, int]:
        assert self.field_shape is not None
        return self.field_shape

    def _checked(self, ratios: Array) -> Array:
        ratios = np.asarray(ratios, dtype=np.float64)
        d = len(self.force.processes.low)
        if ratios.ndim != 2 or ratios.shape[1] != d:
            raise ValueError(f"ratios: expected shape (m, {d}), got {ratios.shape}")
        return ratios


def _taught(
    runs: PartialRuns, force: ModalEmulator, scale: ForceScale, field: ModalEmulator | None
) -> tuple[ModalEmulator, ModalEmulator | None]:
    """Both conditioned on runs that are good up to some step."""
    force = taught(force, runs.ratios, scale.values(runs.force))
    if field is not None and runs.displacement is not None:
        field = taught(field, runs.ratios, runs.displacement.reshape(len(runs.ratios), -1))
    return force, field


def _field_shape(displacement: Array | None) -> tuple[int, int, int] | None:
    if displacement is None:
        return None
    _, n_step, n_point, n_dim = displacement.shape
    return n_step, n_point, n_dim


def _check_varied(training_set: TrainingSet) -> None:
    """Raise ValueError where there is nothing to learn."""
    x = training_set.ratios
    if len(x) < FEWEST_RUNS:
        raise ValueError(f"training_set: expected {FEWEST_RUNS} runs or more, found {len(x)}")
    for column, extent in enumerate(np.ptp(x, axis=0)):
        if not extent > 0.0:
            raise ValueError(
                f"training_set: expected inputs that vary, found input {column + 1} of "
                f"{x.shape[1]} at {x[0, column]:g} in all runs"
            )
    for name, values in (("forces", training_set.force), ("fields", training_set.displacement)):
        if values is not None and not np.ptp(values, axis=0).any():
            raise ValueError(f"training_set: expected {name} that vary, found the same in all runs")


def _fit_force(
    runs: TrainingSet, seed: int, n_restarts: int, sharing: Sharing
) -> tuple[ModalEmulator, ForceScale]:
    scale, chosen = choose_scale(runs.ratios, runs.force, runs.force_gradient)
    slopes = None
    if runs.force_gradient is not None:
        slopes = scale.slopes(runs.force, runs.force_gradient)
    y = scale.values(runs.force)
    modal = fit_modal(
        runs.ratios,
        y,
        seed,
        slopes=slopes,
        n_restarts=n_restarts,
        sharing=sharing,
        chosen=chosen,
        max_modes=y.shape[1],
        n_step=y.shape[1],
    )
    return modal, scale
