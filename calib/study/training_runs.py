"""What emulators learn from and are judged by: runs of campaigns, with their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fe.campaign import CampaignFailed
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator, TrainingSet, named_gradient

SAME_POINT = 1e-4
"""share of the first campaign's extent within which two runs are one to a Gaussian process"""


@dataclass(frozen=True)
class PartialRuns:
    """Runs that ended before the last increment, held against an emulator as far as they went."""

    ratios: Array
    """(n, d) design points"""
    reached: Array
    """(n,) travel up to which each run is good, mm"""
    relative: Array
    """(n, n_step) emulator over FE force minus one; NaN where the run is not good"""
    standardised: Array
    """(n, n_step) error of the force over its stated SD; NaN likewise"""
    field_rms: Array | None
    """(n, n_step) root mean square error of the field, mm; NaN likewise; None without fields"""


def rows(campaign: Campaign, chosen: slice | Sequence[int] | npt.NDArray[np.int64]) -> Campaign:
    """The part of a campaign that holds these rows."""
    index = np.arange(len(campaign.theta))[chosen]
    return Campaign(
        campaign.theta[index],
        tuple(campaign.responses[i] for i in index),
        n_reused=len(index),
        parameters=campaign.parameters,
    )


def training_set(campaigns: Sequence[Campaign], *, gradients: bool) -> TrainingSet:
    """Runs of all campaigns at kappa = 1 MPa, the complete ones with derivatives by the ratios.

    Derivatives are taken from runs whose equilibria are stable at every travel: those of an
    unstable one need not be those along the design. Of runs closer than `SAME_POINT` the first is
    kept: to a Gaussian process they are the same point, and would make its matrix singular. Runs
    that ended early teach by their values at the travels at which they are good, unless a complete
    run or one of them before is as near or they lie outside the box of the complete runs.
    """
    theta, reached = (
        np.concatenate([getattr(c, name) for c in campaigns]) for name in ("theta", "reached")
    )
    if not campaigns[0].reached.any():
        n = len(campaigns[0].theta)
        raise CampaignFailed(
            f"design: none of its {n} runs reached the last increment, expected 3 or more to train "
            "an emulator on; lower the largest travel, or narrow what the design varies",
            n_failed=n,
            n_done=n,
            n_total=n,
        )
    extent = np.ptp(campaigns[0].theta[campaigns[0].reached], axis=0)
    kept = _distinct(theta, reached, extent)
    parts = zip(campaigns, _split(kept, campaigns), strict=True)
    chosen = [rows(campaign, part) for campaign, part in parts if part]
    slopes: dict[str, Array | None] = {"force_gradient": None, "displacement_gradient": None}
    if gradients:
        names = [parameter.name for parameter in campaigns[0].parameters]
        slopes = {
            which: np.concatenate(
                [named_gradient(getattr(c, which), c.gradient_parameters, names) for c in chosen]
            )
            for which in slopes
        }
    return TrainingSet.from_runs(
        theta[kept],
        np.concatenate([c.force for c in chosen]),
        np.concatenate([c.displacement for c in chosen]),
        reached[kept],
        force_gradient=slopes["force_gradient"],
        displacement_gradient=slopes["displacement_gradient"],
        smooth=np.concatenate([c.stable.all(axis=1) for c in chosen]),
        good=np.concatenate([c.good for c in chosen])
        & _teaches(theta, reached, extent)[kept, None],
    )


def held_out_set(campaign: Campaign) -> TrainingSet | None:
    """Complete runs that judge an emulator; None where no run reached the last increment."""
    found = TrainingSet.from_runs(
        campaign.theta, campaign.force, campaign.displacement, campaign.reached
    )
    return found if len(found.ratios) else None


def partial_runs(emulator: Emulator, campaigns: Sequence[Campaign]) -> PartialRuns:
    """Runs that ended early, with the emulator's error at the travels at which they are good.

    By the emulator as it is without them: up to the travel reached they judge it where complete
    runs leave it to extrapolate.
    """
    emulator = emulator.by_complete_runs
    theta, force, good, reached, travel = (
        np.concatenate(found)
        for found in zip(
            *(
                (c.theta, c.force, c.good, c.reached, [r.reached for r in c.responses])
                for c in campaigns
            ),
            strict=True,
        )
    )
    early = ~reached
    relative, standardised = np.full((2, int(early.sum()), emulator.n_step), np.nan)
    if early.any():
        mean, covariance = emulator.unit_force(theta[early])
        error = mean - force[early]  # NaN where the run is not good
        relative = np.where(good[early], error / force[early], np.nan)
        standardised = np.where(
            good[early], error / np.sqrt(np.einsum("nii->ni", covariance)), np.nan
        )
    return PartialRuns(
        theta[early], travel[early], relative, standardised, _field_rms(emulator, campaigns, early)
    )


def _field_rms(
    emulator: Emulator, campaigns: Sequence[Campaign], early: npt.NDArray[np.bool_]
) -> Array | None:
    if emulator.field is None or not early.any():
        return None
    theta = np.concatenate([c.theta for c in campaigns])[early]
    # NaN where a run is not good
    field = np.concatenate([c.displacement for c in campaigns])[early]
    error = emulator.displacement(theta) - field
    rms: Array = np.sqrt(np.mean(error**2, axis=(2, 3)))
    return rms


def _distinct(theta: Array, reached: npt.NDArray[np.bool_], extent: Array) -> list[int]:
    """Rows that are no repetition of a complete run before them."""
    kept: list[int] = []
    for index, point in enumerate(theta):
        others = theta[[i for i in kept if reached[i]]]
        if not (reached[index] and _near(point, others, extent)):
            kept.append(index)
    return kept


def _teaches(theta: Array, reached: npt.NDArray[np.bool_], extent: Array) -> npt.NDArray[np.bool_]:
    """(n,) complete runs, and early ones that repeat neither these nor an early one before."""
    teaches = reached.copy()
    for index in np.flatnonzero(~reached):
        teaches[index] = not _near(theta[index], theta[teaches], extent)
    return teaches


def _near(point: Array, others: Array, extent: Array) -> bool:
    """Whether one of the others (n, d) is the same point to a Gaussian process."""
    return bool((np.abs(others - point) <= SAME_POINT * extent).all(axis=1).any())


def _split(kept: Sequence[int], campaigns: Sequence[Campaign]) -> list[list[int]]:
    """Rows of all campaigns together as rows of each."""
    first = np.cumsum([0, *(len(c.theta) for c in campaigns)])
    return [
        [index - int(low) for index in kept if low <= index < high] for low, high in pairwise(first)
    ]
