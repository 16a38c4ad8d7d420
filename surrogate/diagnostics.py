"""How good an emulator is, judged by its errors on runs it has not seen."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from surrogate.emulator import Emulator
from surrogate.gp import Array
from surrogate.residuals import Errors, held_out_residuals, leave_one_out_residuals
from surrogate.run_scale import RunScales
from surrogate.training_set import TrainingSet


@dataclass(frozen=True)
class EmulatorDiagnostics:
    """Errors on held-out runs (if there are any) and by leaving out each training run in turn."""

    n_train: int
    n_excluded: int
    """runs of the training design that did not reach every travel"""
    n_held_out_excluded: int
    """held-out runs that did not reach every travel"""
    n_field_modes: int
    field_truncation_std: tuple[tuple[float, ...], ...] | None
    """(n_step, 3) what the field's modes leave out, mm"""
    leave_one_out: Errors
    """closed form: hyperparameters and modes are those of all runs"""
    held_out: Errors | None
    notes: tuple[str, ...] = ()
    """hyperparameters at a bound of their search"""
    scales: RunScales = RunScales()  # noqa: RUF009 - immutable
    """of whole runs' errors, told by runs left out: they widen joint regions of held-out ones"""

    @property
    def judged(self) -> Errors:
        """The errors by which the emulator is judged: of held-out runs if there are any."""
        return self.leave_one_out if self.held_out is None else self.held_out

    def to_dict(self) -> dict[str, object]:
        """Values for JSON."""
        return asdict(self)

    def within(
        self, tolerance_force: float, tolerance_field: float | None, max_rms_z: float
    ) -> list[str]:
        """Rules that are violated, one sentence each; an empty list if the emulator is good.

        `tolerance_force` bounds the relative RMS force error at every step, `tolerance_field` the
        RMS displacement error [mm] at every step, `max_rms_z` the RMS of standardised errors.
        Where `tolerance_field` is None nothing rests on the field, and no rule is about it.
        """
        errors = self.judged
        source = "leave-one-out" if self.held_out is None else "held-out"
        rules = [
            ("force error (relative RMS, worst step)", max(errors.force_rms), tolerance_force),
            ("force error over its predicted SD (RMS z)", errors.force_rms_z, max_rms_z),
        ]
        if (
            tolerance_field is not None
            and errors.field_rms is not None
            and errors.field_rms_z is not None
        ):
            rules += [
                ("field error (RMS in mm, worst step)", max(errors.field_rms), tolerance_field),
                ("field error over its predicted SD", errors.field_rms_z, max_rms_z),
            ]
        return [
            f"emulator: {source} {what} is {value:.3g}, above {limit:.3g}"
            for what, value, limit in rules
            if not value <= limit
        ]


def diagnose(
    emulator: Emulator, training_set: TrainingSet, held_out: TrainingSet | None = None
) -> EmulatorDiagnostics:
    """Measure an emulator on the runs it was trained on, left out in turn, and on held-out runs.

    Raises ValueError when `training_set` is not the one of the emulator, or `held_out` is empty, of
    other steps or points, or has points of the training set.
    """
    if training_set.fingerprint != emulator.header.fingerprint:
        raise ValueError("training_set: is not the one the emulator was trained on; train again")
    if held_out is not None:
        if not len(held_out.ratios):
            raise ValueError("held_out: no run reached every travel; pass None or more runs")
        _check_apart(held_out.ratios, training_set.ratios)
    truncation = None
    if emulator.field is not None:
        truncation = tuple(tuple(row) for row in emulator.field_truncation_std.tolist())
    left_out = leave_one_out_residuals(emulator, training_set)
    return EmulatorDiagnostics(
        n_train=len(training_set.ratios),
        n_excluded=training_set.n_excluded,
        n_held_out_excluded=0 if held_out is None else held_out.n_excluded,
        n_field_modes=0 if emulator.field is None else emulator.field_modes.shape[1],
        field_truncation_std=truncation,
        leave_one_out=left_out.errors(),
        held_out=None
        if held_out is None
        else held_out_residuals(emulator, held_out, left_out.told_scales).errors(),
        scales=left_out.told_scales,
        notes=tuple(emulator.notes),
    )


def _check_apart(held_out: Array, trained: Array) -> None:
    """Raise ValueError where rows (n, d) of both are the same."""
    if held_out.shape[1:] == trained.shape[1:]:
        same = (held_out[:, None] == trained[None]).all(axis=2).any(axis=1)
        if same.any():
            raise ValueError(
                f"held_out: expected runs that took no part in training, {same.sum()} did"
            )
