"""What a camera sees of a speckled, deformed face: every pixel's line of sight is followed.

For each pixel the material point on its line of sight is found by Newton's method on the exact
camera and surface, from a first guess by projected triangles; the pixel's brightness is the
speckle's around that point over the spread of the lens, by 3 x 3 Gauss-Hermite points. No picture
is interpolated, so that what correlation finds has no share of the renderer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from calib.dic.camera import Camera, project
from calib.virtual.cameras import CameraPair
from calib.virtual.speckle import Speckle, brightness
from calib.virtual.surface import Surface, place_at
from fe.compiled import kernel
from fe.response import Array

NEWTON_STEPS = 12
CONVERGED = 1e-9
"""px"""
FINER = 2
"""triangles of the first guess along a side of the surface's grid: they show where its outline is,
the place in it is Newton's"""
LEAST_FACING = 0.05
"""cosine between a surface's normal and the line of sight below which nothing is seen"""


@dataclass(frozen=True)
class Pin:
    """The front of a pin: a rectangle that hides what is behind it; mm, in the face's frame."""

    left: float
    right: float
    bottom: float
    front: float
    """z of its front"""
    brightness: float = 0.25


class Picture(NamedTuple):
    """One view without noise, and what is true of it."""

    brightness: Array
    """(rows, columns) share of full scale"""
    material: Array
    """(rows, columns, 2) mm, the material point on each pixel's line of sight; NaN off the face"""


def render(
    surface: Surface,
    speckle: Speckle,
    cameras: CameraPair,
    camera: Camera,
    pin: Pin | None = None,
    background: float = 0.04,
) -> Picture:
    """The face as `camera`, one of `cameras`, sees it; the frame is that of the surface."""
    shape = (cameras.rows, cameras.columns)
    guess = _first_guess(surface, camera, shape)
    lens = camera.intrinsics
    numbers = np.array(
        [lens.fx, lens.fy, lens.cx, lens.cy, lens.skew, *lens.distortion.coefficients]
    )
    depths = np.linspace(0.5, 1.5, 401) * cameras.distance_mm
    picture = np.full(shape, background)
    material = np.full((*shape, 2), np.nan)
    _trace(
        guess, surface.knots_x, surface.knots_y, surface.coefficients, numbers, camera.rotation,
        camera.translation, depths, cameras.blur(depths), speckle.centre, speckle.radius,
        speckle.first, speckle.origin, speckle.cell, speckle.shape, speckle.bright, speckle.dark,
        picture, material,
    )  # fmt: skip
    if pin is not None:
        hidden = _behind_pin(pin, surface, camera, shape)
        picture[hidden] = pin.brightness
        material[hidden] = np.nan
    return Picture(picture, material)


def _first_guess(surface: Surface, camera: Camera, shape: tuple[int, int]) -> Array:
    """(rows, columns, 2) material points by linear interpolation in the nearest triangles."""
    n_x, n_y, _ = surface.places.shape
    fine_x, fine_y = FINER * (n_x - 1) + 1, FINER * (n_y - 1) + 1
    x = np.linspace(surface.low[0], surface.high[0], fine_x)
    y = np.linspace(surface.low[1], surface.high[1], fine_y)
    material = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    places = surface.at(material.reshape(-1, 2))
    pixels = project(camera, places)[0].reshape(fine_x, fine_y, 2)
    depth = ((places @ camera.rotation.T + camera.translation)[:, 2]).reshape(fine_x, fine_y)
    guess = np.full((*shape, 2), np.nan)
    _rasterise(material, pixels, depth, guess, np.full(shape, np.inf))
    return guess


@kernel()
def _rasterise(material: Array, pixels: Array, depth: Array, guess: Array, nearest: Array) -> None:
    rows, columns = nearest.shape
    corners = np.empty((3, 2), dtype=np.int64)
    for i in range(material.shape[0] - 1):
        for j in range(material.shape[1] - 1):
            for half in range(2):
                corners[0, 0], corners[0, 1] = i + half, j + half
                corners[1, 0], corners[1, 1] = i + 1, j
                corners[2, 0], corners[2, 1] = i, j + 1
                p0 = pixels[corners[0, 0], corners[0, 1]]
                p1 = pixels[corners[1, 0], corners[1, 1]]
                p2 = pixels[corners[2, 0], corners[2, 1]]
                area = (p1[0] - p0[0]) * (p2[1] - p0[1]) - (p2[0] - p0[0]) * (p1[1] - p0[1])
                if not abs(area) > 1e-12:
                    continue
                low_x = max(int(np.ceil(min(p0[0], p1[0], p2[0]) - 1e-9)), 0)
                high_x = min(int(np.floor(max(p0[0], p1[0], p2[0]) + 1e-9)), columns - 1)
                low_y = max(int(np.ceil(min(p0[1], p1[1], p2[1]) - 1e-9)), 0)
                high_y = min(int(np.floor(max(p0[1], p1[1], p2[1]) + 1e-9)), rows - 1)
                for row in range(low_y, high_y + 1):
                    for column in range(low_x, high_x + 1):
                        dx, dy = column - p0[0], row - p0[1]
                        b = (dx * (p2[1] - p0[1]) - dy * (p2[0] - p0[0])) / area
                        c = (dy * (p1[0] - p0[0]) - dx * (p1[1] - p0[1])) / area
                        if b < -1e-9 or c < -1e-9 or b + c > 1.0 + 1e-9:
                            continue
                        a = 1.0 - b - c
                        deep = (
                            a * depth[corners[0, 0], corners[0, 1]]
                            + b * depth[corners[1, 0], corners[1, 1]]
                            + c * depth[corners[2, 0], corners[2, 1]]
                        )
                        if deep < nearest[row, column]:
                            nearest[row, column] = deep
                            for k in range(2):
                                guess[row, column, k] = (
                                    a * material[corners[0, 0], corners[0, 1], k]
                                    + b * material[corners[1, 0], corners[1, 1], k]
                                    + c * material[corners[2, 0], corners[2, 1], k]
                                )


@kernel()
def _see(
    place: Array, lens: Array, turn: Array, move: Array, pixel: Array, by_place: Array
) -> float:
    """Pixel of one place and its slopes (2, 3), with Brown's lens; returns the depth."""
    c = turn @ place + move
    x, y = c[0] / c[2], c[1] / c[2]
    r2 = x * x + y * y
    k1, k2, k3, p1, p2 = lens[5], lens[6], lens[7], lens[8], lens[9]
    factor = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
    u = factor * x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    v = factor * y + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    uv = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    uu = factor + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    vv = factor + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    pixel[0] = lens[0] * u + lens[4] * v + lens[2]
    pixel[1] = lens[1] * v + lens[3]
    ax, ay = lens[0] * uu + lens[4] * uv, lens[0] * uv + lens[4] * vv
    bx, by = lens[1] * uv, lens[1] * vv
    for k in range(3):
        dx, dy = (turn[0, k] - x * turn[2, k]) / c[2], (turn[1, k] - y * turn[2, k]) / c[2]
        by_place[0, k] = ax * dx + ay * dy
        by_place[1, k] = bx * dx + by * dy
    depth: float = c[2]
    return depth


@kernel(nogil=True)
def _trace(
    guess: Array, knots_x: Array, knots_y: Array, coefficients: Array, lens: Array, turn: Array,
    move: Array, depths: Array, blurs: Array, centre: Array, radius: Array,
    first: npt.NDArray[np.int64], origin: Array, cell: float, shape: tuple[int, int],
    bright: float, dark: float, picture: Array, material: Array,
) -> None:  # fmt: skip
    """Fill picture (rows, columns) and material (rows, columns, 2) where the face is seen."""
    surface, by_pixel, place = np.empty((3, 3)), np.empty((2, 2)), np.empty(2)
    for row in range(picture.shape[0]):
        for column in range(picture.shape[1]):
            place[:] = guess[row, column]
            if np.isnan(place[0]):
                continue
            depth = _find(
                row, column, knots_x, knots_y, coefficients, lens, turn, move, place, surface,
                by_pixel,
            )  # fmt: skip
            if not depth > 0.0 or not _is_facing(surface, turn):
                continue
            spread = np.sqrt(3.0) * np.interp(depth, depths, blurs)
            total = 0.0
            for a in range(-1, 2):
                for b in range(-1, 2):
                    weight = (2.0 / 3.0 if a == 0 else 1.0 / 6.0) * (
                        2.0 / 3.0 if b == 0 else 1.0 / 6.0
                    )
                    off_x, off_y = a * spread, b * spread
                    at_x = place[0] + by_pixel[0, 0] * off_x + by_pixel[0, 1] * off_y
                    at_y = place[1] + by_pixel[1, 0] * off_x + by_pixel[1, 1] * off_y
                    total += weight * brightness(
                        at_x, at_y, centre, radius, first, origin, cell, shape, bright, dark
                    )
            picture[row, column] = total
            material[row, column] = place


@kernel(nogil=True)
def _find(
    row: int, column: int, knots_x: Array, knots_y: Array, coefficients: Array, lens: Array,
    turn: Array, move: Array, place: Array, surface: Array, by_pixel: Array,
) -> float:  # fmt: skip
    """Newton's method from place (2,) to the material point on a pixel's line of sight.

    surface (3, 3): where it is and its slopes; by_pixel (2, 2): how the point moves with the pixel,
    mm/px. Returns its depth, mm; 0 where there is none on the face.
    """
    pixel, by_place, by = np.empty(2), np.empty((2, 3)), np.empty((2, 2))
    for _ in range(NEWTON_STEPS):
        place_at(knots_x, knots_y, coefficients, place[0], place[1], surface)
        depth = _see(surface[0], lens, turn, move, pixel, by_place)
        off_x, off_y = column - pixel[0], row - pixel[1]
        for a in range(2):
            for b in range(2):
                by[a, b] = 0.0
                for c in range(3):
                    by[a, b] += by_place[a, c] * surface[1 + b, c]
        determinant = by[0, 0] * by[1, 1] - by[0, 1] * by[1, 0]
        if not abs(determinant) > 1e-12:
            return 0.0
        by_pixel[0, 0], by_pixel[0, 1] = by[1, 1] / determinant, -by[0, 1] / determinant
        by_pixel[1, 0], by_pixel[1, 1] = -by[1, 0] / determinant, by[0, 0] / determinant
        place[0] += by_pixel[0, 0] * off_x + by_pixel[0, 1] * off_y
        place[1] += by_pixel[1, 0] * off_x + by_pixel[1, 1] * off_y
        if max(abs(off_x), abs(off_y)) < CONVERGED:
            is_on_face = knots_x[0] <= place[0] <= knots_x[-1]
            is_on_face = is_on_face and knots_y[0] <= place[1] <= knots_y[-1]
            return depth if is_on_face else 0.0
        # pixels at the face's edge: a step beyond it is taken back
        place[0] = min(max(place[0], knots_x[0]), knots_x[-1])
        place[1] = min(max(place[1], knots_y[0]), knots_y[-1])
    return 0.0


@kernel(nogil=True)
def _is_facing(surface: Array, turn: Array) -> bool:
    """Whether the surface's normal points to the camera, not only edgewise."""
    n0 = surface[1, 1] * surface[2, 2] - surface[1, 2] * surface[2, 1]
    n1 = surface[1, 2] * surface[2, 0] - surface[1, 0] * surface[2, 2]
    n2 = surface[1, 0] * surface[2, 1] - surface[1, 1] * surface[2, 0]
    length = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    # the third row of the rotation is the axis of view
    facing: bool = -(n0 * turn[2, 0] + n1 * turn[2, 1] + n2 * turn[2, 2]) >= LEAST_FACING * length
    return facing


def _behind_pin(
    pin: Pin, surface: Surface, camera: Camera, shape: tuple[int, int]
) -> npt.NDArray[np.bool_]:
    """(rows, columns) pixels whose line of sight meets the pin's front before the face.

    The pin's front is flat, so that its outline is that of its corners; it hides what is behind
    it and no part of the face comes through it.
    """
    top = surface.places[..., 1].max() + 20.0
    corners = np.array(
        [
            [x, y, pin.front]
            for x, y in (
                (pin.left, pin.bottom), (pin.right, pin.bottom), (pin.right, top), (pin.left, top)
            )
        ]
    )  # fmt: skip
    outline = project(camera, corners)[0]
    row, column = np.mgrid[: shape[0], : shape[1]]
    inside = np.ones(shape, dtype=np.bool_)
    side = np.roll(outline, -1, axis=0) - outline
    orientation = np.sign(side[0, 0] * side[1, 1] - side[0, 1] * side[1, 0])
    for start, along in zip(outline, side, strict=True):
        cross = along[0] * (row - start[1]) - along[1] * (column - start[0])
        inside &= orientation * cross >= 0.0
    return inside
