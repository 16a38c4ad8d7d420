"""Region of one image in another: by an affine map it is known to the pixel."""

import numpy as np

from calib.dic.carried_mask import carried_mask

F = np.array([[1.2, 0.3], [-0.2, 0.9]])
SHIFT = np.array([25.0, 40.0])
RADIUS = 6


def moved(points):
    return points @ F.T + SHIFT


def test_a_region_goes_with_its_points_and_ends_where_their_subsets_end():
    mask = np.zeros((80, 90), dtype=bool)
    mask[20:50, 15:70] = True
    mask[30:36, 40:50] = False  # a hole
    x, y = np.meshgrid(np.arange(15.0, 70.0, 5), np.arange(20.0, 50.0, 5))
    points = np.column_stack([x.ravel(), y.ravel()])
    gradient = np.broadcast_to(F - np.eye(2), (len(points), 2, 2))
    found = carried_mask(
        mask, points, moved(points), gradient, np.arange(len(points)), RADIUS, (140, 160)
    )
    row, column = np.mgrid[:140, :160]
    pixels = np.stack([column, row], axis=-1)
    back = np.round((pixels - SHIFT) @ np.linalg.inv(F).T).astype(int)
    inside = np.all((back >= 0) & (back < [90, 80]), axis=-1)
    expected = np.zeros((140, 160), dtype=bool)
    expected[inside] = mask[back[inside][:, 1], back[inside][:, 0]]
    here = np.round(moved(points)).astype(int)
    near = np.zeros((140, 160), dtype=bool)
    for a, b in here:
        near[max(b - RADIUS, 0) : b + RADIUS + 1, max(a - RADIUS, 0) : a + RADIUS + 1] = True
    there = np.zeros((140, 160), dtype=bool)
    there[here[:, 1], here[:, 0]] = True
    assert expected.any() and (near & ~expected).any()
    assert (found == (expected & near))[~there].all()


def test_a_point_keeps_what_the_mask_says_of_it():
    """Also at the region's edge, where rounding would put it outside."""
    mask = np.zeros((40, 40), dtype=bool)
    mask[:, :20] = True
    points = np.array([[19.0, 10.0], [19.0, 25.0], [20.0, 30.0]])
    gradient = np.zeros((3, 2, 2))
    every = np.arange(3)
    found = carried_mask(mask, points, points + np.array([0.4, 0.0]), gradient, every, 3, (40, 40))
    assert found[10, 19] and found[25, 19] and not found[30, 20]
    far = carried_mask(mask, points, points + 100.0, gradient, every, 3, (40, 40))
    assert not far.any()


def test_subsets_that_are_not_asked_for_are_not_carried():
    mask = np.ones((40, 40), dtype=bool)
    points = np.array([[10.0, 10.0], [30.0, 30.0]])
    found = carried_mask(mask, points, points, np.zeros((2, 2, 2)), np.array([1]), 3, (40, 40))
    assert found.sum() == 49 and found[27:34, 27:34].all()
