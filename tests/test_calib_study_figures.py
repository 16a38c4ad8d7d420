"""Figures: plain synthetic arrays in, the same PNG every time, and every axis says what it is."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from calib.plot_scales import plain_log, thousandths
from calib.study.emulator_figures import refinement_loop
from calib.study.figure_style import COLOURS, hdi, png_bytes, symbol
from calib.study.force_figures import (
    EmulatorErrors,
    MeasuredForce,
    PredictedForce,
    emulator_errors,
    force_travel,
)
from calib.study.posterior_figures import Chains, Samples, chains, marginals, pairs
from calib.study.predictive_figures import face_maps, region_checks

TRAVEL = np.array([0.6, 1.0, 1.4])
MEAN = np.array([0.9, 2.0, 3.8])


def _texts(figure: Figure) -> str:
    """All text of a figure, legends included."""
    figure.draw_without_rendering()
    found = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    for axis in figure.axes:
        found += [axis.get_xlabel(), axis.get_ylabel(), axis.get_title()]
        found += [text.get_text() for text in axis.texts]
        legend = axis.get_legend()
        found += [text.get_text() for text in legend.get_texts()] if legend else []
    return "\n".join(found)


def _forces(published: bool = True) -> Figure:
    rng = np.random.default_rng(1)
    measured = MeasuredForce("synthetic", TRAVEL, MEAN, 0.1 * MEAN, 23)
    predicted = [
        PredictedForce(
            name,
            MEAN * (1 + 0.02 * rng.standard_normal((200, 3))),
            10 * MEAN if published else None,
        )
        for name in ("stuck", "sliding")
    ]
    return force_travel(measured, predicted)


def _samples() -> list[Samples]:
    rng = np.random.default_rng(2)
    constants = {
        name: scale * rng.beta(2, 3, 4000) for name, scale in (("C10", 0.01), ("C01", 0.02))
    }
    maps = {"C10": 0.004, "C01": 0.007}
    return [Samples(name, constants, maps, maps) for name in ("stuck", "sliding")]


def test_forces_show_both_hypotheses_the_data_and_units() -> None:
    text = _texts(_forces())
    for expected in ("stuck", "sliding", "94 %", "mean of 23", "[N]", "[mm]", "published"):
        assert expected in text


def test_published_forces_are_not_mentioned_where_there_are_none() -> None:
    figure = _forces(published=False)
    assert "published" not in _texts(figure)
    assert len(figure.axes) == 2  # and no panel is left empty for them


def test_a_hypothesis_that_leaves_the_panel_of_deviations_is_named() -> None:
    rng = np.random.default_rng(6)
    near, far = (MEAN * (k + 0.02 * rng.standard_normal((200, 3))) for k in (1, 3))
    measured = MeasuredForce("synthetic", TRAVEL, MEAN, 0.1 * MEAN, 23)
    figure = force_travel(
        measured, [PredictedForce("stuck", near, None), PredictedForce("sliding", far, None)]
    )
    assert "goes beyond this panel: sliding" in _texts(figure)


def test_the_band_holds_the_stated_share_of_the_draws() -> None:
    # Quantiles of the very draws that are drawn: exact but for rounding to whole draws.
    rng = np.random.default_rng(3)
    draws = rng.standard_normal((5000, 1)) + 10
    figure = force_travel(
        MeasuredForce("synthetic", TRAVEL[:1], MEAN[:1], MEAN[:1] / 10, 5),
        [PredictedForce("stuck", draws, None)],
    )
    heights = figure.axes[0].collections[0].get_paths()[0].vertices[:, 1]
    inside = np.mean((draws > heights.min()) & (draws < heights.max()))
    assert inside == pytest.approx(0.94, abs=0.001)


def test_a_published_value_off_the_axis_is_named_instead_of_stretching_it() -> None:
    figure = marginals(_samples(), published={"C10": 0.3, "C01": 0.01})
    assert "published 0.3" in _texts(figure)
    assert figure.axes[0].get_xlim()[1] < 0.02


def test_the_truth_is_always_on_the_axis_and_called_synthetic() -> None:
    figure = marginals(_samples(), truth={"C10": 0.02, "C01": 0.01})
    assert figure.axes[0].get_xlim()[1] > 0.02
    assert "synthetic truth" in _texts(figure)


def test_the_same_numbers_give_the_same_picture() -> None:
    assert png_bytes(_forces(), dpi=50) == png_bytes(_forces(), dpi=50)


def test_every_pair_of_constants_has_its_axes_under_every_hypothesis() -> None:
    figure = pairs(_samples(), truth={"C10": 0.004, "C01": 0.007})
    assert len(figure.axes) == 2
    assert "stuck" in figure.axes[0].get_title(loc="left")
    assert png_bytes(figure, dpi=50).startswith(b"\x89PNG")


def test_many_constants_are_wrapped_to_the_width_of_a_page() -> None:
    rng = np.random.default_rng(4)
    names = [f"c{k}" for k in range(9)]
    rivals = [
        Samples(law, {name: rng.random(200) for name in own}, {}, {})
        for law, own in (("mr", names[:5]), ("yeoh", names[5:]))
    ]
    figure = pairs(rivals)
    assert figure.get_figwidth() < 14.0
    assert sum(axis.axison for axis in figure.axes) == 10 + 6
    figure = marginals(rivals)
    assert figure.get_figwidth() < 16.0
    shown = [axis.get_xlabel() for axis in figure.axes if axis.axison]
    assert [label.split(" ")[0] for label in shown] == [symbol(name) for name in names]


def test_constants_side_by_side_are_written_in_one_power_of_ten() -> None:
    for figure in (marginals(_samples()), pairs(_samples())):
        figure.draw_without_rendering()
        for axis in figure.axes:
            power = axis.xaxis.get_offset_text().get_text()
            assert "10^{-3}" in power.replace("\N{MINUS SIGN}", "-")


def test_the_interval_in_the_legend_has_no_hypothesis_colour() -> None:
    handles = {h.get_label(): h for h in marginals(_samples()).legends[0].legend_handles}
    texts = [text.get_text() for text in marginals(_samples()).legends[0].get_texts()]
    assert "94 % HDI" in texts
    assert not {line.get_color() for line in handles.values()} & set(COLOURS)


def test_pairs_of_a_constant_that_does_not_vary_can_be_drawn() -> None:
    fixed = Samples("stuck", {"C10": np.full(50, 0.1), "C01": np.full(50, 0.2)}, {}, {})
    assert png_bytes(pairs([fixed]), dpi=50).startswith(b"\x89PNG")


def test_chains_show_every_ensemble() -> None:
    walkers = np.random.default_rng(4).standard_normal((3, 8, 50))
    text = _texts(chains([Chains("stuck", {"kappa [MPa]": walkers})]))
    assert "ensemble 3" in text and "kappa [MPa]" in text and "stuck" in text


def test_emulator_errors_name_the_tolerance_in_percent() -> None:
    errors = EmulatorErrors("stuck", np.full((4, 3), 0.001), np.ones((4, 3)), 0.02)
    assert "±2 %" in _texts(emulator_errors([errors], TRAVEL))


def test_emulators_without_a_run_held_out_say_so() -> None:
    errors = EmulatorErrors("stuck", np.empty((0, 3)), np.empty((0, 3)), 0.02)
    assert "no run was held out" in _texts(emulator_errors([errors], TRAVEL))


def _round(n_train: int, boxed: bool) -> dict[str, object]:
    box = [[0.1, 0.2], [0.1, 0.2]] if boxed else None
    return {"n_train": n_train, "predicted_shift": [0.3], "force_error": [1e-3], "box": box}


def test_the_loop_is_drawn_round_by_round_though_a_box_has_fewer_runs() -> None:
    rounds = [_round(24, False), _round(18, True), _round(29, True)]
    figure = refinement_loop({"stuck": {"rounds": rounds, "box": None, "limit": 0.05}})
    left = figure.axes[0]
    assert list(left.lines[0].get_xdata()) == [1, 2, 3]
    assert list(left.lines[1].get_xdata()) == [2, 3]  # open marks
    text = _texts(figure)
    for expected in ("24", "18", "29", "stops below 0.05", "open: in a box", "round"):
        assert expected in text


def test_maps_of_the_face_have_one_scale_a_row_and_correlation_is_centred() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    rmse = 1e-3 * np.arange(1.0, 10.0).reshape(3, 3)
    figure = face_maps("stuck", {"points": points, "correlation": np.ones((3, 3)), "rmse": rmse})
    limits = [axis.collections[0].get_clim() for axis in figure.axes[:6]]
    assert np.ravel(limits) == pytest.approx([-1.0, 1.0] * 3 + [0.0, 9.0] * 3)
    assert len(figure.axes) == 8  # six maps and a bar of colours for each row
    assert all(axis.get_aspect() == 1.0 for axis in figure.axes[:6])


def test_checks_of_regions_name_their_bands_beside_the_panels() -> None:
    one = {"p_value": 0.0, "coverage": {"0.94": 1.0}}
    checks = {"near pin": [[one] * 3] * 3, "edge": [[one] * 3] * 3}
    figure = region_checks("stuck", TRAVEL, checks)
    text = _texts(figure)
    for expected in ("near pin", "p below 0.05 or above 0.95", "coverage stated: 94 %"):
        assert expected in text
    assert not any(axis.get_legend() for axis in figure.axes)
    low, high = figure.axes[0].get_ylim()
    assert low < 0 and high > 1  # marks at 0 and 1 are whole


def test_titles_and_legends_of_a_single_constant_lie_within_the_figure() -> None:
    one = Samples("stuck", {"mu": np.random.default_rng(6).uniform(0.1, 0.2, 200)}, {}, {})
    for figure in (marginals([one], {"mu": 0.12}, {"mu": 0.15}), pairs([one])):
        figure.draw_without_rendering()
        beside = [*figure.legends, *figure.texts]
        assert beside
        for each in beside:
            box = each.get_window_extent()
            assert box.x0 >= 0 and box.x1 <= figure.bbox.x1


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [
        (0.02, 300.0, {"0.1", "1", "100"}),
        (1.0, 9.0, {"1", "2", "5"}),
        (1.0, 1.05, {"1", "1.02", "1.04"}),
    ],
)
def test_logarithmic_axes_have_plain_numbers(low: float, high: float, shown: set[str]) -> None:
    axis = Figure().subplots()
    axis.plot([0, 1], [low, high])
    plain_log(axis.yaxis)
    figure = axis.get_figure()
    assert figure is not None
    figure.draw_without_rendering()
    assert shown <= {label.get_text() for label in axis.get_yticklabels()}


@pytest.mark.parametrize(("largest", "power"), [(0.2, ""), (0.09, "-3"), (9e-5, "-6")])
def test_small_numbers_of_an_axis_are_in_powers_of_a_thousand(largest: float, power: str) -> None:
    axis = Figure().subplots()
    axis.set_xlim(0.0, largest)
    thousandths(axis.xaxis)
    axis.xaxis.get_tightbbox()
    text = axis.xaxis.get_offset_text().get_text().replace("\N{MINUS SIGN}", "-")
    assert power in text and bool(power) == bool(text)


def test_a_single_round_of_the_loop_has_a_whole_number() -> None:
    figure = refinement_loop({"stuck": {"rounds": [_round(24, False)], "box": None, "limit": 0.05}})
    assert [tick for tick in figure.axes[0].get_xticks() if 0.9 < tick < 1.1] == [1.0]


def test_the_hdi_of_an_exponential_starts_at_zero() -> None:
    # The shortest interval with 94 % of an exponential is [0, -ln 0.06]. The SD of the upper end
    # over 20,000 draws is about 0.03; six of them make a false alarm one in 10^8.
    low, high = hdi(np.random.default_rng(5).exponential(size=20_000))
    assert low < 0.01
    assert high == pytest.approx(-np.log(0.06), abs=0.2)


def test_an_interval_of_one_draw_is_refused() -> None:
    with pytest.raises(ValueError, match="at least two"):
        hdi(np.array([1.0]))


def test_forces_of_different_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="expected one shape"):
        MeasuredForce("synthetic", TRAVEL, MEAN[:2], MEAN, 23)
