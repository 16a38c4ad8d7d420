"""What is known of the difference of two meshes beside itself: the pin's part, and derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fe.campaign import CampaignFailed
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import named_gradient

FINER, SAMPLING = "finer mesh", "sampling mesh"
REMEDIES = {
    FINER: "change mesh.check, lower mesh.check_stiffening",
    SAMPLING: "change mesh.sampling, narrow the priors of its unknowns",
}
"""against runs that stop, by what they are of; other runs are of the sampling mesh, too"""


@dataclass(frozen=True)
class PinError:
    """What of the difference from the finer mesh's runs is the pin's, which gives way less there.

    Measured on the sampling mesh: the pin's part may be as large as the mesh's, of the other sign,
    and is followed far better, so that a share of their sum would tell of neither. Forces follow
    the penetration, which `stiffening` k divides at every pressure: of c they miss c / k, which is
    c / (k - 1) of the difference. That is corrected for, too, up to a rigid pin.
    """

    stiffening: float
    """how many times less the pin of the finer mesh's runs gives way"""
    signed_force: Array
    """(n_check, n_step) force under the pin of the emulator's runs over that under the other - 1"""
    field: Array
    """(n_check, n_step, n_point, 3) displacement under the one minus that under the other, mm"""

    @property
    def beyond(self) -> float:
        """How far a rigid pin is beyond the finer mesh's, as a share of the difference."""
        return 1.0 / (self.stiffening - 1.0)


@dataclass(frozen=True)
class MeshSlopes:
    """Derivatives of the field's difference between two meshes by the ratios, at each check."""

    field: Array
    """(n_check, n_step, n_point, 3, d) of coarse minus fine displacement under a rigid pin, mm"""
    reach: Array
    """(d,) how far from a check they are followed"""


@dataclass(frozen=True)
class AtCheck:
    """The FE model itself at the last check, corrected to the finer mesh and a rigid pin."""

    tangents: Array
    """(d, n_step, n_point, 3) derivatives of its field by the ratios, mm per unit"""
    field: Array
    """(n_step, n_point, 3) mm"""


def slopes_of(
    fine: Campaign, coarse: Campaign, reach: Array, under: tuple[Campaign, float] | None
) -> MeshSlopes | None:
    """Derivatives of two meshes' difference at each check; None unless all are known and stable.

    Those of an unstable equilibrium need not be those along the ratios. `reach` (d,) is how far
    they are followed; `under` are runs of the coarse mesh under the fine one's pin, and how many
    times less that gives way.
    """
    campaigns = (fine, coarse) if under is None else (fine, coarse, under[0])
    if not all(campaign.stable.all() for campaign in campaigns):
        return None
    names = [parameter.name for parameter in fine.parameters]
    by_fine, by_coarse, *by_stiffer = (
        named_gradient(each.displacement_gradient, each.gradient_parameters, names)
        for each in campaigns
    )
    field = by_coarse - by_fine
    if under is not None:
        field += (by_coarse - by_stiffer[0]) / (under[1] - 1.0)
    return MeshSlopes(field, reach) if np.isfinite(field).all() else None


def unknown_error(name: str, runs: Mapping[str, Campaign]) -> CampaignFailed:
    """The error to raise where no check got through on all meshes: which run stopped first.

    `name` is the hypothesis, `runs` its runs by what they are of, in words.
    """
    mesh, worst = min(
        ((mesh, run) for mesh, own in runs.items() for run in own.responses),
        key=lambda found: found[1].reached,
    )
    n = len(next(iter(runs.values())).theta)
    remedy = REMEDIES.get(mesh, "change mesh.sampling, lower mesh.check_stiffening")
    return CampaignFailed(
        f"{name}: the {mesh} stopped at {worst.reached:.3g} mm ({worst.message}), so the "
        f"discretisation error is unknown; {remedy} or lower the last increment",
        n_failed=n,
        n_done=n,
        n_total=n,
    )
