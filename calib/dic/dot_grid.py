"""Dots of a calibration plate: centres to a hundredth of a pixel, ordered by three marker dots.

The plate has dark round dots on a bright ground, at equal spacing. Three dots have a bright
centre: the origin, one some dots away along x, one some dots away along y (y points up when x
points right, seen from the front). Source of the centres: J.-N. Ouellet, P. Hebert, "Precise
ellipse estimation without contour point extraction", Mach. Vis. Appl. 21 (2009) 59-67: every edge
pixel's gradient gives a tangent, and an ellipse is a linear fit to its tangents.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from calib.dic.distortion import Array
from calib.dic.plate_view import LEAST_POINTS, PlateView, fit_homography, map_plane

GRADIENT_WIDTH = 1.0
"""px, of the derivative of a Gaussian that finds edges"""
SMALLEST_AREA = 30.0
"""px^2: below it a dot has no ellipse to speak of"""
FLATTEST = 0.3
"""least ratio of an ellipse's axes: a plate turned by 70 degrees"""
LIKENESS = 0.12
"""largest deviation of an outline's area from that of its ellipse, as a share"""
HOLE = (0.02, 0.6)
"""share of a marker dot's area that is bright"""
NEAR = 0.25
"""of the spacing: dots this close to where the grid has one are that one"""
FLATNESS = 0.05
"""of the spacing: a grid that a homography misses by more is wrongly numbered"""
MOST_UNLIKE = 1.0
"""log ratio of the two steps by the markers plus the cosine between them"""
ON_GRID = 0.7
"""share of the dots found that have to be the plate's"""
BAND = (2.0, 7.0)
"""px, least and most of the half width of the edge's band that is fitted"""


@dataclass(frozen=True)
class DotPlate:
    """A plate. Raises ValueError when a number is impossible."""

    spacing: float
    """mm"""
    to_x_marker: int = 5
    """steps from the origin to the marker on the x axis"""
    to_y_marker: int = 3
    """steps from the origin to the marker on the y axis"""

    def __post_init__(self) -> None:
        if not self.spacing > 0 or self.to_x_marker < 1 or self.to_y_marker < 1:
            raise ValueError(
                f"spacing, to_x_marker, to_y_marker: expected above 0, found {self.spacing}, "
                f"{self.to_x_marker}, {self.to_y_marker}"
            )


Ellipse = tuple[tuple[float, float], tuple[float, float], float]
"""centre, full axes [px], turn [degrees], as OpenCV gives them"""


class Dots(NamedTuple):
    """What looks like a dot in one image."""

    centre: Array
    """(n, 2) px"""
    area: Array
    """(n,) px^2"""
    is_marker: npt.NDArray[np.bool_]
    """(n,) has a bright centre"""


def find_dots(image: Array) -> Dots:
    """Dots that lie wholly in an image (rows, columns); none is an empty result."""
    smooth = [gaussian_filter1d(image, GRADIENT_WIDTH, axis=axis) for axis in (0, 1)]
    gradient = (
        gaussian_filter1d(smooth[0], GRADIENT_WIDTH, axis=1, order=1),
        gaussian_filter1d(smooth[1], GRADIENT_WIDTH, axis=0, order=1),
    )
    found = []
    for outline, hole in _outlines(image):
        (x, y), (a, b), turn = cv2.fitEllipse(outline)
        ellipse = ((float(x), float(y)), (float(a), float(b)), float(turn))
        fitted = _dual_fit(gradient, ellipse, hole)
        if fitted is not None:
            found.append((*fitted, hole > 0.0))
    if not found:
        return Dots(np.empty((0, 2)), np.empty(0), np.empty(0, dtype=np.bool_))
    centre, area, marker = zip(*found, strict=True)
    dots = Dots(np.array(centre), np.array(area), np.array(marker))
    alike = np.abs(np.log(dots.area / np.median(dots.area))) < np.log(3.0)
    return Dots(*(values[alike] for values in dots))


def _outlines(image: Array) -> list[tuple[npt.NDArray[np.int32], float]]:
    """Outlines (n, 1, 2) of dark ellipses, and the share of each that is a bright hole."""
    low, high = np.percentile(image, (1.0, 99.0))
    if not high > low:
        return []
    grey = np.clip(255.0 * (image - low) / (high - low), 0.0, 255.0).astype(np.uint8)
    block = 2 * (min(image.shape) // 12) + 1
    dark = cv2.adaptiveThreshold(
        grey, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, max(block, 3), 12
    )
    contours, tree = cv2.findContours(dark, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if tree is None:
        return []
    height, width = image.shape
    outlines = []
    for index, contour in enumerate(contours):
        area = cv2.contourArea(contour)
        x, y, w, h = cv2.boundingRect(contour)
        inside = x > 1 and y > 1 and x + w < width - 1 and y + h < height - 1
        if tree[0, index, 3] >= 0 or area < SMALLEST_AREA or not inside or len(contour) < 6:
            continue
        _, axes, _ = cv2.fitEllipse(contour)
        full = np.pi / 4.0 * axes[0] * axes[1]
        if min(axes) < FLATTEST * max(axes) or abs(area / full - 1.0) > LIKENESS:
            continue
        hole = _largest_hole(contours, tree, index) / area
        outlines.append((np.asarray(contour, dtype=np.int32), hole if hole > HOLE[0] else 0.0))
    return [one for one in outlines if one[1] < HOLE[1]]


def _largest_hole(contours: object, tree: npt.NDArray[np.int32], index: int) -> float:
    child, largest = int(tree[0, index, 2]), 0.0
    while child >= 0:
        largest = max(largest, float(cv2.contourArea(contours[child])))  # type: ignore[index]
        child = int(tree[0, child, 0])
    return largest


def _dual_fit(
    gradient: tuple[Array, Array], ellipse: Ellipse, hole: float
) -> tuple[Array, float] | None:
    """Centre (2,) and area by the tangents near a first ellipse; None if no ellipse."""
    (x, y), axes, turn = ellipse
    a, b = 0.5 * axes[0], 0.5 * axes[1]
    radius = float(np.sqrt(a * b))
    # a marker's inner edge must stay out of the band
    room = radius * (1.0 - np.sqrt(hole)) if hole > 0.0 else radius
    band = float(np.clip(0.3 * radius, BAND[0], BAND[1]))
    band = min(band, 0.45 * room)
    reach = int(np.ceil(max(a, b) + band)) + 1
    row, column = round(y), round(x)
    height, width = gradient[0].shape
    rows = np.arange(max(row - reach, 0), min(row + reach + 1, height))
    columns = np.arange(max(column - reach, 0), min(column + reach + 1, width))
    px, py = np.meshgrid(columns - x, rows - y)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    normalised = np.hypot((c * px + s * py) / a, (c * py - s * px) / b)
    near = np.abs(normalised - 1.0) * radius < band
    gx, gy = (part[np.ix_(rows, columns)][near] for part in gradient)
    tx, ty = px[near] / radius, py[near] / radius
    tz = -(gx * tx + gy * ty)
    scale = np.mean(gx * gx + gy * gy)
    matrix = np.column_stack([gx * gx, gx * gy, gy * gy, gx * tz, gy * tz]) / scale
    right = -tz * tz / scale
    normal = matrix.T @ matrix
    if near.sum() < 12 or not np.linalg.cond(normal) < 1e12:
        return None
    dual = np.linalg.solve(normal, matrix.T @ right)
    centre = np.array([0.5 * dual[3], 0.5 * dual[4]])
    spread = np.array([[dual[0], 0.5 * dual[1]], [0.5 * dual[1], dual[2]]])
    shape = np.outer(centre, centre) - spread
    determinant = float(np.linalg.det(shape))
    if not determinant > 0.0 or np.abs(centre).max() > 0.5:
        return None
    area = np.pi * radius**2 * np.sqrt(determinant)
    return np.array([x, y]) + radius * centre, float(area)


def dot_view(image: Array, plate: DotPlate, name: str) -> PlateView:
    """The plate's dots in one image (rows, columns), each with its place on the plate.

    Dots that are missing, hidden or cut by the image's edge are left out. Raises ValueError when
    the three marker dots are not found or the plate is seen mirrored.
    """
    dots = find_dots(image)
    n_marker = int(np.count_nonzero(dots.is_marker))
    if n_marker != 3:
        raise ValueError(f"{name}: found {n_marker} dots with a bright centre, expected three")
    origin, along_x, along_y = _markers(dots, plate, name)
    index = np.full((len(dots.centre), 2), np.nan)
    index[origin], index[along_x] = (0.0, 0.0), (plate.to_x_marker, 0.0)
    index[along_y] = (0.0, plate.to_y_marker)
    index = _grow(dots.centre, index)
    known = np.all(np.isfinite(index), axis=1)
    places = plate.spacing * index[known]
    centre = dots.centre[known]
    homography = fit_homography(places, centre) if len(places) >= LEAST_POINTS else np.eye(3)
    off = np.linalg.norm(
        map_plane(np.asarray(np.linalg.inv(homography), np.float64), centre) - places, axis=1
    )
    is_grid = np.sqrt(np.mean(off**2)) < FLATNESS * plate.spacing
    if not is_grid or len(places) < max(ON_GRID * len(dots.centre), LEAST_POINTS):
        raise ValueError(
            f"{name}: {len(places)} of {len(dots.centre)} dots lie on a grid by the markers, "
            f"expected all but a few: markers {plate.to_x_marker} and {plate.to_y_marker} steps "
            "from the origin, seen from the front"
        )
    return PlateView(name, places, centre, _radius(homography, places, dots.area[known]))


def _markers(dots: Dots, plate: DotPlate, name: str) -> tuple[int, int, int]:
    """Which dots are the origin and the markers on x and y.

    Of all six ways to name them, the one whose two steps are most alike in length and whose
    corner is nearest to a right angle; only right-handed ones count, as rows point downwards.
    """
    three = np.flatnonzero(dots.is_marker)
    best, least = None, np.inf
    for origin in three:
        for along_x in three[three != origin]:
            along_y = int(three[(three != origin) & (three != along_x)][0])
            x = (dots.centre[along_x] - dots.centre[origin]) / plate.to_x_marker
            y = (dots.centre[along_y] - dots.centre[origin]) / plate.to_y_marker
            size = np.hypot(*x) * np.hypot(*y)
            if x[0] * y[1] - x[1] * y[0] > 0.0:
                continue
            off = abs(np.log(np.hypot(*x) / np.hypot(*y))) + abs(float(x @ y)) / size
            if off < least:
                best, least = (int(origin), int(along_x), along_y), off
    if best is None or least > MOST_UNLIKE:
        raise ValueError(
            f"{name}: the marker dots do not stand {plate.to_x_marker} and {plate.to_y_marker} "
            "steps from a corner, seen from the front; expected those of the plate"
        )
    return best


def _grow(centre: Array, index: Array) -> Array:
    """Number dots from known ones outwards: each new ring by the homography of those before."""
    for _ in range(40):
        known = np.flatnonzero(np.all(np.isfinite(index), axis=1))
        homography = _map_from(index[known], centre[known])
        back = np.asarray(np.linalg.inv(homography), dtype=np.float64)
        place = map_plane(back, centre)
        nearest = np.round(place)
        steps = np.abs(nearest[:, None, :] - index[known][None]).max(axis=2).min(axis=1)
        close = (np.abs(place - nearest).max(axis=1) < NEAR) & (steps <= 1.0)
        if len(known) == 3:
            # markers alone give no perspective: only dots between them are trusted
            low, high = index[known].min(axis=0) - 1.0, index[known].max(axis=0) + 1.0
            close &= np.all((nearest >= low) & (nearest <= high), axis=1)
        new = np.where(close[:, None], nearest, np.nan)
        new = _without_twins(new)
        if np.array_equal(new, index, equal_nan=True):
            break
        index = new
    return index


def _map_from(index: Array, centre: Array) -> Array:
    """(3, 3) from grid to image: affine while there are too few dots for a perspective."""
    if len(index) >= 8:
        return fit_homography(index, centre)
    design = np.column_stack([index, np.ones(len(index))])
    affine = np.linalg.lstsq(design, centre, rcond=None)[0].T
    return np.vstack([affine, [0.0, 0.0, 1.0]])


def _without_twins(index: Array) -> Array:
    """Two dots at one place of the grid: neither is known."""
    known = np.flatnonzero(np.all(np.isfinite(index), axis=1))
    _, inverse, count = np.unique(index[known], axis=0, return_inverse=True, return_counts=True)
    single = count[inverse.ravel()] == 1
    kept = np.full_like(index, np.nan)
    kept[known[single]] = index[known[single]]
    return kept


def _radius(homography: Array, places: Array, area: Array) -> float:
    """Radius of a dot on the plate, mm, from the areas of its images."""
    step = 1e-3
    right, up = (
        (map_plane(homography, places + by) - map_plane(homography, places - by)) / (2.0 * step)
        for by in (np.array([step, 0.0]), np.array([0.0, step]))
    )
    scale = np.abs(right[:, 0] * up[:, 1] - right[:, 1] * up[:, 0])
    return float(np.sqrt(np.median(area / scale) / np.pi))
