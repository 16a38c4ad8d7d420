"""Images that cannot be correlated whatever the settings, and series in which nothing was found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from calib.dic import Correlation, GreyImage
from calib.dic.prepared import BoolArray

MOST_SATURATED = 0.5
LEAST_SPREAD = 0.005
"""of full scale: an image without any speckle"""
LEAST_ALIKE = 0.5
"""correlation of two images of a still scene; noise of a tenth of the contrast leaves 0.99"""

WEAK = 0.9
"""median correlation below which stated deviations, of first order in the noise, are too small"""
VERY_WEAK = 0.85
"""the same, from which on they are by more than a third"""


def check_exposure(image: GreyImage, mask: BoolArray) -> None:
    """Raises ValueError for an image that is saturated or without speckle in `mask` (h, w)."""
    if fault := _fault(image, mask, "the region"):
        raise ValueError(f"{image.name}: {fault}")


def check_whole(image: GreyImage) -> None:
    """Raises ValueError for an image that is saturated or without speckle, most of it."""
    if fault := _fault(image, np.ones(image.grey.shape, dtype=np.bool_), "the image"):
        raise ValueError(f"{image.name}: {fault}")


def check_speckle(image: GreyImage) -> None:
    """Raises ValueError for an image without any speckle, of which a part will be looked for."""
    everywhere = np.ones(image.grey.shape, dtype=np.bool_)
    if fault := _too_even(image, everywhere, "the image"):
        raise ValueError(f"{image.name}: {fault}")


def check_repeat(repeat: GreyImage, reference: GreyImage, mask: BoolArray) -> None:
    """Raises ValueError for an image of noise that does not show the reference's scene."""
    check_exposure(repeat, mask)
    alike = float(np.corrcoef(repeat.grey[mask], reference.grey[mask])[0, 1])
    if alike < LEAST_ALIKE:
        raise ValueError(
            f"{repeat.name}: expected a second image of what {reference.name} shows, found a "
            f"correlation of {alike:.2f}"
        )


def empty_frame(*images: GreyImage) -> str:
    """Why no point was found in the images of a frame, as far as it shows in them."""
    for image in images:
        if fault := _fault(image, np.ones(image.grey.shape, dtype=bool), "the image"):
            return f"no point was found in {image.name}: {fault}"
    names = " and ".join(image.name for image in images)
    return f"no point was found in {names}: expected the speckle of the reference image"


def weak_frame(image: GreyImage, found: Correlation) -> str | None:
    """Why the deviations of a frame say too little: most of its subsets correlate poorly."""
    if not found.valid.any() or not (usual := float(np.median(found.zncc[found.valid]))) < WEAK:
        return None
    share = "a third too small" if usual >= VERY_WEAK else "half of what they should be"
    return (
        f"{image.name}: the median correlation of its points is {usual:.2f}, expected {WEAK:g} or "
        f"more: standard deviations may be {share} (noise?), or the shape functions do not follow "
        "the field"
    )


def no_strain(key: str) -> str:
    """Why a table of strains is empty; `key` names their radius."""
    return f"{key}: found no point with enough neighbours within it for a strain, expected more"


def check_series_found(frames: Sequence[dict[str, Any]], reference: str) -> None:
    """Raises ValueError when no frame of a series, as `dic.json` has it, has a valid point."""
    if any(frame["valid"] for frame in frames):
        return
    lost: dict[str, int] = {}
    for frame in frames:
        for reason, count in frame["lost"].items():
            lost[reason] = lost.get(reason, 0) + count
    reasons = ", ".join(f"{count} {reason}" for reason, count in lost.items())
    raise ValueError(
        f"images.deformed: expected images of the speckle of {reference}, found none of its points "
        f"in any of them (lost as {reasons}; dic.json and pictures are written)"
    )


def _fault(image: GreyImage, mask: BoolArray, where: str) -> str | None:
    values = image.grey[mask]
    if np.mean(values >= image.full_scale) > MOST_SATURATED:
        return (
            f"expected an exposed image, found more than {MOST_SATURATED:.0%} of {where} saturated"
        )
    if fault := _too_even(image, mask, where):
        return fault
    if np.mean(values >= values.max()) > MOST_SATURATED:
        return f"expected an exposed image, found more than {MOST_SATURATED:.0%} of {where} clipped"
    return None


def _too_even(image: GreyImage, mask: BoolArray, where: str) -> str | None:
    values = image.grey[mask]
    if values.std() >= LEAST_SPREAD * image.full_scale:
        return None
    return (
        f"expected speckle in {where}, found grey levels of {values.mean():.0f} with a spread of "
        f"{values.std():.2g}"
    )
