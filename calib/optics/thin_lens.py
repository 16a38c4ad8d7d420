"""A thin lens in air: magnification, distances, depth of field, diffraction. All lengths in mm.

Object and image distances are measured from the lens (its principal planes), not from the sensor.
Every function takes numbers or arrays that broadcast, and returns the broadcast shape.

Source: the Gaussian lens equation 1/f = 1/u + 1/v; S. F. Ray, "Applied Photographic Optics",
3rd ed., Focal Press 2002. Equations A.1 to A.5 are those of the thesis' Appendix A.1.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Values = float | npt.NDArray[np.float64]

CIRCLES_PER_DIAGONAL = 1500
"""Zeiss formula, Eq. A.2: circles of confusion along the sensor's diagonal"""


def circle_of_confusion(sensor_diagonal: Values) -> Values:
    """Eq. A.2 (Zeiss formula): largest blur that counts as sharp, mm on the sensor."""
    return sensor_diagonal / CIRCLES_PER_DIAGONAL


def hyperfocal_distance(focal_length: Values, f_stop: Values, circle: Values) -> Values:
    """Eq. A.1: f^2 / (N c), mm; the exact thin-lens value is one focal length more."""
    return focal_length**2 / (f_stop * circle)


def near_limit(hyperfocal: Values, object_distance: Values, focal_length: Values) -> Values:
    """Eq. A.3: nearest distance from the lens that is sharp, mm.

    Exact for a thin lens, with the hyperfocal distance of Eq. A.1.
    """
    return hyperfocal * object_distance / (hyperfocal + (object_distance - focal_length))


def far_limit(hyperfocal: Values, object_distance: Values, focal_length: Values) -> Values:
    """Eq. A.4: farthest distance from the lens that is sharp, mm; infinite beyond hyperfocal."""
    rest = np.asarray(hyperfocal - (object_distance - focal_length), dtype=np.float64)
    with np.errstate(divide="ignore"):
        far = np.where(rest > 0, hyperfocal * object_distance / rest, np.inf)
    return far if far.ndim else float(far)


def far_field_of_view(sensor: Values, object_distance: Values, focal_length: Values) -> Values:
    """Eq. A.5: d OD / FL, mm: the field when the object is far away compared with f.

    It is wider than `field_of_view` by the factor OD / (OD - FL).
    """
    return sensor * object_distance / focal_length


def magnification(focal_length: Values, object_distance: Values) -> Values:
    """Size of the image per size of the object, f / (u - f); the object is beyond the focus."""
    return focal_length / (object_distance - focal_length)


def object_distance_at(focal_length: Values, extension: Values) -> Values:
    """Distance u of what is sharp with the lens `extension` beyond its place for infinity, mm.

    From v = f + extension: u = f + f^2 / extension (Newton's form of the lens equation).
    """
    return focal_length + focal_length**2 / extension


def extension_at(focal_length: Values, object_distance: Values) -> Values:
    """How far the lens is beyond its place for infinity to focus at `object_distance`, mm."""
    return focal_length**2 / (object_distance - focal_length)


def field_of_view(sensor: Values, magnification: Values) -> Values:
    """Length in the object that fills `sensor` (a side or the diagonal), mm."""
    return sensor / magnification


def effective_f_stop(f_stop: Values, magnification: Values) -> Values:
    """N (1 + m): the f-stop that light and diffraction see at close range (symmetric pupils)."""
    return f_stop * (1 + magnification)


def airy_diameter(effective_f_stop: Values, wavelength: Values) -> Values:
    """Diameter of the first dark ring of diffraction, 2.44 lambda N, mm on the sensor."""
    return 2.44 * wavelength * effective_f_stop


def blur_circle(
    focal_length: Values, f_stop: Values, focus: Values, object_distance: Values
) -> Values:
    """Diameter of the image of a point at `object_distance` when `focus` is sharp, mm.

    f / N times the magnification at the focus times |u - u0| / u; at the limits of Eqs. A.3 and
    A.4 it is the circle of confusion.
    """
    aperture = focal_length / f_stop
    off: Values = np.abs(object_distance - focus) / object_distance
    return aperture * magnification(focal_length, focus) * off
