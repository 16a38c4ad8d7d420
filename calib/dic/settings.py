"""What a correlation is told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from calib.dic.interpolation import Degree

MOST_SUBSET = 255
MOST_BLUR = 3.0


@dataclass(frozen=True)
class CorrelationSettings:
    """Settings of one correlation; lengths in px.

    Raises ValueError for a value out of its range.
    """

    subset: int = 31
    """side of the square subset, odd, 7 to 255"""
    order: int = 1
    """1: affine shape functions, 2: quadratic"""
    degree: Degree = 5
    """of the B-spline between pixels: 3 or 5; 5 has the smaller bias, 3 is a fifth faster"""
    blur: float = 0.0
    """SD of a Gaussian that both images are blurred by, px; less bias of the interpolation in
    sharp images, more random error"""
    tolerance: float = 5e-4
    """stop when no pixel of the subset would move by more than this in a further step, px"""
    max_iterations: int = 50
    min_zncc: float = 0.7
    """a point that correlates less is lost"""
    max_sigma: float = 0.3
    """a point whose standard deviation is larger is lost, px"""
    min_share: float = 0.25
    """share of the subset's pixels that have to lie in the region"""
    light: Literal["constant", "plane"] = "plane"
    """change of light over a subset that is taken out: constant is the plain ZNSSD"""
    glare: float = 4.0
    """pixels whose residual is more than this many standard deviations are left out, where the
    residuals of a subset have heavier tails than noise; 0: never"""
    threads: int = 0
    """0: as many as there are cores; results do not depend on it"""

    def __post_init__(self) -> None:
        if not (7 <= self.subset <= MOST_SUBSET and self.subset % 2 == 1):
            raise ValueError(f"subset: expected an odd number of px, 7 to 255, found {self.subset}")
        if self.order not in (1, 2):
            raise ValueError(f"order: expected 1 or 2, found {self.order}")
        if self.degree not in (3, 5):
            raise ValueError(f"degree: expected 3 or 5, found {self.degree}")
        if not 0 <= self.blur <= MOST_BLUR:
            raise ValueError(f"blur: expected 0 to {MOST_BLUR:g} px, found {self.blur}")
        if not 0 < self.tolerance < 1:
            raise ValueError(f"tolerance: expected 0 to 1 px, found {self.tolerance}")
        if self.max_iterations < 1:
            raise ValueError(f"max_iterations: expected 1 or more, found {self.max_iterations}")
        if not 0 <= self.min_zncc < 1:
            raise ValueError(f"min_zncc: expected 0 or more and below 1, found {self.min_zncc}")
        if not self.max_sigma > 0:
            raise ValueError(f"max_sigma: expected a positive value, found {self.max_sigma}")
        if not 0 < self.min_share <= 1:
            raise ValueError(f"min_share: expected 0 to 1, found {self.min_share}")
        if self.light not in ("constant", "plane"):
            raise ValueError(f"light: expected constant or plane, found {self.light}")
        if not (self.glare == 0 or self.glare >= 2):
            raise ValueError(f"glare: expected 0, or 2 or more, found {self.glare}")
        if self.threads < 0:
            raise ValueError(f"threads: expected 0 or more, found {self.threads}")

    @property
    def radius(self) -> int:
        """Half side of the subset without its middle, px."""
        return self.subset // 2
