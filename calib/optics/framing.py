"""From a field of view to pixels on a sample that is seen at an angle (thesis, Appendix A.1).

All lengths in mm, all angles in degrees. Functions take numbers or arrays that broadcast.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from calib.optics.thin_lens import Values


def aspect_angle(height_per_width: Values) -> Values:
    """Eq. A.6: angle between diagonal and width of the frame, arctan(L_y / L_x), degrees."""
    return np.degrees(np.arctan(height_per_width))


def frame_width(diagonal: Values, aspect_angle: Values) -> Values:
    """Eq. A.7: width L_x of a field with this diagonal, mm."""
    return diagonal * np.cos(np.radians(aspect_angle))


def frame_height(diagonal: Values, aspect_angle: Values) -> Values:
    """Eq. A.8: height L_y of a field with this diagonal, mm."""
    return diagonal * np.sin(np.radians(aspect_angle))


def half_depth(width: Values, angle: Values) -> Values:
    """Eq. A.9: B, how far the edge of a sample of this width is from the plane of focus, mm.

    `angle` is that between the camera's axis and the normal of the sample. (The thesis prints the
    aspect ratio's angle phi, but calculates with that of the camera.)
    """
    return width / 2 * np.sin(np.radians(angle))


def projected_width(width: Values, angle: Values) -> Values:
    """Eq. A.10: A, width of the sample as the camera sees it at `angle`, mm."""
    return width * np.cos(np.radians(angle))


def pixel_size(field: Values, pixels: Values) -> Values:
    """Eqs. A.11 and A.12: length in the object that one pixel sees, mm."""
    return field / pixels


def pixels_across(length: Values, pixel_size: Values) -> Values:
    """Eqs. A.13 and A.14: pixels along a length of the object that is parallel to the sensor."""
    return length / pixel_size


def clear_distance(barrel_diameter: Values, half_angle: Values) -> Values:
    """Smallest distance from the object to the front rims of two cameras that do not touch, mm.

    Rims of diameter D at distance w, turned by the half stereo angle from their common plane, are
    w sin(angle) from it at their centres and reach (D/2) cos(angle) towards it.
    """
    return barrel_diameter / (2 * np.tan(np.radians(half_angle)))


def depth_needed(width: Values, out_of_plane: Values, half_angle: Values) -> Values:
    """Depth along a camera's axis that a face seen at `half_angle` takes while it moves, mm.

    2 B for the face, and the component of its out-of-plane displacement along the axis.
    """
    return 2 * half_depth(width, half_angle) + out_of_plane * np.cos(np.radians(half_angle))


def in_plane_noise(match_noise: Values, half_angle: Values) -> Values:
    """Standard deviation of a displacement across the face, match noise / (sqrt(2) cos), mm.

    From x1, x2 = X cos(angle) +- Z sin(angle), seen by the two cameras with independent errors of
    `match_noise` mm on the sample; see `out_of_plane_noise` for Z.
    """
    return match_noise / (sqrt(2) * np.cos(np.radians(half_angle)))


def out_of_plane_noise(match_noise: Values, half_angle: Values) -> Values:
    """Standard deviation of a displacement along the normal, match noise / (sqrt(2) sin), mm."""
    return match_noise / (sqrt(2) * np.sin(np.radians(half_angle)))
