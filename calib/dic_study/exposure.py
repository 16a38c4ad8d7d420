"""Reference images that cannot be correlated whatever the settings."""

from __future__ import annotations

import numpy as np

from calib.dic import GreyImage
from calib.dic.prepared import BoolArray

MOST_SATURATED = 0.5
LEAST_SPREAD = 0.005
"""of full scale: an image without any speckle"""


def check_exposure(image: GreyImage, mask: BoolArray) -> None:
    """Raises ValueError for an image that is saturated or without speckle in `mask` (h, w)."""
    values = image.grey[mask]
    if np.mean(values >= image.full_scale) > MOST_SATURATED:
        raise ValueError(
            f"{image.name}: expected an exposed image, found more than {MOST_SATURATED:.0%} "
            "of the region saturated"
        )
    if values.std() < LEAST_SPREAD * image.full_scale:
        raise ValueError(
            f"{image.name}: expected speckle in the region, found grey levels of "
            f"{values.mean():.0f} with a spread of {values.std():.2g}"
        )
