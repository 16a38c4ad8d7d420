"""A stereo DIC set-up and what it sees of a sample; lengths in mm, angles in degrees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from calib.optics.design_file import Camera, Limits, Sample
from calib.optics.framing import (
    clear_distance,
    depth_needed,
    in_plane_noise,
    out_of_plane_noise,
    pixels_across,
    projected_width,
)
from calib.optics.thin_lens import (
    Values,
    airy_diameter,
    circle_of_confusion,
    effective_f_stop,
    extension_at,
    far_limit,
    field_of_view,
    hyperfocal_distance,
    magnification,
    near_limit,
)


@dataclass(frozen=True)
class Setup:
    """Two like cameras that look at a face from the same half stereo angle.

    Each field is a number, or an array that broadcasts with those of the others.
    """

    focal_length: Values
    """mm"""
    object_distance: Values
    """from the lens to the plane in focus, mm"""
    f_stop: Values
    """as engraved, for an object far away"""
    half_angle: Values
    """between a camera's axis and the normal of the face, degrees"""


@dataclass(frozen=True)
class View:
    """What a set-up sees; every field has the broadcast shape of the set-up's fields."""

    magnification: Values
    """image per object, 1"""
    extension: Values
    """of the lens beyond its place for infinity, by focusing and by tubes, mm"""
    field_width: Values
    """width of what one camera sees, in its plane of focus, mm"""
    field_height: Values
    """mm"""
    depth_of_field: Values
    """far limit less near limit, mm"""
    depth_needed: Values
    """what the face takes along a camera's axis, mm"""
    clear_distance: Values
    """smallest distance at which the two lenses do not touch, mm"""
    pixels_x: Values
    """pixels along the width of the face"""
    pixels_y: Values
    """pixels along the height of the face"""
    airy_pixels: Values
    """diameter of the diffraction pattern, pixels"""
    speckle: Values
    """diameter of the smallest speckle that is resolved, mm on the sample"""
    subset_pixels: Values
    """side of a subset, pixels"""
    subsets: Values
    """subsets on the face that do not overlap, width times height (not rounded)"""
    points: Values
    """displacement points on the face, subsets overlapping by the step"""
    in_plane_noise: Values
    """standard deviation of a displacement across the face, mm"""
    out_of_plane_noise: Values
    """standard deviation of a displacement along the normal of the face, mm"""


def view(
    setup: Setup, sample: Sample, camera: Camera, limits: Limits, barrel_diameter: float
) -> View:
    """What `setup` sees of `sample`.

    Speckles are as large as the finest that neither aliases nor is lost to diffraction. The face
    is foreshortened in width only. Source: thesis A.3, A.4, A.9 to A.14, with the magnification of
    the thin lens instead of Eq. A.5.
    """
    circle = limits.circle_of_confusion or circle_of_confusion(camera.diagonal)
    scale = magnification(setup.focal_length, setup.object_distance)
    hyperfocal = hyperfocal_distance(setup.focal_length, setup.f_stop, circle)
    near = near_limit(hyperfocal, setup.object_distance, setup.focal_length)
    far = far_limit(hyperfocal, setup.object_distance, setup.focal_length)
    pixel = camera.pixel / scale
    airy = airy_diameter(effective_f_stop(setup.f_stop, scale), limits.wavelength) / camera.pixel
    speckle_pixels = np.maximum(limits.speckle_pixels, airy)
    subset = limits.subset_speckles * speckle_pixels
    pixels_x = pixels_across(projected_width(sample.width, setup.half_angle), pixel)
    pixels_y = pixels_across(sample.height, pixel)
    step = limits.step_share * subset
    return View(
        magnification=scale,
        extension=extension_at(setup.focal_length, setup.object_distance),
        field_width=field_of_view(camera.width, scale),
        field_height=field_of_view(camera.height, scale),
        depth_of_field=far - near,
        depth_needed=depth_needed(sample.width, sample.out_of_plane, setup.half_angle),
        clear_distance=clear_distance(barrel_diameter, setup.half_angle),
        pixels_x=pixels_x,
        pixels_y=pixels_y,
        airy_pixels=airy,
        speckle=speckle_pixels * pixel,
        subset_pixels=subset,
        subsets=(pixels_x / subset) * (pixels_y / subset),
        points=_along(pixels_x, subset, step) * _along(pixels_y, subset, step),
        in_plane_noise=in_plane_noise(limits.matching_noise * pixel, setup.half_angle),
        out_of_plane_noise=out_of_plane_noise(limits.matching_noise * pixel, setup.half_angle),
    )


def _along(pixels: Values, subset: Values, step: Values) -> Values:
    """Subsets that lie wholly within a length, at this step; all in pixels."""
    count: Values = np.maximum(np.floor((pixels - subset) / step) + 1, 0.0)
    return count


@dataclass(frozen=True)
class Limit:
    """One condition on a set-up: `demand` is how often its need exceeds what it has."""

    name: str
    """what is too little or too much when it is not met"""
    demand: npt.NDArray[np.float64]
    """need / have, of the broadcast shape; met when 1 or less"""


def conditions(
    setup: Setup, seen: View, camera: Camera, limits: Limits, image_circle: float
) -> tuple[Limit, ...]:
    """All conditions on a usable set-up, each as need over have."""
    frame = (1 - limits.margin) * np.array([camera.columns, camera.rows])
    room = np.maximum(limits.smallest_distance, seen.clear_distance)
    shape = np.broadcast_shapes(*(np.shape(value) for value in vars(seen).values()))
    demands = {
        "image circle": camera.diagonal / image_circle,
        "field width": seen.pixels_x / frame[0],
        "field height": seen.pixels_y / frame[1],
        "depth of field": seen.depth_needed / seen.depth_of_field,
        "working distance": room / setup.object_distance,
        "points": limits.least_points / np.maximum(seen.points, 0.5),
    }
    if limits.out_of_plane_noise is not None:
        demands["out-of-plane noise"] = seen.out_of_plane_noise / limits.out_of_plane_noise
    return tuple(
        Limit(name, np.broadcast_to(np.asarray(demand, dtype=np.float64), shape))
        for name, demand in demands.items()
    )
