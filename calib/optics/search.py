"""Search for the set-up that sees a small face best: all combinations, lens by lens."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from calib.optics.design_file import Design, Lens
from calib.optics.setup import Limit, Setup, View, conditions, view
from calib.optics.thin_lens import extension_at, object_distance_at

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Found:
    """The best that one lens can do."""

    lens: str
    is_feasible: bool
    """the set-up meets all limits"""
    setup: Setup
    """the set-up (numbers) with the most subsets on the face, or the one that misses least"""
    tube: float
    """length of the extension tube, mm"""
    seen: View
    """what that set-up sees (numbers)"""
    misses: tuple[tuple[str, float], ...]
    """limits that it does not meet, each with need / have, the worst first"""
    n_feasible: int
    """combinations that meet all limits"""
    n_tried: int
    distances: Distances
    """the same focal length, f-stop and angle at all distances within reach"""


@dataclass(frozen=True)
class Distances:
    """One aperture and angle over the object distance, (n,) each, in order of distance."""

    object_distance: Array
    """mm"""
    field_width: Array
    """mm"""
    depth_of_field: Array
    """mm"""
    depth_needed: float
    """mm"""
    is_feasible: npt.NDArray[np.bool_]


def search(design: Design) -> tuple[Found, ...]:
    """The best set-up with every lens: feasible ones first, those with more subsets before others.

    All apertures, angles and tubes are combined with distances in a geometric series over the
    reach of each tube; ties go to the first in that order. Lenses that reach nothing
    (`out_of_reach`) are left out; raises ValueError where none is left.
    """
    lacking = {lens for lens, _ in _beyond(design)}
    found = [_search_lens(lens, design) for lens in design.lenses if lens not in lacking]
    if not found:
        raise ValueError("; ".join(out_of_reach(design)))
    return tuple(sorted(found, key=_rank))


def out_of_reach(design: Design) -> tuple[str, ...]:
    """A sentence for every lens that focuses on nothing within `search.farthest`."""
    return tuple(
        f"search.farthest: found {design.search.farthest:g} mm, expected at least "
        f"{shortest:.0f} mm, the nearest that lens {lens.name!r} focuses with these tubes"
        for lens, shortest in _beyond(design)
    )


def _beyond(design: Design) -> list[tuple[Lens, float]]:
    """Lenses whose shortest object distance, mm, is too far."""
    nearest = [
        (
            lens,
            min(
                reach(lens, focal, tube, np.inf)[0]
                for focal in lens.focal_lengths
                for tube in design.search.extension_tubes
            ),
        )
        for lens in design.lenses
    ]
    return [(lens, shortest) for lens, shortest in nearest if shortest > design.search.farthest]


def _rank(found: Found) -> tuple[bool, float]:
    worst = found.misses[0][1] if found.misses else 0.0
    return not found.is_feasible, worst if found.misses else -float(found.seen.subsets)


def reach(lens: Lens, focal_length: float, tube: float, farthest: float) -> tuple[float, float]:
    """Shortest and longest object distance with an extension tube of this length, mm.

    The lens alone focuses from infinity to its nearest distance; the tube adds its length.
    The longest may be less than the shortest: the tube then leaves nothing within `farthest`.
    """
    focusing = float(extension_at(focal_length, lens.nearest_distance))
    nearest = float(object_distance_at(focal_length, tube + focusing))
    longest = float(object_distance_at(focal_length, tube)) if tube else np.inf
    return nearest, min(longest, farthest)


def _places(lens: Lens, design: Design) -> Iterator[tuple[float, float, float]]:
    """Focal length, tube, object distance of all combinations, mm."""
    for focal_length in lens.focal_lengths:
        for tube in design.search.extension_tubes:
            nearest, farthest = reach(lens, focal_length, tube, design.search.farthest)
            if nearest <= farthest:
                series = np.geomspace(nearest, farthest, design.search.distances)
                yield from ((focal_length, tube, distance) for distance in series.tolist())


def _search_lens(lens: Lens, design: Design) -> Found:
    places = np.array(list(_places(lens, design)))
    grid = Setup(
        focal_length=places[:, 0, None, None],
        object_distance=places[:, 2, None, None],
        f_stop=np.array(lens.f_stops)[None, :, None],
        half_angle=np.array(design.search.half_angles)[None, None, :],
    )
    seen = view(grid, design.sample, design.camera, design.limits, lens.barrel_diameter)
    limits = conditions(grid, seen, design.camera, design.limits, lens.image_circle)
    feasible = np.all([limit.demand <= 1 for limit in limits], axis=0)
    if feasible.any():
        quality = np.where(feasible, seen.subsets, -np.inf)
    else:  # the product of what is missing: one limit that cannot be met must not hide the others
        quality = -np.sum([np.log(np.maximum(limit.demand, 1)) for limit in limits], axis=0)
    shape = quality.shape
    best = tuple(int(i) for i in np.unravel_index(int(np.argmax(quality)), shape))
    return Found(
        lens=lens.name,
        is_feasible=bool(feasible[best]),
        setup=Setup(**_at(grid, best, shape)),
        tube=float(places[best[0], 1]),
        seen=View(**_at(seen, best, shape)),
        misses=_misses(limits, best),
        n_feasible=int(feasible.sum()),
        n_tried=quality.size,
        distances=_over_distances(places, seen, feasible, best),
    )


def _at(values: Setup | View, place: tuple[int, ...], shape: tuple[int, ...]) -> dict[str, float]:
    """Every field at one place of the grid."""
    names = [field.name for field in fields(values)]
    return {
        name: float(np.broadcast_to(np.asarray(getattr(values, name)), shape)[place])
        for name in names
    }


def _misses(limits: tuple[Limit, ...], place: tuple[int, ...]) -> tuple[tuple[str, float], ...]:
    demands = [(limit.name, float(limit.demand[place])) for limit in limits]
    return tuple(sorted((d for d in demands if d[1] > 1), key=lambda d: -d[1]))


def _over_distances(
    places: Array, seen: View, feasible: npt.NDArray[np.bool_], best: tuple[int, ...]
) -> Distances:
    """The row of the grid through `best`: its focal length, aperture and angle."""
    same = np.flatnonzero(places[:, 0] == places[best[0], 0])
    order = same[np.argsort(places[same, 2], kind="stable")]

    def row(values: object) -> Array:
        whole = np.broadcast_to(np.asarray(values, dtype=np.float64), feasible.shape)
        return np.array(whole[order, best[1], best[2]])

    return Distances(
        object_distance=places[order, 2],
        field_width=row(seen.field_width),
        depth_of_field=row(seen.depth_of_field),
        depth_needed=float(row(seen.depth_needed)[0]),
        is_feasible=feasible[order, best[1], best[2]],
    )
