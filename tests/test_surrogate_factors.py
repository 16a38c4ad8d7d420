"""Designs over factors: priors, discrete levels, nesting; Latin hypercubes; corners and faces."""

from __future__ import annotations

import itertools
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.stats import norm, truncnorm, uniform

from surrogate import Factor, Levels, design, maximin_design, sobol_design, unit_design
from surrogate.latin_hypercube import N_EXCHANGES, farthest_order, latin_hypercube

BOX = np.array([[0.0, 1.0], [-0.2, 0.5]])


@pytest.mark.parametrize("n", [8, 16, 32, 64])
@pytest.mark.parametrize("d", [2, 6])
def test_the_first_8_16_32_points_are_latin_hypercubes(n: int, d: int) -> None:
    slices = np.floor(latin_hypercube(70, d, seed=3)[:n] * n).astype(int)
    assert (np.sort(slices, axis=0) == np.arange(n)[:, None]).all()


@pytest.mark.parametrize("n", [1, 5, 8, 9, 20, 33])
def test_a_smaller_hypercube_is_the_beginning_of_a_larger_one(n: int) -> None:
    larger = latin_hypercube(40, 3, seed=2)
    assert latin_hypercube(n, 3, seed=2).tobytes() == larger[:n].tobytes()
    box = maximin_design(40, BOX, 2)
    assert maximin_design(n, BOX, 2).tobytes() == box[:n].tobytes()


def test_maximin_hypercubes_are_wider_spaced_than_random_ones() -> None:
    """Least distance of 16 points in 3 dimensions, mean of 10 seeds."""
    ours, random = [], []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        ours.append(pdist(latin_hypercube(16, 3, seed)).min())
        cells = np.array([rng.permutation(16) for _ in range(3)]).T
        random.append(pdist((cells + rng.random((16, 3))) / 16).min())
    assert np.mean(ours) > 1.5 * np.mean(random)


def test_a_part_of_the_corners_is_spread_and_faces_follow() -> None:
    """The first two of 4 corners of a cube are opposite, and no corner comes twice."""
    box = np.tile([0.0, 1.0], (3, 1))
    points = sobol_design(12, box, 0, n_corners=4, n_faces=6)
    corners, faces = points[:4], points[4:10]
    assert pdist(corners[:2], "cityblock")[0] == 3.0 and pdist(corners).min() > 0.0
    assert set(corners.ravel()) == {0.0, 1.0}
    assert (np.sum(faces == 0.5, axis=1) == 2).all() and len(np.unique(faces, axis=0)) == 6
    assert ((points[10:] > 0.0) & (points[10:] < 1.0)).all()


@pytest.mark.parametrize("d", range(1, 8))
def test_a_part_of_the_corners_is_the_beginning_of_their_farthest_order(d: int) -> None:
    unit = np.array(list(itertools.product((0.0, 1.0), repeat=d)))
    box = np.column_stack([np.linspace(-1.0, 0.3, d), np.linspace(0.7, 2.0, d)])
    corners = np.array(list(itertools.product(*box)))
    expected = corners[farthest_order(unit, np.zeros((0, d)))]
    for n_corners in {1, 2, 2**d // 2, 2**d}:
        for n in {1, n_corners, n_corners + 3}:
            points = sobol_design(n, box, 0, n_corners=n_corners)
            np.testing.assert_array_equal(points[:n_corners], expected[:n_corners][:n])
    np.testing.assert_array_equal(sobol_design(2**d, box, 0), corners)


@pytest.mark.parametrize("n_corners", [None, 0, 1])
def test_few_points_of_a_box_of_many_inputs_need_no_table_of_its_corners(
    n_corners: int | None,
) -> None:
    """A table of the 4096 corners of 12 inputs takes 393 kB, its distances as much again."""
    box = np.tile([0.0, 1.0], (12, 1))
    sobol_design(4, box, 0, n_corners=0)  # what is loaded once
    tracemalloc.start()
    sobol_design(4, box, 0, n_corners=n_corners)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 300_000


def test_without_corners_all_points_are_inside() -> None:
    points = sobol_design(20, BOX, 0, n_corners=0)
    assert ((points > BOX[:, 0]) & (points < BOX[:, 1])).all()


def test_more_corners_than_there_are_and_unknown_sequences_are_refused() -> None:
    with pytest.raises(ValueError, match="n_corners: expected 0 to 4, found 5"):
        sobol_design(20, BOX, 0, n_corners=5)
    with pytest.raises(ValueError, match="n_faces: expected 0 to 4, found 5"):
        sobol_design(20, BOX, 0, n_faces=5)
    with pytest.raises(ValueError, match="sequence: expected 'sobol' or 'latin', found 'grid'"):
        unit_design(4, 2, 0, sequence="grid")  # type: ignore[arg-type]


FACTORS = (
    Factor("r", 0.0, 1.0),
    Factor("height", 2.4, 2.8, norm(2.6, 0.05).ppf),
    Levels("pin", ("bar", "round")),
    Levels("contact", ("stick", "slide", "friction")),
)


@pytest.mark.parametrize("sequence", ["sobol", "latin"])
def test_designs_over_factors_are_nested(sequence: str) -> None:
    larger = design(FACTORS, 60, 1, sequence=sequence)  # type: ignore[arg-type]
    for n in (1, 7, 30):
        smaller = design(FACTORS, n, 1, sequence=sequence)  # type: ignore[arg-type]
        assert smaller.values.tobytes() == larger.values[:n].tobytes()
        assert smaller.levels == larger.levels[:n]


def test_levels_take_turns_and_each_combination_covers_the_box() -> None:
    points = design(FACTORS, 6 * 32, 1)
    assert points.names == ("r", "height") and points.discrete_names == ("pin", "contact")
    assert len(set(points.levels[:6])) == 6
    for combination in set(points.levels):
        own = points.values[points.rows(combination), 0]
        counts, _ = np.histogram(own, bins=8, range=(0.0, 1.0))
        assert (counts == 4).all()
    first, second = (points.values[points.rows(c)] for c in points.levels[:2])
    assert not np.array_equal(first, second)


def test_a_factor_with_a_prior_follows_it() -> None:
    """Quantiles of 1024 points within 0.01 SD: the design is a net, not a sample."""
    height = design(FACTORS[:2], 1024, 1).values[:, 1]
    expected = norm(2.6, 0.05).ppf([0.1, 0.25, 0.5, 0.75, 0.9])
    np.testing.assert_allclose(
        np.quantile(height, [0.1, 0.25, 0.5, 0.75, 0.9]), expected, atol=5e-4
    )
    assert height.min() >= 2.4 and height.max() <= 2.8


def test_a_prior_wider_than_its_bounds_is_cut_off_there_and_not_heaped_up() -> None:
    """Quantiles are those of the normal distribution that ends at the bounds."""
    wide = Factor("height", 2.5, 2.7, norm(2.6, 0.2).ppf)
    unit = np.linspace(0.0, 1.0, 201)
    expected = truncnorm(-0.5, 0.5, 2.6, 0.2).ppf(unit)
    np.testing.assert_allclose(wide.values(unit), expected, rtol=0.0, atol=1e-12)
    drawn = design([wide, FACTORS[0]], 64, 1).values[:, 0]
    assert ((drawn > 2.5) & (drawn < 2.7)).all()


@pytest.mark.parametrize(
    "quantiles",
    [norm(5.0, 0.5).ppf, uniform(4.0, 2.0).ppf, lambda u: 5.0 + np.log(u / (1.0 - u))],
)
def test_the_ends_of_a_design_are_the_bounds_whatever_the_prior(
    quantiles: Callable[[np.ndarray], np.ndarray],
) -> None:
    with np.errstate(divide="raise"):
        ends = Factor("height", 0.0, 10.0, quantiles).values(np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(ends, [0.0, 5.0, 10.0], rtol=1e-12)


def test_bounds_without_any_of_the_prior_are_refused() -> None:
    with pytest.raises(ValueError, match="height: expected bounds that hold some of its prior's"):
        Factor("height", 9.0, 10.0, norm(5.0, 0.5).ppf)


def test_factors_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match="r: expected finite low < high"):
        Factor("r", 1.0, 0.0)
    with pytest.raises(ValueError, match="pin: expected two or more different levels"):
        Levels("pin", ("bar", "bar"))
    with pytest.raises(ValueError, match="pin: expected two or more different levels"):
        Levels("pin", ("bar",))
    with pytest.raises(ValueError, match="factors: expected different names"):
        design((FACTORS[0], FACTORS[0]), 4, 1)
    with pytest.raises(ValueError, match="one continuous"):
        design(FACTORS[2:], 4, 1)


def test_the_columns_of_a_campaign_hold_values_and_indices_of_levels() -> None:
    height, pin = Factor("height", 2.5, 2.7), Levels("pin", ("bar", "round"))
    contact = Levels("contact", ("stick", "slide"))
    found = design([height, pin, contact], 9, seed=1)
    theta = found.theta([pin, height, contact])
    assert theta.shape == (9, 3)
    np.testing.assert_array_equal(theta[:, 1], found.values[:, 0])
    names = [(pin.levels[int(a)], contact.levels[int(b)]) for a, b in theta[:, [0, 2]]]
    assert names == list(found.levels)


@dataclass(frozen=True)
class Parameter:
    """Stands in for a campaign's, whose levels may be in another order than the design's."""

    name: str
    levels: tuple[str, ...] = ()


def test_a_level_is_looked_for_by_its_name_among_those_of_the_column() -> None:
    found = design([Factor("height", 2.5, 2.7), Levels("pin", ("round", "bar"))], 6, seed=1)
    pin = Parameter("pin", ("bar", "round", "cone"))
    theta = found.theta([pin, Parameter("height")])
    assert [pin.levels[int(at)] for at in theta[:, 0]] == [levels[0] for levels in found.levels]


def test_columns_that_a_design_cannot_fill_are_refused() -> None:
    height, pin = Parameter("height"), Parameter("pin", ("bar", "cone"))
    found = design([Factor("height", 2.5, 2.7), Levels("pin", ("round", "bar"))], 6, seed=1)
    with pytest.raises(ValueError, match=r"pin: .* found round not among bar, cone"):
        found.theta([height, pin])
    with pytest.raises(ValueError, match=r"pin: .* found bar, round not among none"):
        found.theta([height, Parameter("pin")])
    with pytest.raises(ValueError, match="columns: expected height, pin, found height"):
        found.theta([height])


def _exchanged_plainly(new: np.ndarray, points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Morris and Mitchell's criterion of all pairs anew for every exchange."""

    def crowding(trial: np.ndarray) -> float:
        squared = np.sum((trial[:, None] - np.vstack([trial, points])) ** 2, axis=2)
        np.fill_diagonal(squared, np.inf)
        return float(np.sum(np.maximum(squared, 1e-12) ** -5.0))

    score = crowding(new)
    for _ in range(N_EXCHANGES):
        first, second = rng.choice(len(new), 2, replace=False)
        axis = int(rng.integers(new.shape[1]))
        trial = new.copy()
        trial[[first, second], axis] = new[[second, first], axis]
        if crowding(trial) < score:
            new, score = trial, crowding(trial)
    return new


def test_exchanges_are_those_of_the_criterion_of_all_pairs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = latin_hypercube(48, 3, seed=5)
    monkeypatch.setattr("surrogate.latin_hypercube._exchanged", _exchanged_plainly)
    assert latin_hypercube(48, 3, seed=5).tobytes() == found.tobytes()
