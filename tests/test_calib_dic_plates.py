"""Dots of a plate and corners of a chessboard in images whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from calib.dic.chessboard import Chessboard, chessboard_view
from calib.dic.dot_grid import DotPlate, dot_view
from calib.dic.plate_view import map_plane

PLATE = DotPlate(4.0, 5, 3)
RADIUS = 0.9
HOMOGRAPHY = np.array([[9.5, 1.1, 70.0], [0.9, -9.2, 220.0], [8e-4, 1.5e-3, 1.0]])
"""from mm of the plate to px; y of the plate points up"""
FINE = 4


def picture(draw, shape=(300, 400), noise=0.0, seed=0, homography=HOMOGRAPHY):
    """An image of `draw(x, y)` [mm] with FINE x FINE samples a pixel and some blur."""
    rows, columns = shape
    y, x = np.mgrid[: rows * FINE, : columns * FINE]
    pixels = (np.column_stack([x.ravel(), y.ravel()]) + 0.5) / FINE - 0.5
    places = map_plane(np.linalg.inv(homography), pixels)
    fine = draw(*places.T).reshape(rows, FINE, columns, FINE).mean(axis=(1, 3))
    image = gaussian_filter(fine, 0.8) * (1.0 + 0.3 * np.linspace(-1, 1, columns))
    return image + noise * np.random.default_rng(seed).standard_normal(shape)


def dots(missing=(), markers=((0, 0), (5, 0), (0, 3)), mirrored=False):
    def draw(x, y):
        i, j = np.round(x / 4.0), np.round(y / 4.0)
        distance = np.hypot(x - 4.0 * i, y - 4.0 * j)
        on = (i >= -1) & (i <= 6) & (j >= -1) & (j <= 4)
        for a, b in missing:
            on &= ~((i == a) & (j == b))
        hole = np.zeros(x.shape, bool)
        for a, b in markers:
            hole |= (i == a) & (j == b) & (distance < 0.4 * RADIUS)
        return np.where(on & (distance < RADIUS) & ~hole, 30.0, 180.0)

    return (lambda x, y: draw(y, x)) if mirrored else draw


def true_pixels(places):
    """Centres of the dots' images: those of the ellipses, not the images of the centres."""
    place = np.column_stack([places, np.ones(len(places))])
    dual = np.diag([RADIUS**2, RADIUS**2, 0.0]) - place[:, :, None] * place[:, None, :]
    conic = HOMOGRAPHY @ dual @ HOMOGRAPHY.T
    return conic[:, :2, 2] / conic[:, 2, 2:]


def test_dots_are_numbered_and_placed_to_a_hundredth_of_a_pixel():
    view = dot_view(picture(dots(), noise=1.5), PLATE, "plate")
    assert len(view.places) == 48
    off = view.pixels - true_pixels(view.places)
    assert np.sqrt((off**2).mean()) < 0.02
    assert view.radius == pytest.approx(RADIUS, rel=0.02)


def test_missing_dots_are_left_out_and_the_others_keep_their_numbers():
    missing = ((1, 1), (2, 1), (3, 2), (6, 4))
    view = dot_view(picture(dots(missing)), PLATE, "plate")
    assert len(view.places) == 44
    seen = {tuple(place) for place in np.round(view.places / 4.0).astype(int).tolist()}
    assert not seen & set(missing)
    assert np.abs(view.pixels - true_pixels(view.places)).max() < 0.05


@pytest.mark.parametrize(
    ("draw", "words"),
    [
        (dots(markers=((0, 0), (5, 0))), "found 2 dots with a bright centre"),
        (dots(markers=((0, 0), (3, 0), (0, 2))), "on a grid by the markers|steps from"),
        (dots(mirrored=True), "seen from the front"),
        (lambda x, y: np.full(x.shape, 100.0), "found 0 dots"),
    ],
)
def test_what_is_not_the_plate_is_refused(draw, words):
    with pytest.raises(ValueError, match=words) as caught:
        dot_view(picture(draw), PLATE, "plate")
    assert str(caught.value).startswith("plate:") and "\n" not in str(caught.value)


def squares(x, y):
    dark = (np.floor(x / 4.0) + np.floor(y / 4.0)) % 2 == 0
    return np.where(dark & (x > -4) & (x < 28) & (y > -4) & (y < 16), 30.0, 180.0)


def test_corners_are_found_and_the_board_has_one_way_up():
    board = Chessboard(7, 4, 4.0)
    down = np.array([[9.5, 1.1, 70.0], [0.9, 9.2, 60.0], [8e-4, 1.5e-3, 1.0]])
    image = picture(squares, noise=1.0, homography=down)
    view = chessboard_view(image, board, "board")
    assert np.abs(view.pixels - map_plane(down, view.places)).max() < 0.1
    # turned by 180 degrees, every corner keeps its place on the board
    again = chessboard_view(image[::-1, ::-1].copy(), board, "board")
    back = np.array([399.0, 299.0]) - again.pixels
    assert np.abs(back - view.pixels).max() < 0.1
    with pytest.raises(ValueError, match="found no chessboard of 7 x 4"):
        chessboard_view(image[:, :200].copy(), board, "board")
    with pytest.raises(ValueError, match="upside down"):
        Chessboard(7, 5, 4.0)
