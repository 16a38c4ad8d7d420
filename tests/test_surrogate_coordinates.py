"""Choice of coordinates and covariance by runs left out."""

from __future__ import annotations

import numpy as np
import pytest

import surrogate.coordinates as coordinates
from surrogate.coordinates import choose_coordinates
from surrogate.covariance import FAMILIES


def _runs(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A smooth function of three inputs with its derivatives."""
    x = np.random.default_rng(3).random((n, 3))
    y = np.sin(3.0 * x[:, :1]) * np.exp(x[:, 1:2]) + x[:, 2:] ** 2
    slopes = np.stack(
        [
            3.0 * np.cos(3.0 * x[:, :1]) * np.exp(x[:, 1:2]),
            np.sin(3.0 * x[:, :1]) * np.exp(x[:, 1:2]),
            2.0 * x[:, 2:],
        ],
        axis=2,
    )
    return x, y, slopes


@pytest.mark.parametrize(
    ("n", "searched", "judged"), [(40, {40}, {40}), (80, {40}, {80}), (120, {40}, {60})]
)
def test_a_covariance_is_judged_on_more_runs_than_its_lengths_are_searched_on(
    n: int, searched: set[int], judged: set[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, set[int]] = {"searched": set(), "judged": set()}
    search, density = coordinates.maximise_evidence, coordinates.log_density

    def searching(families, x, *others, **named):
        seen["searched"].add(len(x))
        return search(families, x, *others, **named)

    def judging(error, variance):
        seen["judged"].add(len(error))
        return density(error, variance)

    monkeypatch.setattr(coordinates, "maximise_evidence", searching)
    monkeypatch.setattr(coordinates, "log_density", judging)
    chosen = choose_coordinates(*_runs(n))
    assert seen == {"searched": searched, "judged": judged}
    assert len(chosen.part) in searched


def test_the_best_covariance_is_that_of_the_largest_score(monkeypatch: pytest.MonkeyPatch) -> None:
    """The score decides, also where it is of more runs than the search."""
    x, y, slopes = _runs(80)
    calls = iter(range(1000))

    def scored(error, variance):
        assert len(error) == 80, "judged on all runs, though searched on half"
        return {0: 1.0, 1: 3.0, 2: 2.0}.get(next(calls), -1.0)

    monkeypatch.setattr(coordinates, "log_density", scored)
    chosen = choose_coordinates(x, y, slopes)
    assert chosen.family == FAMILIES[1] and not chosen.strength.any()
