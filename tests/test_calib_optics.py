"""Lens formulas against geometry, and the search against brute force and its closed form."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import cos, radians, sin, sqrt, tan

import numpy as np
import pytest
from scipy.special import jn_zeros

from calib.data.thesis import thesis_table
from calib.optics import framing, thin_lens
from calib.optics.design_file import Camera, Choices, Design, Lens, Limits, Sample, load_design
from calib.optics.search import reach, search
from calib.optics.setup import Setup, conditions, view
from calib.optics.tables import found_table, verdicts

CAMERA = Camera(columns=2448, rows=2050, pixel=0.00345)
SAMPLE = Sample(width=4, height=2, out_of_plane=0.4)
LENS = Lens(
    name="one",
    focal_lengths=(50.0, 85.0),
    f_stops=(4.0, 8.0, 16.0),
    image_circle=12,
    nearest_distance=400,
    barrel_diameter=40,
)
CHOICES = Choices(
    extension_tubes=(0.0, 10.0, 20.0), half_angles=(15.0, 25.0), distances=7, farthest=900
)
DESIGN = Design(sample=SAMPLE, camera=CAMERA, lenses=(LENS,), search=CHOICES)


# thin lens


@pytest.mark.parametrize(("focal", "distance"), [(75.0, 500.0), (50.0, 101.0), (35.0, 46.0)])
def test_object_and_image_distance_satisfy_the_lens_equation(focal: float, distance: float) -> None:
    image = focal + thin_lens.extension_at(focal, distance)
    assert 1 / distance + 1 / image == pytest.approx(1 / focal, rel=1e-14)
    assert thin_lens.magnification(focal, distance) == pytest.approx(image / distance, rel=1e-13)
    extension = thin_lens.extension_at(focal, distance)
    assert thin_lens.object_distance_at(focal, extension) == pytest.approx(distance, rel=1e-14)


@pytest.mark.parametrize(("focal", "distance", "f_stop"), [(75, 500, 30), (50, 110, 8)])
def test_a_point_at_either_limit_is_blurred_to_the_circle_of_confusion(
    focal: float, distance: float, f_stop: float
) -> None:
    circle = 0.0073
    hyperfocal = thin_lens.hyperfocal_distance(focal, f_stop, circle)
    image = 1 / (1 / focal - 1 / distance)
    for limit in (
        thin_lens.near_limit(hyperfocal, distance, focal),
        thin_lens.far_limit(hyperfocal, distance, focal),
    ):
        sharp_at = 1 / (1 / focal - 1 / limit)
        # similar triangles: the cone from the aperture f/N to its tip, cut by the sensor
        blur = focal / f_stop * abs(sharp_at - image) / sharp_at
        assert blur == pytest.approx(circle, rel=1e-9)


def test_beyond_the_hyperfocal_distance_everything_far_is_sharp() -> None:
    hyperfocal = thin_lens.hyperfocal_distance(35, 16, 0.00734)
    far = thin_lens.far_limit(hyperfocal, np.array([500.0, 2 * hyperfocal]), 35)
    assert np.isfinite(far[0])
    assert far[1] == np.inf


def test_the_far_field_of_view_is_wider_by_distance_over_distance_less_f() -> None:
    exact = thin_lens.field_of_view(6, thin_lens.magnification(75, 500))
    assert thin_lens.far_field_of_view(6, 500, 75) / exact == pytest.approx(500 / 425, rel=1e-14)


def test_airy_diameter_is_the_first_zero_of_the_diffraction_integral() -> None:
    exact = 2 * jn_zeros(1, 1)[0] / np.pi * 0.00055 * 8
    assert thin_lens.airy_diameter(8, 0.00055) == pytest.approx(exact, rel=5e-4)  # 2.44 of 2.4393


# framing


def test_frame_sides_have_the_diagonal_and_aspect_of_the_sensor() -> None:
    angle = framing.aspect_angle(CAMERA.height / CAMERA.width)
    assert framing.frame_width(CAMERA.diagonal, angle) == pytest.approx(CAMERA.width, rel=1e-14)
    assert framing.frame_height(CAMERA.diagonal, angle) == pytest.approx(CAMERA.height, rel=1e-14)


def test_width_and_depth_are_the_components_of_a_turned_face() -> None:
    axis = np.array([sin(radians(25)), cos(radians(25))])  # x, z of the camera's axis
    across = np.array([axis[1], -axis[0]])
    face = np.array([[x, z] for x in (-2.0, 2.0) for z in (0.0, 0.4)])
    at_rest = face[face[:, 1] == 0]
    assert framing.projected_width(4, 25) == pytest.approx(np.ptp(at_rest @ across))
    assert 2 * framing.half_depth(4, 25) == pytest.approx(np.ptp(at_rest @ axis))
    assert framing.depth_needed(4, 0.4, 25) == pytest.approx(np.ptp(face @ axis))


def test_two_barrels_touch_at_the_clear_distance() -> None:
    distance, angle = framing.clear_distance(60, 20), radians(20)
    centre = distance * np.array([sin(angle), cos(angle)])
    inner = centre - 30 * np.array([cos(angle), -sin(angle)])
    assert inner[0] == pytest.approx(0, abs=1e-12)
    assert distance == pytest.approx(30 / tan(angle))


def test_stereo_noise_is_that_of_two_cameras_with_independent_errors() -> None:
    rng = np.random.default_rng(1)
    angle, noise = radians(20), 0.002
    seen = rng.normal(0, noise, (200_000, 2))  # across the axes of both cameras
    design = np.array([[cos(angle), sin(angle)], [cos(angle), -sin(angle)]])
    x, z = np.linalg.solve(design, seen.T)
    assert np.std(x) == pytest.approx(framing.in_plane_noise(noise, 20), rel=0.01)
    assert np.std(z) == pytest.approx(framing.out_of_plane_noise(noise, 20), rel=0.01)


# set-ups and their search


def test_points_are_those_one_can_place_on_the_face() -> None:
    setup = Setup(focal_length=85.0, object_distance=400.0, f_stop=5.6, half_angle=15.0)
    limits = Limits(subset_speckles=5, step_share=0.25)
    seen = view(setup, SAMPLE, CAMERA, limits, barrel_diameter=40)
    count = 1
    for pixels in (float(seen.pixels_x), float(seen.pixels_y)):
        starts, start = 0, 0.0
        while start + seen.subset_pixels <= pixels:
            starts, start = starts + 1, start + 0.25 * float(seen.subset_pixels)
        count *= starts
    assert seen.points == count > 500
    assert seen.pixels_y == pytest.approx(2 * seen.magnification / 0.00345)
    assert seen.field_width == pytest.approx(CAMERA.width * (400 - 85) / 85)


def test_a_face_smaller_than_a_subset_has_no_points() -> None:
    setup = Setup(focal_length=35.0, object_distance=900.0, f_stop=16, half_angle=15.0)
    tiny = Sample(width=0.3, height=0.3, out_of_plane=0)
    assert view(setup, tiny, CAMERA, Limits(), barrel_diameter=40).points == 0


def test_closing_the_aperture_gives_depth_until_diffraction_takes_the_speckles() -> None:
    f_stops = np.array([2.8, 5.6, 11.0, 22.0])
    setup = Setup(85.0, 400.0, f_stops, 15.0)
    seen = view(setup, SAMPLE, CAMERA, Limits(), barrel_diameter=40)
    assert np.all(np.diff(seen.depth_of_field) > 0)
    assert seen.speckle[0] == seen.speckle[1]  # as fine as pixels allow
    assert np.all(np.diff(seen.speckle[1:]) > 0)


def test_a_fixed_circle_of_confusion_replaces_the_zeiss_formula() -> None:
    setup = Setup(85.0, 400.0, 8.0, 15.0)
    zeiss = view(setup, SAMPLE, CAMERA, Limits(), 40)
    same = view(setup, SAMPLE, CAMERA, Limits(circle_of_confusion=CAMERA.diagonal / 1500), 40)
    finer = view(setup, SAMPLE, CAMERA, Limits(circle_of_confusion=CAMERA.diagonal / 3000), 40)
    assert same.depth_of_field == zeiss.depth_of_field
    assert finer.depth_of_field == pytest.approx(zeiss.depth_of_field / 2, rel=1e-3)


def test_the_search_finds_what_trying_one_by_one_finds() -> None:
    best, n_feasible, n_tried = -1.0, 0, 0
    for focal, tube in product(LENS.focal_lengths, CHOICES.extension_tubes):
        nearest, farthest = reach(LENS, focal, tube, CHOICES.farthest)
        for distance in np.geomspace(nearest, farthest, CHOICES.distances):
            for f_stop, angle in product(LENS.f_stops, CHOICES.half_angles):
                setup = Setup(focal, float(distance), f_stop, angle)
                seen = view(setup, SAMPLE, CAMERA, DESIGN.limits, LENS.barrel_diameter)
                n_tried += 1
                usable = (
                    seen.depth_of_field >= seen.depth_needed
                    and seen.pixels_x <= 0.9 * 2448
                    and seen.pixels_y <= 0.9 * 2050
                    and distance >= seen.clear_distance
                    and seen.points >= 500
                )
                n_feasible += usable
                if usable:
                    best = max(best, float(seen.subsets))
    (found,) = search(DESIGN)
    assert found.is_feasible
    assert (found.n_feasible, found.n_tried) == (n_feasible, n_tried)
    assert found.seen.subsets == pytest.approx(best, rel=1e-12)
    assert 0 < n_feasible < n_tried


def test_the_best_magnification_is_that_of_the_closed_form() -> None:
    # With depth 2 c N / m^2 (N effective) and speckles of max(k pixels, Airy) / m, more m is better
    # until diffraction reaches k pixels, and worse beyond: there N = k p / (2.44 lambda).
    lens = replace(LENS, focal_lengths=(85.0,), f_stops=tuple(np.arange(4, 9, 0.05).tolist()))
    choices = replace(CHOICES, extension_tubes=(20.0,), half_angles=(15.0,), distances=800)
    (found,) = search(replace(DESIGN, lenses=(lens,), search=choices))
    f_stop = 3 * CAMERA.pixel / (2.44 * 0.00055)
    depth = framing.depth_needed(4, 0.4, 15)
    best = sqrt(2 * CAMERA.diagonal / 1500 * f_stop / depth)
    assert found.seen.magnification == pytest.approx(best, rel=0.01)
    assert found.setup.f_stop * (1 + found.seen.magnification) == pytest.approx(f_stop, rel=0.015)


def test_what_is_found_is_what_the_setup_sees() -> None:
    (found,) = search(DESIGN)
    again = view(found.setup, SAMPLE, CAMERA, DESIGN.limits, LENS.barrel_diameter)
    assert again == found.seen
    limits = conditions(found.setup, again, CAMERA, DESIGN.limits, LENS.image_circle)
    assert all(limit.demand <= 1 for limit in limits)
    at_best = found.distances.object_distance == found.setup.object_distance
    assert found.distances.is_feasible[at_best].all()
    assert np.all(np.diff(found.distances.object_distance) >= 0)
    needs = float(thin_lens.extension_at(found.setup.focal_length, found.setup.object_distance))
    assert found.seen.extension == pytest.approx(needs)
    assert found.tube <= needs * (1 + 1e-9)


def test_a_lens_focuses_from_infinity_to_its_nearest_and_a_tube_brings_both_closer() -> None:
    assert reach(LENS, 50, 0, np.inf) == (pytest.approx(400), np.inf)
    nearest, farthest = reach(LENS, 50, 10, np.inf)
    assert farthest == pytest.approx(50 + 50**2 / 10)
    assert nearest == pytest.approx(50 + 50**2 / (10 + 50**2 / 350))


def test_one_limit_that_cannot_be_met_does_not_hide_that_the_others_are() -> None:
    dark = replace(LENS, image_circle=6.0)
    (found,) = search(replace(DESIGN, lenses=(dark,)))
    assert not found.is_feasible
    assert [name for name, _ in found.misses] == ["image circle"]
    assert found.misses[0][1] == pytest.approx(CAMERA.diagonal / 6)
    (line,) = verdicts([found])
    assert "image circle (need/have 1.84)" in line


def test_a_limit_on_out_of_plane_noise_prefers_the_wider_angle() -> None:
    (free,) = search(DESIGN)
    limits = Limits(out_of_plane_noise=0.9 * float(free.seen.out_of_plane_noise))
    (bound,) = search(replace(DESIGN, limits=limits))
    assert free.setup.half_angle == 15
    assert bound.is_feasible
    assert bound.seen.out_of_plane_noise <= limits.out_of_plane_noise
    assert bound.setup.half_angle == 25


def test_usable_lenses_come_first_and_the_better_before_the_worse() -> None:
    dark = replace(LENS, name="dark", image_circle=6.0)
    slow = replace(LENS, name="slow", f_stops=(16.0,))
    found = search(replace(DESIGN, lenses=(dark, slow, LENS)))
    assert [one.lens for one in found] == ["one", "slow", "dark"]
    assert len(found_table(found).splitlines()) == 4


def test_the_packaged_search_images_a_face_of_4_mm_with_lenses_of_the_thesis() -> None:
    design = load_design("sample-4mm")
    assert design.sample.width == 4
    found = {one.lens: one for one in search(design)}
    usable = [name for name, one in found.items() if one.is_feasible]
    assert any(name.startswith("set") for name in usable)
    for name in usable:
        seen = found[name].seen
        assert seen.depth_of_field >= seen.depth_needed
        assert seen.points >= 500
    assert not found["set 2, 75 mm double Gauss"].is_feasible


def test_lens_sets_of_the_packaged_search_are_those_of_table_2_3() -> None:
    table = thesis_table("Table 2.3")
    lenses = load_design("sample-4mm").lenses[:4]
    circles = table.numbers("maximum_sensor_size_mm")
    assert [lens.image_circle for lens in lenses] == circles.tolist()
    lowest, highest = table.numbers("minimum_f_stop"), table.numbers("maximum_f_stop")
    for index, lens in enumerate(lenses):
        assert min(lens.f_stops) >= lowest[index]
        assert max(lens.f_stops) == highest[index]
    assert [lens.focal_lengths[0] for lens in lenses] == [85, 75, 18, 35]
    assert lenses[2].focal_lengths[-1] == 108  # not the 180 printed: see Table 3.3


def test_noise_of_the_best_setup_is_a_match_on_its_own_pixels() -> None:
    (found,) = search(DESIGN)
    pixel = CAMERA.pixel / found.seen.magnification
    in_plane = DESIGN.limits.matching_noise * pixel / sqrt(2) / cos(radians(15))
    assert found.seen.in_plane_noise == pytest.approx(in_plane, rel=1e-12)


def test_any_numbers_that_a_file_may_hold_give_an_answer_or_one_sentence() -> None:
    rng = np.random.default_rng(3)

    def some(n: int, low: float = -5.9, high: float = 5.9) -> tuple[float, ...]:
        return tuple((10 ** rng.uniform(low, high, n)).tolist())

    answered = 0
    for _ in range(300):
        width, height, out, pixel, circle, barrel, room, wavelength = some(8)
        focal = some(2, high=5)
        design = Design(
            sample=Sample(width=width, height=height, out_of_plane=out),
            camera=Camera(columns=int(rng.integers(1, 10**5)), rows=9, pixel=pixel),
            lenses=(
                Lens(
                    name="any",
                    focal_lengths=focal,
                    f_stops=some(2),
                    image_circle=circle,
                    nearest_distance=max(focal) * float(rng.uniform(2.01, 9)),
                    barrel_diameter=barrel,
                ),
            ),
            search=Choices(
                extension_tubes=(0.0, *some(2)),
                half_angles=(float(rng.uniform(0.02, 89)),),
                distances=3,
                farthest=some(1)[0],
            ),
            limits=Limits(smallest_distance=room, wavelength=wavelength),
        )
        try:
            (found,) = search(design)
        except ValueError as error:
            assert str(error).startswith("search.farthest: found")
            continue
        answered += 1
        assert found.is_feasible == (not found.misses)
        values = [v for k, v in vars(found.seen).items() if k != "depth_of_field"]
        assert np.isfinite(values).all()  # depth is infinite beyond the hyperfocal distance
    assert answered > 100
