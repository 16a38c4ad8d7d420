"""Pictures of a frame: displacements over the image, and which points were lost and why."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from calib.dic import Correlation, GreyImage, Reason
from fe.atomic_file import replacing
from fe.response import Array

LEAST_MARK = 4.0
"""points² of the mark of a lost point: one among thousands is to be seen"""
LOST = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#F0E442",
    "#000000",
    "#888888",
)


def save_png(figure: Figure, path: Path) -> None:
    """Write a picture whole or not at all; the same numbers give the same file."""
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120, metadata={"Software": None})


def overlay(image: GreyImage, points: Array, found: Correlation) -> Figure:
    """u, v and their SD at the points where they are in the image, px."""
    h, w = image.grey.shape
    wide = w > 1.5 * h
    figure = Figure(figsize=(8, 9 * min(3 * h / w, 1.4)) if wide else (12, 4.5 * min(h / w, 2)))
    figure.set_layout_engine("constrained")
    axes = figure.subplots(3, 1) if wide else figure.subplots(1, 3)
    valid = found.valid
    places = points + np.where(valid[:, None], found.displacement, 0.0)
    size = marker_size(points, figure, w, wide)
    parts = (
        ("u, right [px]", found.displacement[:, 0]),
        ("v, down [px]", found.displacement[:, 1]),
        ("larger SD of u and v [px]", found.sigma.max(axis=1)),
    )
    if not valid.any():
        figure.suptitle("no point was measured in this frame", fontsize=9)
    for axis, (title, values) in zip(np.ravel(axes), parts, strict=True):
        axis.imshow(image.grey, cmap="gray", vmin=0, vmax=image.full_scale)
        if valid.any():
            drawn = axis.scatter(*places[valid].T, c=values[valid], s=size, linewidths=0)
            figure.colorbar(drawn, ax=axis, shrink=0.8)
        axis.set_title(title, fontsize=9)
        axis.set_axis_off()
        axis.set_xlim(0, w - 1)
        axis.set_ylim(h - 1, 0)
    return figure


def lost_points(reference: GreyImage, points: Array, found: Correlation) -> Figure:
    """Points without a displacement, by reason, over the reference image."""
    h, w = reference.grey.shape
    figure = Figure(figsize=(8, 1.2 + 8 * min(h / w, 1.4)), layout="constrained")
    axis = figure.subplots()
    axis.imshow(reference.grey, cmap="gray", vmin=0, vmax=reference.full_scale)
    size = marker_size(points, figure, w, wide=True)
    for colour, reason in zip(LOST, list(Reason)[1:], strict=True):
        chosen = found.reason == reason
        if chosen.any():
            label = f"{np.count_nonzero(chosen)}: {reason.text}"
            x, y = points[chosen].T
            axis.scatter(x, y, s=max(0.6 * size, LEAST_MARK), color=colour, linewidths=0)
            axis.scatter([], [], s=30, color=colour, linewidths=0, label=label)
    axis.set_title(f"{np.count_nonzero(found.valid)} of {len(points)} points measured", fontsize=9)
    axis.set_axis_off()
    if not found.valid.all():
        # Below the image: on it the legend would hide points.
        figure.legend(fontsize=8, loc="outside lower center", ncols=2)
    return figure


def marker_size(points: Array, figure: Figure, width: int, wide: bool) -> float:
    """Area in points² of marks that just touch."""
    x = np.unique(points[:, 0])
    step = float(np.min(np.diff(x))) if x.size > 1 else 8.0
    shown = figure.get_figwidth() * (0.85 if wide else 0.28)
    return float(np.clip((step / width * shown * 72) ** 2, 0.5, 60))
