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
    weights = _weights(settings)
    both = signal.fftconvolve(weights, weights[::-1, ::-1])
    far = len(weights) - 1
    both /= both[far, far]
    shape = np.broadcast_shapes(np.shape(x), np.shape(y))
    places = [np.broadcast_to(np.asarray(v, dtype=np.float64) + far, shape) for v in (y, x)]
    flat = np.array([place.ravel() for place in places])
    values = ndimage.map_coordinates(both, flat, order=1, mode="constant", cval=0.0)
    return np.asarray(values).reshape(shape)


def correlation_length(settings: CorrelationSettings) -> float:
    """Length L of exp(-d / L) that holds as much correlation over the plane as the errors do, px.

    Both integrals are equal: 2 pi L^2 and 1 / sum w^2, w being the weights of `error_correlation`.
    So as many points of a dense field count as independent. For order 1 it is S / sqrt(2 pi).
    """
    return float(1.0 / np.sqrt(2.0 * np.pi * np.sum(_weights(settings) ** 2)))


def _weights(settings: CorrelationSettings) -> Array:
    """(S, S) weights, of sum 1, of a subset's pixels in its displacement."""
    a = np.arange(-settings.radius, settings.radius + 1.0)
    one, b = np.ones_like(a), a[:, None]
    terms = [one[:, None] * one, one[:, None] * a, b * one]
    if settings.order == 2:
        terms += [one[:, None] * a**2, b * a, b**2 * one]
    design = np.stack([term.ravel() for term in terms], axis=1)
    return np.asarray(np.linalg.pinv(design)[0].reshape(a.size, a.size))
