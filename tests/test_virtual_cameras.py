"""Virtual cameras: every pixel shows the material point it should; light, noise and blur."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline
from stereo_scenes import CAMERAS, SPECKLE, face

from calib.dic.camera import project
from calib.optics.thin_lens import blur_circle, far_limit, hyperfocal_distance, near_limit
from calib.virtual.cameras import LENS_BLUR, CameraPair
from calib.virtual.render import Pin, render
from calib.virtual.sensor import Glare, Sensor, expose
from calib.virtual.speckle import SpeckleSettings, brightness
from calib.virtual.surface import make_surface


def test_every_pixel_shows_the_material_point_on_its_line_of_sight():
    surface = face((0.1, -0.05, 0.2), (0.05, -0.1), 0.6)
    for camera in (CAMERAS.rig.left, CAMERAS.rig.right):
        seen = render(surface, SPECKLE, CAMERAS, camera).material
        found = np.isfinite(seen[..., 0])
        row, column = np.nonzero(found)
        pixels = project(camera, surface.at(seen[found]))[0]
        assert np.abs(pixels - np.column_stack([column, row])).max() < 1e-8
        # the face fills a good part of the image
        assert 0.5 < found.mean() < 0.8


def test_brightness_is_the_speckles_about_a_sharp_pixel():
    camera = CAMERAS.rig.left
    picture = render(face(), SPECKLE, CAMERAS, camera)
    row, column = 75, 150
    point = picture.material[row, column]
    step = 1.0 / CAMERAS.px_per_mm
    offsets = np.random.default_rng(0).standard_normal((20_000, 2)) * CAMERAS.blur(
        np.array([CAMERAS.distance_mm])
    )
    c = np.cos(np.radians(CAMERAS.half_angle_deg))
    values = [
        brightness(point[0] + dx * step / c, point[1] + dy * step, *SPECKLE) for dx, dy in offsets
    ]
    assert picture.brightness[row, column] == pytest.approx(np.mean(values), abs=0.01)


def test_a_surface_is_a_cubic_spline_through_its_places():
    x, y = np.linspace(-1, 3, 12), np.linspace(0, 2, 9)
    places = np.stack([np.sin(x)[:, None] * np.cos(y), x[:, None] + y, x[:, None] * y**2], -1)
    surface = make_surface((-1, 0), (3, 2), places)
    at = np.random.default_rng(0).uniform((-1, 0), (3, 2), (200, 2))
    found = surface.at(at)
    for k in range(3):
        assert found[:, k] == pytest.approx(RectBivariateSpline(x, y, places[..., k]).ev(*at.T))
    assert np.isnan(surface.at(np.array([[3.1, 1.0]]))).all()
    with pytest.raises(ValueError, match="places"):
        make_surface((0, 0), (1, 1), places[:3])


def test_the_blur_at_the_limits_of_depth_of_field_is_the_circle_of_confusion():
    f, stop, focus, circle = 50.0, 8.0, 400.0, 0.01
    hyperfocal = hyperfocal_distance(f, stop, circle)
    near, far = near_limit(hyperfocal, focus, f), far_limit(hyperfocal, focus, f)
    assert blur_circle(f, stop, focus, near) == pytest.approx(circle, rel=1e-12)
    assert blur_circle(f, stop, focus, far) == pytest.approx(circle, rel=1e-12)
    assert blur_circle(f, stop, focus, focus) == 0.0


def test_blur_grows_away_from_the_focus():
    sharp, near, far = CAMERAS.blur(CAMERAS.distance_mm + np.array([0.0, -8.0, 8.0]))
    assert sharp == pytest.approx(np.sqrt(1 / 12 + LENS_BLUR**2))
    assert near > far > 1.5 * sharp


def test_cameras_look_at_their_target_from_both_sides():
    rig = CAMERAS.rig
    assert rig.angle == pytest.approx(2 * CAMERAS.half_angle_deg)
    middle = [(CAMERAS.columns - 1) / 2, (CAMERAS.rows - 1) / 2]
    for camera in (rig.left, rig.right):
        assert project(camera, np.array([CAMERAS.target]))[0][0] == pytest.approx(middle)
    assert rig.left.centre[0] < 0.0 < rig.right.centre[0]
    up = project(rig.left, np.array(CAMERAS.target) + np.array([[0.0, 0.1, 0.0]]))[0][0]
    assert up[1] < middle[1]


def test_noise_comes_after_sampling_and_is_as_large_as_stated():
    sensor = Sensor(read_noise=0.004, gain_drift=0.0, tilt_drift=0.0)
    flat = np.full((300, 300), 0.5)
    image = expose(flat, sensor, np.random.default_rng(0)).astype(float) / sensor.full_scale
    assert image.mean() == pytest.approx(0.5, abs=1e-4)
    assert image.std() == pytest.approx(sensor.noise_sd(np.array(0.5)), rel=0.02)
    beside = np.corrcoef(image[:, :-1].ravel(), image[:, 1:].ravel())[0, 1]
    assert abs(beside) < 0.015


def test_light_drifts_from_image_to_image_and_glare_saturates():
    sensor = Sensor(read_noise=0.0, full_well=1e12, gain_drift=0.05, tilt_drift=0.05)
    rng = np.random.default_rng(3)
    means = [expose(np.full((20, 30), 0.5), sensor, rng).mean() for _ in range(200)]
    assert np.std(means) / np.mean(means) == pytest.approx(0.05, rel=0.2)
    glare = Glare(((15.0, 10.0, 3.0, 2.0),))
    image = expose(np.full((20, 30), 0.5), sensor, rng, glare)
    assert image[10, 15] == sensor.full_scale == 4095 and image[0, 0] < 2600
    assert image.dtype == np.uint16


def test_the_pin_hides_what_is_behind_it():
    camera = CAMERAS.rig.left
    free = render(face(), SPECKLE, CAMERAS, camera)
    hidden = render(face(), SPECKLE, CAMERAS, camera, Pin(-0.5, 0.5, 1.5, 0.2))
    gone = np.isfinite(free.material[..., 0]) & ~np.isfinite(hidden.material[..., 0])
    x, y = free.material[gone].T
    # seen from the left, the pin's front, which stands out, hides what lies to its right
    shift = 0.2 * np.tan(np.radians(CAMERAS.half_angle_deg))
    assert x.min() == pytest.approx(-0.5 + shift, abs=0.03)
    assert x.max() == pytest.approx(0.5 + shift, abs=0.03)
    assert y.min() == pytest.approx(1.5, abs=0.03)
    assert np.all(hidden.brightness[gone] == Pin(0, 0, 0, 0).brightness)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: CameraPair(distance_mm=50.0), "beyond focal_length_mm"),
        (lambda: CameraPair(half_angle_deg=0.0), "half_angle_deg"),
        (lambda: Sensor(bits=4), "bits"),
        (lambda: Sensor(read_noise=-0.1), "read_noise"),
        (lambda: SpeckleSettings(diameter=0.0), "diameter"),
        (lambda: SpeckleSettings(bright=0.1, dark=0.2), "dark < bright"),
    ],
)
def test_impossible_cameras_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
