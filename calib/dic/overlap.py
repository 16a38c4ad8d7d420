"""How errors of points go together whose subsets overlap."""

from __future__ import annotations

import numpy as np
from scipy import ndimage, signal

from calib.dic.interpolation import Array
from calib.dic.settings import CorrelationSettings


def error_correlation(settings: CorrelationSettings, x: Array, y: Array) -> Array:
    """Correlation of the errors of one displacement component at two points x, y px apart.

    By white noise of the images, the speckle being the same everywhere on average: the
    displacement is a weighted mean over the subset, the weights being those of a polynomial of
    the shape function's order fitted to its pixels; the correlation is that of two such means.
    For order 1 it is (1 - |x|/S) (1 - |y|/S) within the subset's side S, else 0. x and y of any
    shapes that broadcast.
    """
    a = np.arange(-settings.radius, settings.radius + 1.0)
    one, b = np.ones_like(a), a[:, None]
    terms = [one[:, None] * one, one[:, None] * a, b * one]
    if settings.order == 2:
        terms += [one[:, None] * a**2, b * a, b**2 * one]
    design = np.stack([term.ravel() for term in terms], axis=1)
    weights = np.linalg.pinv(design)[0].reshape(a.size, a.size)
    both = signal.fftconvolve(weights, weights[::-1, ::-1])
    both /= both[a.size - 1, a.size - 1]
    far = a.size - 1
    shape = np.broadcast_shapes(np.shape(x), np.shape(y))
    places = [np.broadcast_to(np.asarray(v, dtype=np.float64) + far, shape) for v in (y, x)]
    flat = np.array([place.ravel() for place in places])
    values = ndimage.map_coordinates(both, flat, order=1, mode="constant", cval=0.0)
    return np.asarray(values).reshape(shape)
