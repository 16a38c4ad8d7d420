"""Rules that a sample has to meet, and which it breaks (thesis, sections 4.3.2 and 5.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from calib.data.qc.experiment_file import Experiment
from calib.data.qc.machine_test import MachineTest
from calib.data.qc.plateaus import SURE, cycle_change_sds, cycle_changes
from calib.data.qc.sample import Sample
from fe.response import Array

POINTS_SHARE = "min_points_share"
ODD_FORCE, ODD_FIELD = 5.0, 2.0
"""times the median of the samples, or less by as much: no scatter of one rubber. What moves at set
travels hardly depends on its stiffness"""
NOISY = 8.0
"""times the usual noise of a hold: a few readings that jump take contact, holds and means along"""
QUIET = 0.002
"""share of the largest force of a hold below which its noise is taken to be that"""
ENOUGH = 15
"""readings of a hold whose noise is known well enough for that"""


class Rejection(NamedTuple):
    """One rule that one sample breaks."""

    sample: str
    rule: str
    """key in [quality] of the experiment file, or what of the protocol was not met"""
    reason: str
    """the rule in words"""
    value: float | str
    threshold: float | str
    unit: str

    def text(self) -> str:
        """One sentence."""
        value, threshold = (_shown(v) for v in (self.value, self.threshold))
        unit = f" {self.unit}" if self.unit else ""
        bound = {"protocol": "", "min_points": "at least ", POINTS_SHARE: "at least "}.get(
            self.rule, "at most "
        )
        return (
            f"{self.sample}: {self.reason}: found {value}{unit}, expected {bound}{threshold}{unit}"
        )


class Rule(NamedTuple):
    """A limit on one figure of a sample."""

    key: str
    reason: str
    unit: str
    limit: float | None
    value: float
    is_least: bool = False
    """whether the limit is the smallest value allowed"""


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"


def placement_rules(sample: Sample, points: int, experiment: Experiment) -> tuple[Rule, ...]:
    """Rules that one sample is judged by alone; `points` is its number of complete points."""
    face, machine, quality = sample.face, sample.machine, experiment.quality
    if face is None or machine is None:
        return ()
    at, steps = face.placement, experiment.protocol.travel
    present = np.isfinite(face.lattice.displacement[1:, ..., 0])
    outliers = float(face.cleaned.is_outlier.sum() / max(int(present.sum()), 1))
    force = np.full(steps.size, np.nan) if sample.force is None else sample.force
    missing = float(np.count_nonzero(~np.isfinite(force)))
    cycles = list(machine.cycles)
    # what noise may be does not reject a sample
    changes = np.maximum(np.abs(cycle_changes(cycles)) - SURE * cycle_change_sds(cycles), 0.0)
    unseen = np.nan if experiment.protocol.preconditioning_cycles > 1 else 0.0
    change = float(changes[-1]) if changes.size else unseen  # two cycles planned and not seen
    return (
        Rule(
            "max_angle_deg",
            "angular deviation",
            "degrees",
            quality.max_angle_deg,
            abs(at.angle_deg),
        ),
        Rule("max_x_shift_mm", "x-shift", "mm", quality.max_x_shift_mm, abs(at.x_shift)),
        Rule("max_tilt_deg", "tilt of the face", "degrees", quality.max_tilt_deg, abs(at.tilt_deg)),
        Rule("max_roll_deg", "roll of the face", "degrees", quality.max_roll_deg, abs(at.roll_deg)),
        Rule(
            "max_slack_mm",
            "travel before contact",
            "mm",
            quality.max_slack_mm,
            abs(machine.contact.travel),
        ),
        Rule(
            "max_cycle_change_percent",
            "change over the last preconditioning cycle, less two SDs of its noise",
            "percent",
            quality.max_cycle_change_percent,
            change,
        ),
        Rule("max_outlier_share", "share of outliers", "", quality.max_outlier_share, outliers),
        Rule("min_points", "complete points", "", quality.min_points, points, is_least=True),
        Rule("increments", "increments without a hold near them", "", 0.0, missing),
        Rule(
            "hold_noise",
            "noise of a hold over the median of all (readings that jump?)",
            "times",
            NOISY,
            _noisiest(machine),
        ),
    )


def _noisiest(machine: MachineTest) -> float:
    """Largest noise of a hold over the median of all, at least `QUIET` of the force; 1 if few read.

    A coarse load cell hardly flickers in most holds.
    """
    time, holds = machine.time, machine.holds
    fewest = min((int(np.sum((time >= h.start) & (time <= h.end))) for h in holds), default=0)
    noise = [plateau.noise_sd for plateau in machine.plateaus]
    if fewest < ENOUGH:
        return 1.0
    largest = max(abs(plateau.force) for plateau in machine.plateaus)
    usual = max(float(np.median(noise)), QUIET * largest)
    return max(noise) / usual if usual > 0.0 else 1.0


def broken(sample: Sample, rules: Sequence[Rule]) -> list[Rejection]:
    """The rules that a sample breaks; a test that did not go as planned breaks the protocol."""
    failure = sample.failure
    if failure is not None:
        value, threshold = failure.found, failure.expected
        return [Rejection(sample.name, "protocol", failure.what, value, threshold, "")]
    found = []
    for rule in rules:
        if rule.limit is None:
            continue
        good = rule.value >= rule.limit if rule.is_least else rule.value <= rule.limit
        if not good:  # NaN is not good either
            found.append(
                Rejection(sample.name, rule.key, rule.reason, rule.value, rule.limit, rule.unit)
            )
    return found


def few_points(
    samples: Sequence[Sample], fields: Array, rejections: Sequence[Rejection], share: float
) -> list[Rejection]:
    """Samples with fewer points than a share of their median, of those that meet all other rules.

    A frame that was cut off leaves them, and would take the rest from the mean of all. fields
    (n_sample, n_step, n, 3), NaN where there is nothing.
    """
    rejected = {one.sample for one in rejections}
    counts = {
        sample.name: int(np.isfinite(field).all(axis=(0, 2)).sum())
        for sample, field in zip(samples, fields, strict=True)
        if sample.name not in rejected
    }
    if len(counts) < 3:  # of two neither is the usual one
        return []
    least = share * float(np.median([*counts.values()]))
    reason = "points of half the face in all frames"
    return [
        Rejection(name, POINTS_SHARE, reason, float(count), least, "")
        for name, count in counts.items()
        if count < least
    ]


def gross(
    samples: Sequence[Sample], fields: Array, rejections: Sequence[Rejection]
) -> list[Rejection]:
    """Samples whose forces or displacements are so many times the others' that a unit is wrong.

    Of those that meet all other rules, from three on; fields (n_sample, n_step, n, 3) mm.
    """
    rejected = {one.sample for one in rejections}
    good = [i for i, one in enumerate(samples) if one.name not in rejected]
    if len(good) < 3:  # of two neither is the usual one
        return []
    found = []
    nothing = np.full(fields.shape[1], np.nan)
    sizes = _rms(fields[good].reshape(len(good), -1))
    forces = _rms(np.array([nothing if (f := samples[i].force) is None else f for i in good]))
    for values, most, what in ((forces, ODD_FORCE, "force"), (sizes, ODD_FIELD, "displacements")):
        if not np.median(values) > 0.0:
            continue
        ratios = values / np.median(values)
        found += [
            Rejection(
                samples[i].name, "protocol", f"{what} over the median of the samples",
                float(f"{ratio:.3g}"), f"{1 / most:.3g} to {most:g} (another unit?)", "",
            )
            for i, ratio in zip(good, ratios, strict=True)
            if not 1.0 / most < ratio < most
        ]  # fmt: skip
    return found


def _rms(values: Array) -> Array:
    """(n,) root mean square of what all of n samples (n, m) have; 0 where that is nothing."""
    both = np.isfinite(values).all(axis=0)
    found: Array = (
        np.sqrt(np.mean(values[:, both] ** 2, axis=1)) if both.any() else np.zeros(len(values))
    )
    return found


def odd_forces(names: Sequence[str], forces: Array, limit: float | None) -> list[Rejection]:
    """Samples whose force lies more than `limit` robust SDs off the median at any increment.

    forces (n_sample, n_step) in N. The robust SD is 1.4826 times the median absolute deviation.
    """
    if limit is None or len(forces) < 3:
        return []
    off = np.abs(forces - np.median(forces, axis=0))
    spread = 1.4826 * np.median(off, axis=0)
    worst = np.max(off / np.where(spread > 0, spread, np.inf), axis=1)
    reason = "force off the median of the samples"
    return [
        Rejection(name, "max_force_deviation", reason, float(value), limit, "robust SDs")
        for name, value in zip(names, worst, strict=True)
        if value > limit
    ]


def eligibility(n_total: int, rejections: Sequence[Rejection]) -> list[tuple[str, int]]:
    """Criteria and numbers of samples, as in thesis Table 5.2; a sample may fail on several."""
    eliminated = len({one.sample for one in rejections})
    reasons = dict.fromkeys(one.reason for one in rejections)
    failing = {
        reason: len({one.sample for one in rejections if one.reason == reason})
        for reason in ("angular deviation", "x-shift", *reasons)
    }
    return [
        ("Total", n_total),
        ("Eliminated", eliminated),
        *((f"Fails on {reason}", number) for reason, number in failing.items()),
        ("Remaining", n_total - eliminated),
    ]
