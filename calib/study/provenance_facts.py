"""What the provenance of a posterior says of one hypothesis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calib.inference.coordinates import Space
from calib.study.sample_stage import space_of


def space_in(facts: Mapping[str, Any]) -> Space:
    """What was unknown under a hypothesis, as its provenance says."""
    return space_of(facts["space"]) if "space" in facts else Space()


def truth_in(
    provenance: Mapping[str, Any], hypothesis: str, names: tuple[str, ...]
) -> dict[str, float] | None:
    """Constants behind synthetic data under this hypothesis, where its law has them."""
    truth: dict[str, float] | None = provenance["truth"]
    if truth is None or provenance["truth_hypothesis"] != hypothesis:
        return None
    return truth if set(names) <= set(truth) else None


def maxima_in(
    name: str, facts: Mapping[str, Any]
) -> tuple[float | None, float | None, float | None]:
    """A constant at the maximum by emulator, by FE, and their difference in SDs."""
    maximum = facts["map"]
    return (
        maximum["emulator"][name],
        (maximum["fe"] or {}).get(name),
        (maximum["difference_sd"] or {}).get(name),
    )
