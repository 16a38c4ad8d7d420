"""What of the reference image a study measures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.dic import GreyImage, polygon_mask, read_image, rectangle_mask
from calib.dic.images import check_sizes
from calib.dic.prepared import BoolArray
from calib.dic_study.config import Region


def region_mask(region: Region, folder: Path, reference: GreyImage) -> BoolArray:
    """(h, w) True where the parts of a region, by their files in `folder`, all hold.

    Raises ValueError when there is no such pixel.
    """
    shape = (reference.grey.shape[0], reference.grey.shape[1])
    mask = np.ones(shape, dtype=np.bool_)
    if region.rectangle_px is not None:
        mask &= rectangle_mask(shape, region.rectangle_px)
    if region.polygon_px is not None:
        mask &= polygon_mask(shape, region.polygon_px)
    if region.mask is not None:
        image = read_image(folder / region.mask)
        check_sizes([reference, image])
        mask &= image.grey > 0
    if not mask.any():
        raise ValueError("region: expected a place in the image that all of it shares, found none")
    return mask
