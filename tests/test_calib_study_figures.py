"""Figures: plain synthetic arrays in, the same PNG every time, and every axis says what it is."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from calib.study.figure_style import hdi, png_bytes
from calib.study.force_figures import (
    EmulatorErrors,
    MeasuredForce,
    PredictedForce,
    emulator_errors,
    force_travel,
)
from calib.study.posterior_figures import Chains, Samples, chains, marginals, pairs

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
    for expected in ("stuck", "sliding", "94%", "mean of 23", "[N]", "[mm]", "published"):
        assert expected in text


def test_published_forces_are_not_mentioned_where_there_are_none() -> None:
    assert "published constants, " not in _texts(_forces(published=False))


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
