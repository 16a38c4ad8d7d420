"""What of the reference image a study measures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.dic import CorrelationSettings, GreyImage, polygon_mask, read_image, rectangle_mask
from calib.dic.images import check_sizes
from calib.dic.prepared import BoolArray
from calib.dic_study.config import Region
from calib.toml_file import Contradiction
from fe.response import Array


def region_mask(region: Region, folder: Path, reference: GreyImage) -> BoolArray:
    """(h, w) True where the parts of a region, by their files in `folder`, all hold.

    Raises Contradiction for what reaches beyond the image, ValueError when no pixel is left.
    """
    shape = (reference.grey.shape[0], reference.grey.shape[1])
    mask = np.ones(shape, dtype=np.bool_)
    box, corners = region.rectangle_px, region.polygon_px
    if box is not None:
        _check_within("region.rectangle_px", box, [box[:2], box[2:]], reference)
        mask &= rectangle_mask(shape, box)
    if corners is not None:
        _check_within("region.polygon_px", corners, corners, reference)
        mask &= polygon_mask(shape, corners)
    if region.mask is not None:
        image = read_image(folder / region.mask)
        check_sizes([reference, image])
        if not (image.grey > 0).any():
            raise ValueError(f"{image.name}: expected a mask with bright pixels, found none")
        mask &= image.grey > 0
    if not mask.any():
        given = [name for name in ("rectangle_px", "polygon_px", "mask") if getattr(region, name)]
        raise ValueError(
            f"region: expected a pixel that {' and '.join(given)} have in common, found none"
        )
    return mask


def check_room(mask: BoolArray, points: Array, settings: CorrelationSettings) -> None:
    """Raises ValueError when no point (n, 2) px has enough of its subset in the mask (h, w).

    A thin or tiny region would else lose all its points, each as outside of it.
    """
    h, w = mask.shape
    sums = np.pad(mask.astype(np.int64).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    x, y = np.round(points).astype(np.int64).T
    left, right = (np.clip(x + by, 0, w) for by in (-settings.radius, settings.radius + 1))
    top, bottom = (np.clip(y + by, 0, h) for by in (-settings.radius, settings.radius + 1))
    count = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    measured = mask[y, x]
    share = float(count[measured].max(initial=0) / settings.subset**2)
    if share < settings.min_share:
        wide, high = (int(np.ptp(np.flatnonzero(mask.any(axis=axis)))) + 1 for axis in (0, 1))
        raise ValueError(
            f"region: expected room for {settings.min_share:.0%} of a subset of {settings.subset} "
            f"px about a point, found at most {share:.1%} in {wide} x {high} px; it needs a larger "
            "region or smaller subsets (correlation.subset_px)"
        )


def _check_within(
    key: str, found: object, corners: list[tuple[float, ...]] | tuple[tuple[float, ...], ...],
    image: GreyImage,
) -> None:  # fmt: skip
    """A region that reaches beyond the image is one of another image, or has its numbers swapped:
    to cut it without a word would measure another place than was meant."""
    h, w = image.grey.shape
    if not all(0 <= x <= w and 0 <= y <= h for x, y in corners):
        raise Contradiction(
            key, found, f"a place within {image.name}, x from 0 to {w} and y from 0 to {h} px"
        )
