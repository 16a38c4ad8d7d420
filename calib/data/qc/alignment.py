"""Samples brought to one height and travel, by what their fields say of each other.

The base of a sample is seen to a spacing of its DIC points. Where a field bends, the mean over
samples that stand differently is not the field at their mean place: half the variance of the place
times the second derivative is added. The first mean tells each sample's error to a micrometre
(`placing_errors`); taken there, their fields are of one place.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from calib.data.qc.averaging import Placing
from calib.data.qc.experiment_file import Experiment
from calib.data.qc.machine_test import at_travel
from calib.data.qc.sample import REACH, Sample
from calib.data.readers.frames import BoolArray
from fe.response import Array

STEP = 0.02
"""mm of travel over which its slope is taken"""
KINK = 0.43
"""RMS error of the mean of 16 parabolas through three points anywhere on two straight lines with a
kink, over that of the difference of these and parabolas over five points (4,000 random kinks)"""

RESOLVED, RESOLVED_BESIDE = 1.5, 1.0
"""SDs of the mean's noise by which a field mapped from half as many DIC points may differ, and at a
point beside one that is not resolved: an edge of the field runs on"""
CHANCE, CHANCE_BESIDE = 3.5, 2.5
"""SDs of this change itself that it is less than by chance: noise of points that share little of it
changes by about as much as it is"""
BESIDE = 1.1
"""distances of neighbours"""
FULL = 4
"""places of a grid for each of its points, at most: more, and they are no grid"""


class Aligned(NamedTuple):
    """Samples at one height and travel."""

    fields: Array
    """(n_sample, n_step, n, 3) mm"""
    placing: Placing
    coarse: Array
    """(n_step, n, 3) mean of what mapping from half as many DIC points would change, mm; NaN where
    no sample tells"""
    coarse_sd: Array
    """of these, by how the samples' own scatter, mm"""


def aligned(
    samples: Sequence[Sample], experiment: Experiment, points: Array, errors: Array
) -> Aligned:
    """Fields of samples freed of `errors` (n_sample, 3) of x, y and travel, mm.

    In x the samples are left as they are: of the two halves that are folded, one gains what the
    other loses. Slopes are differences of the samples' own fields over a spacing of their DIC
    points, and between holds: noisy, but not flattened as those of the mean field are.
    """
    moved = errors * np.array([0.0, 1.0, 1.0])
    found = [
        _at(sample, experiment, points, up, deeper)
        for sample, (_, up, deeper) in zip(samples, moved, strict=True)
    ]
    fields, slopes, coarse = (np.array(part) for part in zip(*found, strict=True))
    # of x nothing is known
    by = np.concatenate([np.full_like(slopes[:, :1], np.nan), slopes], axis=1)
    placing = Placing(_known_mean(by), _error_of_mean(by), moved)
    return Aligned(fields, placing, _known_mean(coarse), _error_of_mean(coarse))


def unresolved(found: Aligned, noise: Array, points: Array) -> BoolArray:
    """(n,) points (n, 2) [mm] where DIC points do not resolve the field; `noise` (3,) SD, mm.

    Two thresholds as in edge detection (Canny, IEEE Trans. PAMI 8, 1986): a change by the second
    counts at a point beside one that is not resolved, as it is hardly noise there.
    """
    told = np.isfinite(found.coarse_sd)  # one sample alone tells no scatter
    total = np.sum(np.where(told, found.coarse_sd, 0.0) ** 2, axis=(0, 1))
    chance = np.sqrt(total / np.maximum(told.sum(axis=(0, 1)), 1))

    def beyond(most: float, by_chance: float) -> BoolArray:
        limit = np.maximum(most * noise, by_chance * chance)
        # also where nothing is known
        return np.asarray(np.any(~(np.abs(found.coarse) <= limit), axis=(0, 2)))

    lost, weak = beyond(RESOLVED, CHANCE), beyond(RESOLVED_BESIDE, CHANCE_BESIDE)
    pairs = cKDTree(_by_spacing(points)).query_pairs(BESIDE, output_type="ndarray")
    # weak points that weak ones join to a lost one
    joined = pairs[weak[pairs].all(axis=1)]
    links = coo_array((np.ones(len(joined)), tuple(joined.T)), shape=(len(points), len(points)))
    group = connected_components(links, directed=False)[1]
    return np.asarray(weak & np.isin(group, group[lost]))


def _by_spacing(points: Array) -> Array:
    """(n, 2) points over the distance of neighbours, each axis by its own where they are a grid."""
    lines = [np.unique(np.round(along, 6)) for along in points.T]
    if np.prod([line.size for line in lines]) <= FULL * len(points) and min(map(len, lines)) > 1:
        return np.asarray(points / [np.median(np.diff(line)) for line in lines])
    nearest = np.asarray(cKDTree(points).query(points, k=2)[0])[:, 1]
    return np.asarray(points / np.median(nearest))


def mapping_std(found: Aligned, chosen: BoolArray) -> Array:
    """(3,) RMS error of mapping from DIC points over the `chosen` of the points (n,), mm.

    What half as many DIC points would change, but for its noise, times the share of it that three
    points in a row are off by at a kink between them (`KINK`): smooth fields are mapped better.
    """
    with np.errstate(invalid="ignore"):
        beyond_noise = (found.coarse**2 - found.coarse_sd**2)[:, chosen]
    mean_square = np.nan_to_num(np.nanmean(beyond_noise, axis=(0, 1)))
    return np.asarray(KINK * np.sqrt(np.maximum(mean_square, 0.0)), dtype=np.float64)


def _known_mean(values: Array) -> Array:
    """Mean over the first axis of what is not NaN; NaN where nothing is."""
    count = np.isfinite(values).sum(axis=0)
    mean: Array = np.where(count > 0, np.nansum(values, axis=0) / np.maximum(count, 1), np.nan)
    return mean


def _error_of_mean(values: Array) -> Array:
    """SD of `_known_mean` by how the values scatter."""
    count = np.isfinite(values).sum(axis=0)
    squares = np.nansum((values - _known_mean(values)) ** 2, axis=0)
    enough = np.maximum(count, 2)
    return np.where(count > 1, np.sqrt(squares / ((enough - 1) * enough)), np.nan)


def _at(
    sample: Sample, experiment: Experiment, points: Array, up: float, deeper: float
) -> tuple[Array, Array, Array]:
    """Field (n_step, n, 3) of one sample, its slopes in y and travel, and what coarseness adds."""
    face, options = sample.face, experiment.field
    if face is None:
        raise ValueError(f"{sample.name}: expected a sample with a field, found none")
    nominal, reach = experiment.protocol.travel, REACH * experiment.protocol.increment_mm

    def mapped(higher: float, *, coarsely: bool = False) -> Array:
        there = points + np.array([0.0, higher - up])
        return face.mapped(there, options.mapping, options.rigid_body, coarsely=coarsely)[0]

    def at(values: Array, further: float = 0.0) -> Array:
        return at_travel(face.travel + deeper - further, values, nominal, reach)

    here, half = mapped(0.0), 0.5 * face.lattice.spacing
    by_height = (at(mapped(half)) - at(mapped(-half))) / (2 * half)
    by_travel = (at(here, STEP) - at(here, -STEP)) / (2 * STEP)
    field = at(here)
    return field, np.stack([by_height, by_travel]), at(mapped(0.0, coarsely=True)) - field
