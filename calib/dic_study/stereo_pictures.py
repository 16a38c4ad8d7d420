"""Displacements in space over the left reference image."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from calib.dic import GreyImage
from calib.dic_study.pictures import marker_size
from fe.response import Array

NAMES = ("u (x)", "v (y)", "w (z)")


def stereo_overlay(image: GreyImage, points: Array, displacement: Array) -> Figure:
    """Three pictures: u, v, w [mm] of points (n, 2) px over the left reference image."""
    h, w = image.grey.shape
    figure = Figure(figsize=(7.0, 0.4 + 3 * 6.0 * h / w), layout="constrained")
    low, high = np.percentile(image.grey, [0.5, 99.5])
    good = np.isfinite(displacement).all(axis=1)
    size = 0.6 * marker_size(points, figure, w, wide=True)
    if not good.any():
        figure.suptitle("no point was measured in this frame", fontsize=9)
    for number, (axes, name) in enumerate(zip(figure.subplots(3, 1), NAMES, strict=True)):
        axes.imshow(image.grey, cmap="gray", vmin=low, vmax=max(high, low + 1.0))
        if good.any():
            values = displacement[good, number]
            limits = np.percentile(values, [1.0, 99.0])
            drawn = axes.scatter(
                points[good, 0], points[good, 1], c=values, s=size, linewidths=0, cmap="viridis",
                vmin=limits[0], vmax=max(limits[1], limits[0] + 1e-9),
            )  # fmt: skip
            figure.colorbar(drawn, ax=axes, label=f"{name} [mm]")
        axes.set_xticks([])
        axes.set_yticks([])
    return figure
