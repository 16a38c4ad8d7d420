"""Whether a sample's field has the shape of the others': a turned sign or another scale has not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.data.qc.quality import ODD_FIELD, Rejection
from calib.data.readers.frames import BoolArray
from fe.response import Array

COMPONENTS = ("x", "y", "z")
FEWEST = 3
"""samples: of two neither is the usual one"""
FEWEST_POINTS = 10
"""that all samples have in all frames"""
SMALL = 0.1
"""share of the largest field's size below which a component says nothing"""
APART = 0.15
"""misfit of a component, over its size, above which a sample is told: virtual laboratories, whose
samples differ in place, height and stiffness, have 0.03"""


def unlike(names: Sequence[str], fields: Array, rejections: Sequence[Rejection]) -> list[Rejection]:
    """Samples of which a displacement is no multiple of about one of most others'.

    Of those that meet the rules before, from three on; fields (n_sample, n_step, n, 3) mm, NaN
    where there is nothing.
    """
    rejected = {one.sample for one in rejections}
    good = [i for i, name in enumerate(names) if name not in rejected]
    products = _products(fields[good])
    if products is None:
        return []
    own = np.einsum("ciis->cis", products).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = products.sum(axis=-1) / own[:, None, :]
    found = []
    for component in np.flatnonzero(_says(own)):
        for place, i in enumerate(good):
            others = np.delete(slopes[component, place], place)
            odd = (others < 1.0 / ODD_FIELD) | (others > ODD_FIELD)
            if np.count_nonzero(odd) > len(others) / 2:
                reason = f"displacement along {COMPONENTS[component]} over that of the others"
                expected = f"{1 / ODD_FIELD:g} to {ODD_FIELD:g} (another sign or unit?)"
                value = float(f"{np.median(others):.3g}")
                found.append(Rejection(names[i], "protocol", reason, value, expected, ""))
    return found


def unlike_doubts(names: Sequence[str], fields: Array, numbers: Sequence[int]) -> list[str]:
    """A sentence for each sample whose field is off most others' by more than samples differ.

    `fields` (n_sample, n_step, n, 3) mm of the samples kept, `numbers` of their increments.
    """
    products = _products(fields)
    if products is None:
        return []
    own = np.einsum("ciis->cis", products)
    # |f_i - f_j|^2 over |f_j|^2, by component, pair and step
    squared = own[:, :, None] + own[:, None, :] - 2.0 * products
    said, says = [], _says(own)
    for i, name in enumerate(names):
        others = np.delete(np.arange(len(names)), i)
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.sqrt(np.maximum(squared[:, i, others], 0.0) / own[:, others])
        usual = np.where(says, np.sort(size, axis=1)[:, (len(others) - 1) // 2], 0.0)
        component, step = divmod(int(np.argmax(usual)), usual.shape[1])
        if usual[component, step] > APART:
            said.append(
                f"the displacement of sample {name} along {COMPONENTS[component]} is "
                f"{usual[component, step]:.0%} off that of most others, at worst at increment "
                f"{numbers[step]}: another scale or sign, a camera that moved, or another contact?"
            )
    return said


def _products(fields: Array) -> Array | None:
    """(3, n_sample, n_sample, n_step) sums over points of products; None where they say nothing."""
    if len(fields) < FEWEST:
        return None
    both = np.isfinite(fields).all(axis=(0, 1, 3))
    if np.count_nonzero(both) < FEWEST_POINTS:
        return None
    shared = fields[:, :, both]
    products: Array = np.einsum("isnc,jsnc->cijs", shared, shared, optimize=True)
    return products


def _says(squared: Array) -> BoolArray:
    """(3, ...) whether components of squared size (3, n_sample, ...) mm2 are more than noise.

    In every sample: what is a small part of the largest field is noise, which has no shape.
    """
    largest = squared.mean(axis=1).sum(axis=0).max()
    says: BoolArray = squared.min(axis=1) > SMALL**2 * largest
    return says
