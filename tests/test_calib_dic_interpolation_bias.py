"""The bias that interpolation makes, as predicted from the images, against what it is."""

from functools import cache

import numpy as np
import pytest

from benchmarks.exact_speckle import exposed, speckle
from calib.dic import CorrelationSettings, correlate, prepare
from calib.dic.interpolation_bias import (
    REACH,
    differences,
    error_filter,
    error_images,
    spline_transfer,
)
from calib.dic.noise_response import noise_of_spline

W, H = 140, 110
X, Y = np.arange(float(W)), np.arange(float(H))
NOISE = 2.0


def points(step):
    x, y = np.meshgrid(np.arange(22.0, W - 22, step), np.arange(22.0, H - 22, step))
    return np.column_stack([x.ravel(), y.ravel()])


@cache
def seen(shift=(0.0, 0.0), stretch=1.0):
    """Speckles of some 3 px, the finest that a sensor can show."""
    pattern = speckle(W, H, np.random.default_rng(3), 0.9)
    return pattern((X - shift[0]) / stretch, (Y - shift[1]) / stretch)


def pair(shift, seed, noise=NOISE):
    rng, spread = np.random.default_rng(seed), seen().std()
    return [exposed(grey, rng, noise, spread=spread) for grey in (seen(), seen(shift))]


def test_transfer_of_the_cubic_spline_is_its_closed_form():
    v = np.array([0.1, 0.3, 0.7])
    exact = np.sinc(v) ** 4 * 3 / (2 + np.cos(2 * np.pi * v))
    np.testing.assert_allclose(spline_transfer(3, v), exact, rtol=1e-5)


@pytest.mark.parametrize("degree", [3, 5])
def test_filter_has_the_share_of_the_aliases_below_three_tenths_of_a_wave(degree):
    v = np.linspace(0.0, 0.3, 13)
    waves = 2 * np.sin(2 * np.pi * v[:, None] * np.arange(1, REACH + 1))
    share = spline_transfer(degree, v - 1) - spline_transfer(degree, v + 1)
    np.testing.assert_allclose(waves @ error_filter(degree), share, atol=6e-4)


def test_filter_goes_along_rows_and_down_columns_with_mirrored_borders():
    image = np.random.default_rng(0).normal(size=(9, 14))
    taps = np.array([0.5, -0.2, 0.1])
    out = np.empty((2, 9, 14))
    differences(image, taps, *out)
    whole = np.pad(image, 3, mode="reflect")
    rows, columns = (
        sum(t * (np.roll(whole, -k, axis) - np.roll(whole, k, axis)) for k, t in enumerate(taps, 1))
        for axis in (1, 0)
    )
    np.testing.assert_allclose(out[0], rows[3:-3, 3:-3], atol=1e-12)
    np.testing.assert_allclose(out[1], columns[3:-3, 3:-3], atol=1e-12)


@pytest.mark.parametrize("degree", [3, 5])
def test_predicted_wave_is_the_measured_bias_on_sharp_speckle(degree):
    """Each subset's own error, without noise: bias over the pattern and differences between."""
    measured, predicted = [], []
    places = points(12)
    for move in ((0.25, 0.75), (0.6, 0.4), (0.75, 0.15)):
        found = correlate(*pair(move, 0, noise=0.0), places, CorrelationSettings(degree=degree))
        measured.append(found.displacement - move)
        predicted.append(found.interpolation * np.sign(np.sin(2 * np.pi * np.array(move))))
    m, p = np.ravel(measured), np.ravel(predicted)
    assert np.abs(p).max() > (0.006 if degree == 3 else 0.002)
    assert m @ p / (p @ p) == pytest.approx(1.0, abs=0.2)
    assert np.corrcoef(m, p)[0, 1] > 0.9


def test_noise_adds_nothing_to_the_predicted_wave():
    amplitudes = [
        np.median(correlate(*pair((0.25, 0.25), 1, noise), points(16)).interpolation)
        for noise in (0.0, 6.0)
    ]
    assert amplitudes[1] == pytest.approx(amplitudes[0], rel=0.15)


@pytest.mark.parametrize("blur", [0.0, 0.7])
def test_noise_of_slopes_and_errors_is_that_of_blurred_noise(blur):
    ready = prepare(np.random.default_rng(0).normal(size=(250, 250)), 5, blur=blur)
    variance, noise = ready.image.var(), noise_of_spline(5, blur)
    assert ready.slope_x.var() / variance == pytest.approx(noise.slope, rel=0.03)
    assert np.mean(ready.slope_x * ready.error_x) / variance == pytest.approx(noise.error, rel=0.1)


def test_blur_lowers_the_bias_and_its_noise_is_stated():
    places, move = points(16), (0.25, -0.25)
    bias, predicted = {}, {}
    for blur in (0.0, 0.8):
        settings = CorrelationSettings(blur=blur)
        found = correlate(*pair(move, 0, noise=0.0), places, settings)
        bias[blur] = np.abs((found.displacement - move).mean(axis=0)).mean()
        predicted[blur] = found.interpolation.mean()
    assert bias[0.8] < 0.3 * bias[0.0]
    assert predicted[0.8] < 0.3 * predicted[0.0]
    # 12 noises of the same places: their scatter about each place's mean
    frames = [correlate(*pair(move, seed), places, settings) for seed in range(12)]
    spread = np.var([one.displacement for one in frames], axis=0, ddof=1)
    stated = np.mean([one.sigma**2 for one in frames], axis=0)
    assert np.sqrt(np.mean(spread / stated)) == pytest.approx(1.0, abs=0.12)


def test_a_stretch_over_whole_pixels_leaves_less_of_the_wave():
    rng, still = np.random.default_rng(0), seen()
    a, b = (exposed(grey, rng, NOISE, spread=still.std()) for grey in (still, seen(stretch=1.05)))
    whole = correlate(*pair((0.25, 0.25), 0), points(20)).interpolation
    left = correlate(a, b, points(20)).interpolation
    assert np.nanmean(left) < 0.4 * whole.mean()


def test_an_image_has_not_moved_from_itself():
    image = pair((0.25, 0.25), 0)[0]
    found = correlate(image, image, points(30))
    assert found.valid.all()
    np.testing.assert_allclose(found.displacement, 0.0, atol=1e-6)
    assert found.total.max() < 1e-6


def test_blur_out_of_its_range_is_refused():
    with pytest.raises(ValueError, match="blur: expected 0 to 3 px, found 4"):
        CorrelationSettings(blur=4.0)


def test_error_images_of_a_constant_are_nothing():
    for image in error_images(np.full((20, 30), 7.0), 5):
        np.testing.assert_allclose(image, 0.0, atol=1e-12)
