"""What a reader should see before a number is used, though nothing has failed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.study.population_checks import SAMPLES
from calib.study.predictive_tables import COMPONENTS
from calib.study.tables import number
from calib.study.unknowns import given

if TYPE_CHECKING:
    from calib.data.dataset import Dataset
    from calib.study.config import Study
    from calib.study.sections import Hypothesis

PULLED = 2.5
"""prior SDs of an error of the test beyond which its posterior mean is told: of a right model the
mean is farther out in one of eighty tests at most"""
RARE, LOST = 0.01, 0.5
"""a predictive p-value of a field below the first, and a share of points in their 94 % intervals
below the second, are told where they come together"""
APART = 0.08
"""share by which SDs of chains and of quadrature may differ: 2,000 effective draws leave 0.016"""
FEW = 6
"""samples whose SDs, known to a third or worse, are not taken as known in silence"""


def pulled(nuisances: Sequence[Mapping[str, Any]]) -> list[str]:
    """A sentence for each error of the test that the data move far from what was said of it.

    `nuisances` are those of comparison.json.
    """
    said = []
    for entry in nuisances:
        if abs(entry["mean"]) > PULLED * entry["prior_sd"]:
            unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
            said.append(
                f"the {entry['name']} goes to {number(entry['mean'], 2)}{unit}, "
                f"{abs(entry['mean']) / entry['prior_sd']:.1f} SDs of what was said of it: it may "
                "stand for an error of the model"
            )
    return said


def of_chains(sampling: Mapping[str, Any], quadrature: Mapping[str, Any]) -> list[str]:
    """A sentence for chains that were stopped early, and for SDs that are not those of quadrature.

    `sampling` is how they ended, `quadrature` the moments without them of comparison.json.
    """
    said = []
    if sampling["status"] != "converged":
        said.append(f"its chains were stopped early: {sampling['message']}")
    ratios = np.asarray(quadrature["chains_sd_ratio"], dtype=np.float64)
    worst = int(np.argmax(np.abs(np.log(ratios))))
    if not abs(ratios[worst] - 1.0) < APART:
        said.append(
            f"by its chains the SD of {quadrature['x'][worst]} is {ratios[worst]:.2f} times that "
            "of quadrature: they are too short, or some of their walkers astray"
        )
    return said


def few_samples(study: Study, hypothesis: Hypothesis, dataset: Dataset) -> list[str]:
    """A sentence where the SDs of the forces are of few samples and nothing allows for that."""
    n = dataset.n_samples
    allowed = (
        dataset.force_covariance is not None
        or study.noise.force_freedom is not None
        or given(study, hypothesis, "force_noise") is not None
    )
    if allowed or not 2 <= n <= FEW:
        return []
    error = (2.0 * (n - 1)) ** -0.5
    said = f"the SDs of the forces are of {n} samples and taken as known, where they are to "
    said += f"{error:.0%}: intervals are too narrow"
    errs = study.noise.discrepancy > 0 or given(study, hypothesis, "discrepancy") is not None
    if study.data.level != SAMPLES and not errs:  # else it is refused
        said += f" ([noise] force_freedom = {n - 1}, or a prior of force_noise, allows for it)"
    return [said]


def unlike_forces(found: Mapping[str, Any], hypothesis: str) -> list[str]:
    """A sentence where single forces lie outside what the hypothesis predicts.

    `found` is predictive.json. All forces together may still pass, as their errors have much in
    common.
    """
    checks = found["hypotheses"].get(hypothesis, {}).get("force", ())
    odd = [
        (travel, check["p_value"])
        for travel, check in zip(found["travel"], checks, strict=False)
        if check["p_value"] < RARE and check["coverage"]["0.94"] == 0.0
    ]
    if not odd:
        return []
    places = ", ".join(f"{travel:g} mm (p = {p:.2g})" for travel, p in odd)
    return [f"by itself the force at {places} is not what it predicts"]


def odd_one_out(found: Mapping[str, Any], hypothesis: str) -> list[str]:
    """A sentence where the other forces speak against one of them.

    `found` is predictive.json; of right models one study in a hundred is told so.
    """
    p_values = found["hypotheses"].get(hypothesis, {}).get("force_left_out_p") or ()
    known = [
        (p, travel) for p, travel in zip(p_values, found["travel"], strict=False) if p is not None
    ]
    if not known or not min(known)[0] < RARE / len(known):
        return []
    p, travel = min(known)
    return [
        f"given the other forces, that at {travel:g} mm is not what it predicts (p = {p:.2g}): one "
        "of them may be an outlier, which the constants follow, or the hypothesis wrong"
    ]


def unlike_field(found: Mapping[str, Any], hypothesis: str) -> list[str]:
    """A sentence where parts of the field lie outside what the hypothesis predicts.

    `found` is predictive.json.
    """
    checks = found["hypotheses"].get(hypothesis, {}).get("field", {})
    odd = [
        (check["p_value"], check["coverage"]["0.94"], region, component, travel)
        for region, rows in checks.items()
        for travel, row in zip(found["travel"], rows, strict=True)
        for component, check in zip(COMPONENTS, row, strict=True)
        if check["p_value"] < RARE and check["coverage"]["0.94"] < LOST
    ]
    if not odd:
        return []
    p, share, region, component, travel = min(odd)
    more = f" (and {len(odd) - 1} more of its parts)" if len(odd) > 1 else ""
    return [
        f"the field is not what it predicts: {region}, u_{component} at {travel:g} mm has p = "
        f"{p:.2g} and {share:.0%} of its points within their 94 % intervals{more}; see the report "
        f"and predictive_regions_{hypothesis}.png"
    ]
