"""A second design where the posterior is, and the emulator that learns from it alone.

Modes of the whole prior leave out, and its processes take for noise, what tells apart the fields of
a narrow posterior. In the posterior's own box a few runs do better. The emulator trained there
is known there only: its posterior is the prior's within the box, zero outside, and the share of the
posterior that this cuts off is held below `MOST_CUT`. Where boxes do not hold it, or not once its
mesh was checked for the last time, it is sampled with the emulator of the prior's box.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from calib.inference.quadrature import Quadrature
from calib.study.artifacts import read_json
from calib.study.sections import Hypothesis
from fe.response import Array
from surrogate import TrainingSet, sobol_design

REFINEMENT = "refinement.json"
BOXES = "boxes.json"
LOCAL = "local"
"""folder of the emulators of posteriors' boxes"""
WIDTH = 4.5
"""posterior SDs from the mean to either side; a normal has 7e-6 of its mass beyond"""
TAIL = 1e-5
"""mass of a posterior beyond an edge where that lies further out: one that leans on a bound of the
prior falls as an exponential away from it, and has 4e-3 beyond `WIDTH`"""
SMALL = 0.1
"""share of the prior's box below which a second design in the posterior's is worth its runs"""
MOST_CUT = 1e-4
"""share of the posterior that a box may leave outside"""
MOST_BOXES = 3
"""boxes tried for one posterior"""
MOST_LOST = 3e-3
"""share beyond its box with which a posterior is sampled there still: it moves a mean by 0.01 of
its SDs; beyond, the emulator of the prior's box is taken"""
STRIP = 0.1
"""width of the strips along an edge from which the mass beyond is foretold, shares of the box"""


def box_of(found: Quadrature, design_box: Array) -> Array:
    """(d, 2) range of the emulator's inputs that holds a posterior, within that of the design."""
    d = len(design_box)
    mean, sd = found.mean[1 : 1 + d], found.sd[1 : 1 + d]
    tails = np.array([_tails(at, found.weights) for at in found.x[:, 1 : 1 + d].T])
    low, high = (
        np.minimum(mean - WIDTH * sd, tails[:, 0]),
        np.maximum(mean + WIDTH * sd, tails[:, 1]),
    )
    return np.column_stack([np.maximum(low, design_box[:, 0]), np.minimum(high, design_box[:, 1])])


def _tails(at: Array, weights: Array) -> tuple[float, float]:
    """The outermost nodes (n,) beyond which, themselves counted, there is more than `TAIL`."""
    order = np.argsort(at)
    mass = np.cumsum(weights[order])
    first, last = np.searchsorted(mass, [TAIL, mass[-1] - TAIL])
    return float(at[order[first]]), float(at[order[min(last, len(at) - 1)]])


def is_small(box: Array, design_box: Array) -> bool:
    """Whether a box is so much smaller than the design's that it deserves runs of its own."""
    return bool(np.prod(np.ptp(box, axis=1) / np.ptp(design_box, axis=1)) < SMALL)


def mass_beyond(found: Quadrature, box: Array, design_box: Array) -> float:
    """Share of a posterior beyond the edges of the box in which it is known.

    From its mass in two strips along each edge: an exponential through both, gone on with outside.
    Where the logarithm of the density of an input is concave that is more than there is. Edges that
    are the design's own cut nothing. 1 where the density does not fall towards an edge.
    """
    total = 0.0
    for axis, (low, high) in enumerate(box):
        at = found.x[:, 1 + axis]
        for edge, sign, end in ((low, 1.0, 0), (high, -1.0, 1)):
            if edge != design_box[axis, end]:
                total += _beyond(sign * (at - edge), found.weights, STRIP * (high - low))
    return min(total, 1.0)


def _beyond(depth: Array, weights: Array, strip: float) -> float:
    """Mass at negative depths (m,) of what has these weights (m,) at positive ones."""
    order = np.argsort(depth)
    sorted_depth, mass = depth[order], np.cumsum(weights[order])
    ends = np.searchsorted(sorted_depth, [strip, 2.0 * strip])
    if not ends[0]:  # the nodes reach to where hardly anything is left
        return 0.0
    if not ends[0] < ends[1] < len(depth):
        return 1.0
    # Strips end between two nodes, where the mass of those before is the integral's.
    first, second = 0.5 * (sorted_depth[ends - 1] + sorted_depth[ends])
    outer, both = mass[ends - 1]
    if not both > outer > 0.0:
        return 0.0 if both == 0.0 or outer == 0.0 else 1.0
    rate = np.log((both - outer) / (second - first) * first / outer) / (0.5 * second)
    if not rate > 0.0:
        return 1.0
    half = 0.5 * rate * first
    at_edge = outer / first * np.exp(-half) * half / np.sinh(half)
    return float(at_edge / rate)


def local_points(box: Array, n: int, seed: int) -> Array:
    """(n, d) design of a box: corners, as far as they are a quarter of it, then Sobol points."""
    corners = min(2 ** len(box), n // 4)
    return sobol_design(n, box, seed, n_corners=corners)


def within(runs: TrainingSet, box: Array | None) -> TrainingSet:
    """The runs inside a box, its edges included; all where there is none."""
    if box is None:
        return runs
    kept, partial = runs.subset(np.flatnonzero(inside(runs.ratios, box))), runs.partial
    if partial is None:
        return kept
    return replace(kept, partial=partial.subset(inside(partial.ratios, box)))


def inside(points: Array, box: Array) -> npt.NDArray[np.bool_]:
    """(n,) whether points (n, d) are in a box (d, 2), up to rounding."""
    slack = 1e-9 * np.ptp(box, axis=1)
    kept: npt.NDArray[np.bool_] = (
        (points >= box[:, 0] - slack) & (points <= box[:, 1] + slack)
    ).all(axis=1)
    return kept


def designed_box(out: Path, hypothesis: Hypothesis) -> Array | None:
    """The box of the second design of a hypothesis; None where there is none."""
    box = read_json(out / REFINEMENT)[hypothesis.name].get("box")
    return None if box is None else np.asarray(box, dtype=float)


def kept_box(out: Path, hypothesis: Hypothesis) -> Array | None:
    """The box of the emulator from which a hypothesis is sampled; None: the prior's."""
    lost = shares_beyond(out).get(hypothesis.name, 0.0)
    return None if lost > MOST_LOST else designed_box(out, hypothesis)


def shares_beyond(out: Path) -> dict[str, float]:
    """Hypothesis -> share of its posterior beyond its box, for those that have one.

    Nothing before the meshes were checked for the last time, and of studies before 0.3.
    """
    return dict(read_json(out / BOXES)) if (out / BOXES).is_file() else {}
