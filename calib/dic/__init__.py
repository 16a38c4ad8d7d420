"""Digital image correlation: images in, displacements with their uncertainty out.

Nothing here needs another package of softcal.
"""

from calib.dic.correlate import Correlation, correlate
from calib.dic.follow import State, follow, next_state
from calib.dic.images import GreyImage, read_image, read_series
from calib.dic.overlap import correlation_length, error_correlation
from calib.dic.prepared import Reference, prepare
from calib.dic.quality import Quality, image_noise, quality
from calib.dic.reasons import Reason
from calib.dic.region import grid_points, polygon_mask, rectangle_mask
from calib.dic.settings import CorrelationSettings
from calib.dic.strain import Strain, strain

__all__ = [
    "Correlation",
    "CorrelationSettings",
    "GreyImage",
    "Quality",
    "Reason",
    "Reference",
    "State",
    "Strain",
    "correlate",
    "correlation_length",
    "error_correlation",
    "follow",
    "grid_points",
    "image_noise",
    "next_state",
    "polygon_mask",
    "prepare",
    "quality",
    "read_image",
    "read_series",
    "rectangle_mask",
    "strain",
]
