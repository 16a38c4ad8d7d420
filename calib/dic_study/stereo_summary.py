"""What is told of one pair of images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from calib.dic.stereo import StereoFrame, StereoReason
from calib.dic.surface_frame import SurfaceFrame


def summary(path: Path, found: StereoFrame) -> dict[str, Any]:
    """What `dic.json` holds of a pair of images."""
    valid = found.valid
    lost = {r.name.lower(): int(np.sum(found.reason == r)) for r in list(StereoReason)[1:]}
    middle = np.median(found.sigma[valid], axis=0).tolist() if valid.any() else None
    return {
        "image": path.name,
        "points": int(valid.size),
        "valid": int(valid.sum()),
        "lost": {name: count for name, count in lost.items() if count},
        "median_sigma_mm": middle,
        "epipolar_rms_px": float(np.sqrt(np.nanmean(found.epipolar**2))) if valid.any() else None,
    }


def sentence(found: StereoFrame, axes: SurfaceFrame) -> str:
    """What is said of a pair of images, displacements in the frame of the surface."""
    valid = found.valid
    text = f"{int(valid.sum())} of {valid.size} points"
    if valid.any():
        moved = np.median(axes.vectors(found.displacement[valid]), axis=0)
        text += ", median displacement " + ", ".join(f"{value:.4f}" for value in moved) + " mm"
    return text
