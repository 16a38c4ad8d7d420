"""Lens formulas against geometry, the thesis' printed digits, and a search against brute force."""

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
from calib.optics.published import Check, published_checks
from calib.optics.published_limits import published_limits
from calib.optics.search import reach, search
from calib.optics.setup import Setup, conditions, view
from calib.optics.tables import checks_table, found_table, verdicts, warnings

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


# the thesis


def test_every_printed_digit_of_tables_3_3_3_4_and_a_2_is_reproduced() -> None:
    checks = published_checks()
    assert [(c.table, c.quantity) for c in checks if not c.is_reproduced] == []
    by_table = {name: [c for c in checks if c.table == name] for name in {c.table for c in checks}}
    assert len(by_table["Table 3.3"]) == 8
    assert len(by_table["Table 3.4"]) == len(thesis_table("Table 3.4").cells("property"))
    inputs = {"d", "FL", "OD", "F_stop", "AR"}
    computed = set(thesis_table("Appendix A.2").cells("symbol")) - inputs
    assert {c.quantity for c in by_table["Appendix A.2"]} == computed


def test_printed_values_that_their_formula_does_not_give_are_these() -> None:
    off = {(c.table, c.quantity): c for c in published_checks() if not c.follows}
    lenses = [f"lens set {i}, {x}" for i in (1, 3, 4) for x in ("depth of field", "field of view")]
    pixels = ["Pixel Width", "Number of Pixels in Width", "Number of Pixels in Height"]
    assert set(off) == {
        *(("Table 3.3", name) for name in lenses),
        *(("Appendix A.2", name) for name in ("phi", "A", "B", "P_x", "NP_x", "NP_y")),
        *(("Table 3.4", name) for name in ("phi", *pixels, "Depth of Sample in Undeformed State")),
    }
    assert all(check.remark for check in off.values())


def test_values_by_formula_are_those_in_the_notes_of_the_tables() -> None:
    def by_formula(table: str, quantity: str) -> float:
        checks = {(c.table, c.quantity): c.formula for c in published_checks()}
        return checks[table, quantity]

    notes = " ".join(thesis_table("Table 3.3").notes)
    for lens in (1, 3, 4):
        depth = by_formula("Table 3.3", f"lens set {lens}, depth of field")
        field = by_formula("Table 3.3", f"lens set {lens}, field of view")
        assert f"{depth:.2f} and {field:.2f} mm" in notes
    notes = " ".join(thesis_table("Table 3.4").notes)
    assert f"{by_formula('Table 3.4', 'Number of Pixels in Height'):.1f}" in notes
    assert f"{by_formula('Table 3.4', 'Number of Pixels in Width'):.1f}" in notes
    assert f"is {by_formula('Table 3.4', 'phi'):.1f} degrees" in notes
    assert f"gives {by_formula('Appendix A.2', 'B'):.1f} mm" in notes
    assert f"A = {by_formula('Appendix A.2', 'A'):.1f} mm" in thesis_table("Appendix A.2").notes[2]


def test_a_check_compares_printed_digits_and_cuts_where_the_thesis_cuts() -> None:
    check = Check("T", "q", "796", "pixels", formula=796.6, reproduced=796.4)
    assert not check.follows
    assert check.is_reproduced
    assert replace(check, is_cut=True).follows


def test_remarks_on_the_published_setup_carry_its_numbers() -> None:
    far, circle, diffraction = published_limits()
    assert "40.0 mm, the thin lens 34.0 mm" in far
    assert "11.02 mm" in circle
    assert "13.7 pixels" in diffraction  # 2.44 * 0.55 um * 30 * (1 + 75/425) / 3.45 um


def test_warnings_name_table_value_and_reason() -> None:
    checks = published_checks()
    said = list(warnings(checks))
    assert len(said) == sum(not check.follows for check in checks)
    assert any("lens set 3" in line and "180" in line and "108 mm" in line for line in said)
    assert len(checks_table(checks).splitlines()) == len(checks) + 1


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
