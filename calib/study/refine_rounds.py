"""Rounds of the stage `refine`: what each chose, and the error that the runs then showed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calib.study.context import Context
from calib.study.sections import Hypothesis
from calib.study.training_runs import rows
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator
from surrogate.refine import STOP_BELOW


class Round(NamedTuple):
    """One look at the posterior and what was chosen by it."""

    n_train: int
    """runs that had trained the emulator"""
    predicted_shift: Array
    """(n,) how far the posterior mean of (ln kappa, r, s, ...) may move, posterior SDs"""
    n_added: int
    """runs chosen"""
    x: tuple[str, ...]
    """coordinates that may move: of the first look, which is by the forces, without the field's"""
    by_processes: Array
    """(n,) the part of the shift that the emulator's processes foretell"""
    by_stated: Array
    """(n,) the part by the errors that the emulator states"""
    by_runs: Array
    """(n,) the part by its errors at runs left out where the posterior is; NaN without any"""
    sd_ratio: Array
    """(n,) SD of the posterior over what it were without the errors stated"""
    box: Array | None
    """(d, 2) where the emulator is known; None: in the prior's box"""
    mass_beyond: float
    """share of the posterior beyond that box"""


@dataclass(frozen=True)
class Loop:
    """What the rounds so far chose for one hypothesis."""

    ratios: Array
    """(k, d) runs added, in the order of choosing"""
    rounds: tuple[Round, ...] = ()
    emulators: tuple[Emulator, ...] = ()
    """by which each round looked"""
    done: bool = False
    """whether the posterior mean has had its last run"""
    box: Array | None = None
    """(d, 2) of the second design, once there is one"""
    n_boxes: int = 0
    """second designs so far"""
    local: tuple[int, ...] = ()
    """rows of `ratios` that belong to second designs"""
    checked: tuple[int, ...] = ()
    """rows of `ratios`, posterior means, that are solved on the finer mesh too"""


def described(
    context: Context, hypothesis: Hypothesis, loop: Loop, added: Campaign
) -> dict[str, object]:
    """The rounds, each with the error of its emulator at the runs that it chose."""
    rounds = []
    first = 0
    for emulator, facts in zip(loop.emulators, loop.rounds, strict=True):
        new = rows(added, slice(first, first + facts.n_added))
        first += facts.n_added
        rounds.append(facts._asdict() | errors_at(emulator, new))
    told = rounds[0]
    known = np.asarray(told["force_error"])[np.isfinite(told["force_error"])]
    if known.size:
        context.echo(
            f"  {hypothesis.name}: at the posterior the first emulator was off by "
            f"{100 * known.max():.2g} % (RMS, worst increment), "
            f"{told['rms_z']:.2g} of its stated SDs"
        )
    if early := added.n_failed:
        context.echo(
            f"  {hypothesis.name}: {early} of the {len(added.theta)} runs added at the posterior "
            "ended before the last increment"
        )
    return {
        "ratios": loop.ratios,
        "local": loop.local,
        "checked": loop.checked,
        "box": loop.box,
        "mass_beyond": loop.rounds[-1].mass_beyond,
        "rounds": rounds,
        "limit": STOP_BELOW,
        "units": {
            "force_error": "relative, RMS over the runs added, by increment",
            "rms_z": "stated SDs",
            "predicted_shift": "posterior SDs of the coordinates x",
        },
    }


def errors_at(emulator: Emulator, runs: Campaign) -> dict[str, Array | float]:
    """Errors of the force at runs that the emulator had not seen; NaN where none got so far."""
    mean, covariance = emulator.unit_force(runs.theta)
    error = np.ma.masked_invalid(mean - runs.force)
    relative = np.ma.masked_invalid(error / runs.force)
    z = error / np.sqrt(np.einsum("nii->ni", covariance))
    return {
        "force_error": np.ma.filled(np.sqrt(np.mean(relative**2, axis=0)), np.nan),
        "rms_z": float(np.ma.filled(np.sqrt(np.mean(z**2)), np.nan)),
    }
