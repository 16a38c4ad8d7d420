"""Training sets: complete runs only, counted exclusions, and a fingerprint of every bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surrogate.partial_runs import PartialRuns
from surrogate.training_set import TrainingSet


def _set(n: int = 6) -> TrainingSet:
    rng = np.random.default_rng(0)
    return TrainingSet(
        rng.uniform(size=(n, 2)), rng.uniform(1.0, 2.0, (n, 3)), rng.normal(size=(n, 3, 4, 3)), 2
    )


def test_runs_not_reached_are_left_out_and_counted() -> None:
    full = _set()
    reached = np.array([True, False, True, True, False, True])
    force = np.where(reached[:, None], full.force, np.nan)
    kept = TrainingSet.from_runs(full.ratios, force, full.displacement, reached)
    assert kept.n_excluded == 2
    np.testing.assert_array_equal(kept.force, full.force[reached])
    assert full.displacement is not None and kept.displacement is not None
    np.testing.assert_array_equal(kept.displacement, full.displacement[reached])


def test_a_set_without_fields_is_allowed() -> None:
    full = _set()
    kept = TrainingSet.from_runs(full.ratios, full.force, None, np.ones(6, dtype=bool))
    assert kept.displacement is None and kept.n_excluded == 0


def test_the_fingerprint_changes_with_any_bit_and_with_nothing_else() -> None:
    here = _set()
    force = here.force.copy()
    force[3, 1] = np.nextafter(force[3, 1], 9.0)
    assert here.fingerprint == _set().fingerprint
    assert here.fingerprint != replace(here, force=force).fingerprint
    assert here.fingerprint != replace(here, displacement=None).fingerprint
    assert here.fingerprint == replace(here, n_excluded=0).fingerprint


def test_one_fingerprint_is_one_order_in_memory() -> None:
    here = _set()
    assert here.displacement is not None
    turned = TrainingSet(
        np.asfortranarray(here.ratios),
        np.asfortranarray(here.force),
        np.asfortranarray(here.displacement),
    )
    assert turned.fingerprint == here.fingerprint
    half = np.asfortranarray(np.where(np.arange(3) < 2, here.force, np.nan))
    early = PartialRuns(np.asfortranarray(here.ratios), half, None)
    for made, names in (
        (turned, ("ratios", "force", "displacement")),
        (early, ("ratios", "force")),
    ):
        for name in names:
            assert getattr(made, name).flags.c_contiguous


def test_a_force_that_is_not_positive_is_refused_by_run_and_step() -> None:
    force = _set().force.copy()
    force[4, 2] = -0.1
    with pytest.raises(ValueError, match=r"got -0\.1 N at step 2 of the run at ratios \["):
        replace(_set(), force=force)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force": np.ones((5, 3))}, r"force: expected 6 runs on 2 axes, got \(5, 3\)"),
        ({"force": np.full((6, 3), np.nan)}, "force: must be finite"),
        ({"displacement": np.ones((6, 2, 4, 3))}, "displacement: expected 3 steps"),
        ({"ratios": np.zeros((6, 2))}, "found a point twice"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(_set(), **change)


def test_a_mask_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="reached: expected 6 values"):
        TrainingSet.from_runs(_set().ratios, _set().force, None, np.ones(5, dtype=bool))
