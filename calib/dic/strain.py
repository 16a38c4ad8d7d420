"""Strain from displacements: a polynomial fitted to the points around each point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.spatial import cKDTree

from calib.dic.interpolation import Array
from calib.dic.prepared import BoolArray

Measure = Literal["green", "log", "engineering"]


@dataclass(frozen=True)
class Strain:
    """Strain at points; NaN where these are lost or too few neighbours are valid."""

    gradient: Array
    """(n, 2, 2) [[du/dx, du/dy], [dv/dx, dv/dy]]"""
    xx: Array
    yy: Array
    xy: Array
    """(n,) components of the tensor, xy not doubled"""


def strain(
    points: Array,
    displacement: Array,
    radius: float,
    order: Literal[1, 2] = 1,
    measure: Measure = "green",
) -> Strain:
    """Fit displacement (n, 2) over points (n, 2) within `radius`, all in one unit of length.

    Points with a NaN displacement are left out, and have no strain. Others need half as many
    neighbours again as the polynomial has terms (3 or 6). green: (F'F - 1)/2, log: half the
    logarithm of F'F, engineering: the symmetric part of the gradient.
    Raises ValueError for a radius that is not positive, another order or another measure.
    """
    if not radius > 0:
        raise ValueError(f"radius: expected a positive length, found {radius}")
    if order not in (1, 2):
        raise ValueError(f"order: expected 1 or 2, found {order!r}")
    if measure not in get_args(Measure):
        known = ", ".join(get_args(Measure))
        raise ValueError(f"measure: expected one of {known}, found {measure!r}")
    n = len(points)
    gradient = np.full((n, 2, 2), np.nan)
    good = np.flatnonzero(np.isfinite(displacement).all(axis=1))
    least = 3 * (3 if order == 1 else 6) // 2
    if good.size >= least:
        around = cKDTree(points[good]).query_ball_point(points[good], radius)
        for index, near in zip(good, around, strict=True):
            chosen = good[near]
            if chosen.size < least:
                continue
            a, b = ((points[chosen] - points[index]) / radius).T
            terms = [np.ones_like(a), a, b] + ([a * a, a * b, b * b] if order == 2 else [])
            fit, _, rank, _ = np.linalg.lstsq(
                np.stack(terms, axis=1), displacement[chosen], rcond=1e-6
            )
            if rank == len(terms):
                gradient[index] = fit[1:3].T / radius
    return Strain(gradient, *_components(gradient, measure))


def _components(gradient: Array, measure: Measure) -> tuple[Array, Array, Array]:
    if measure == "engineering":
        tensor = (gradient + gradient.swapaxes(1, 2)) / 2
    else:
        F = gradient + np.eye(2)
        C = F.swapaxes(1, 2) @ F
        if measure == "green":
            tensor = (C - np.eye(2)) / 2
        else:
            known: BoolArray = np.asarray(np.isfinite(C).all(axis=(1, 2)))
            values, vectors = np.linalg.eigh(np.where(known[:, None, None], C, np.eye(2)))
            logs = np.log(np.maximum(values, np.finfo(np.float64).tiny)) / 2
            tensor = (vectors * logs[:, None]) @ vectors.swapaxes(1, 2)
            tensor[~known] = np.nan
    return tensor[:, 0, 0], tensor[:, 1, 1], tensor[:, 0, 1]
