"""Keys of [design] and [noise] that are refused where they would have no effect."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.inference.discrepancy import LENGTH, TRAVEL_LENGTH
from calib.study.unknowns import by_constants, given
from calib.toml_file.refusal import Contradiction

if TYPE_CHECKING:
    from calib.study.config import Study

LENGTHS = {"discrepancy_length": LENGTH, "discrepancy_travel_length": TRAVEL_LENGTH}
"""with their defaults, which are taken for not given: the study kept with results states them"""


def check_used_keys(study: Study) -> None:
    """Raise Contradiction for a value that is used under no hypothesis of the study."""
    _check_ranges(study)
    _check_sizes(study)
    _check_lengths(study)


def _check_ranges(study: Study) -> None:
    """Ranges of ratios go with priors of the constants: other priors have bounds of their own."""
    most = max(len(by_constants(study, hypothesis)) for hypothesis in study.hypotheses)
    for name, needed, last in (("r", 2, "C01"), ("s", 3, "C11")):
        limits = getattr(study.design, name)
        if limits is not None and most < needed:
            expected = f"no such key without [prior.{last}]: it narrows the range of {name} that "
            expected += "priors of the constants leave"
            raise Contradiction(f"design.{name}", limits, expected)


def _check_sizes(study: Study) -> None:
    """What is known of a discrepancy has no prior, at least under one hypothesis."""
    noise = study.noise
    shares = [given(study, hypothesis, "discrepancy") for hypothesis in study.hypotheses]
    if noise.discrepancy > 0 and None not in shares:
        expected = "0 beside [prior.discrepancy], by which the share is unknown"
        raise Contradiction("noise.discrepancy", noise.discrepancy, expected)
    if noise.discrepancy_of_force is None:
        return
    key, found = "noise.discrepancy_of_force", noise.discrepancy_of_force
    if not _has_discrepancy(study):
        expected = (
            "no such key without [prior.discrepancy] or noise.discrepancy, which it multiplies"
        )
        raise Contradiction(key, found, expected)
    users = [
        hypothesis
        for hypothesis, share in zip(study.hypotheses, shares, strict=True)
        if share is not None or noise.discrepancy > 0
    ]
    if all(given(study, user, "discrepancy_of_force") is not None for user in users):
        expected = "no such key beside [prior.discrepancy_of_force], by which it is unknown"
        raise Contradiction(key, found, expected)


def _check_lengths(study: Study) -> None:
    """Lengths are those of a discrepancy, that over the front face of one of a field."""
    for name, default in LENGTHS.items():
        length = getattr(study.noise, name)
        if length == default:
            continue
        if not _has_discrepancy(study):
            expected = "no such key without [prior.discrepancy] or noise.discrepancy"
            raise Contradiction(f"noise.{name}", length, expected)
        if name == "discrepancy_length" and not study.data.has_field:
            expected = "no such key: the data of this study have no field"
            raise Contradiction(f"noise.{name}", length, expected)


def _has_discrepancy(study: Study) -> bool:
    """Whether the model may err under some hypothesis, by a known share or an unknown one."""
    unknown = (given(study, hypothesis, "discrepancy") for hypothesis in study.hypotheses)
    return study.noise.discrepancy > 0 or any(share is not None for share in unknown)
