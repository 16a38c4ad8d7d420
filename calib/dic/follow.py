"""Points followed through a series of images, with a renewed reference where the first fails.

Displacements are always those of the points of the first image, from it. As long as a point
correlates with the first image, it is measured against that alone, so that errors do not add up.
Where it does not (large strain, changed surface), the increment from a later image, in which it
was found, is added, and with it the variance of that step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calib.dic.carried_mask import carried_mask
from calib.dic.correlate import Correlation, correlate_prepared
from calib.dic.interpolation import Array, Spline
from calib.dic.prepared import BoolArray, IntArray, Reference, as_image, deformed_spline, prepare
from calib.dic.progress import Progress, in_turn
from calib.dic.reasons import Reason
from calib.dic.settings import CorrelationSettings

LEAST_KEPT = 0.5
"""share of the valid points that a guess has to keep; else the search starts from scratch"""
GOOD = 0.9
"""correlation below which a later reference is tried too"""
RENEWED = (
    Reason.LOW_CORRELATION,
    Reason.NOT_CONVERGED,
    Reason.NOT_REACHED,
    Reason.STRAY,
    Reason.UNCERTAIN,
)
"""reasons that a later reference may mend"""


class Base(NamedTuple):
    """A later image as reference."""

    number: int
    """of the frame, from 1"""
    image: Array
    found: Correlation
    """where the points are in it"""


class State(NamedTuple):
    """What the next frame starts from."""

    last: Base | None = None
    base: Base | None = None
    """the later image from which points were last measured that the first one lost"""


def follow(
    reference: Reference,
    frames: Iterable[Array],
    points: Array,
    settings: CorrelationSettings,
) -> Iterator[Correlation]:
    """Correlate points (n, 2) of the reference, px, with one image (h, w) after the other.

    Raises ValueError as `correlate`.
    """
    state = State()
    for frame in frames:
        state = next_state(reference, frame, points, settings, state)
        assert state.last is not None
        yield state.last.found


def next_state(
    reference: Reference,
    frame: Array,
    points: Array,
    settings: CorrelationSettings,
    state: State,
    progress: Progress | None = None,
) -> State:
    """Correlate one more frame (h, w); the result is `last.found`.

    Raises ValueError as `correlate`.
    """
    number = 1 if state.last is None else state.last.number + 1
    image = as_image(frame, f"frame {number}")
    spline = deformed_spline(image, settings)
    previous = None if state.last is None else state.last.found
    following = in_turn(progress)
    found = _direct(reference, image, spline, points, settings, previous, following)
    base = state.base
    for candidate, least in ((state.base, GOOD), (state.last, 0.0)):
        if candidate is not None and _broken(found, candidate.found).any():
            asked = replace(settings, min_zncc=max(settings.min_zncc, least))
            found = _renewed(candidate, reference, image, spline, points, asked, found, following())
            base = candidate
    return State(Base(number, image, found), base)


def _direct(
    reference: Reference,
    image: Array,
    spline: Spline,
    points: Array,
    settings: CorrelationSettings,
    previous: Correlation | None,
    following: Callable[[], Progress | None],
) -> Correlation:
    """Against the first image, from where the points were in the frame before."""
    if previous is None or not previous.valid.any():
        return correlate_prepared(reference, image, spline, points, settings, progress=following())
    found = correlate_prepared(
        reference, image, spline, points, settings, previous.parameters, following()
    )
    if found.valid.sum() >= LEAST_KEPT * previous.valid.sum():
        return found
    again = correlate_prepared(reference, image, spline, points, settings, progress=following())
    return again if again.valid.sum() > found.valid.sum() else found


def _broken(found: Correlation, before: Correlation) -> BoolArray:
    """(n,) points lost, or changed much, that the earlier frame has."""
    weak = np.isin(found.reason, RENEWED) | (found.valid & (found.zncc < GOOD))
    return np.asarray(weak & before.valid)


def _as_reference(
    base: Base, first: Reference, points: Array, lost: IntArray, settings: CorrelationSettings
) -> Reference:
    """The base image as a reference, in which the region of the first one has moved with it.

    As far as it concerns the `lost` (m,) among the points, which are valid in that image.
    """
    mask = None
    if not first.mask.all():
        has, found = base.found.valid, base.found
        places = points[has] + found.displacement[has]
        shape = (base.image.shape[0], base.image.shape[1])
        moved = (points[has], places, found.gradient[has])
        wanted = np.searchsorted(np.flatnonzero(has), lost)
        mask = carried_mask(first.mask, *moved, wanted, settings.radius, shape)
    return prepare(base.image, settings.degree, mask, settings.blur)


def _renewed(
    base: Base,
    first: Reference,
    image: Array,
    spline: Spline,
    points: Array,
    settings: CorrelationSettings,
    found: Correlation,
    progress: Progress | None,
) -> Correlation:
    """`found` with broken points measured from the base image, where that has less uncertainty."""
    lost = np.flatnonzero(_broken(found, base.found))
    before = base.found
    places = points[lost] + before.displacement[lost]
    renewed = _as_reference(base, first, points, lost, settings)
    step = correlate_prepared(renewed, image, spline, places, settings, progress=progress)
    sigma_sum = np.hypot(before.sigma[lost], step.sigma)
    worse = found.valid[lost] & ~(sigma_sum.max(axis=1) < found.sigma[lost].max(axis=1))
    good = step.valid & ~worse & (sigma_sum.max(axis=1) <= settings.max_sigma)
    index = lost[good]
    eye = np.eye(2)
    displacement, gradient = found.displacement.copy(), found.gradient.copy()
    sigma, reason, zncc = found.sigma.copy(), found.reason.copy(), found.zncc.copy()
    parameters, iterations = found.parameters.copy(), found.iterations.copy()
    displacement[index] = before.displacement[index] + step.displacement[good]
    # F of both steps, one after the other
    gradient[index] = (eye + step.gradient[good]) @ (eye + before.gradient[index]) - eye
    sigma[index] = sigma_sum[good]
    wave = found.interpolation.copy()
    wave[index] = np.hypot(before.interpolation[index], step.interpolation[good])
    reason[index], zncc[index] = Reason.VALID, step.zncc[good]
    iterations[index] += step.iterations[good]
    parameters[index] = 0.0
    parameters[index, :2] = displacement[index]
    parameters[index, 2:6] = gradient[index].reshape(-1, 4)
    return replace(
        found,
        displacement=displacement,
        gradient=gradient,
        zncc=zncc,
        sigma=sigma,
        interpolation=wave,
        reason=reason,
        iterations=iterations,
        parameters=parameters,
    )
