"""Posteriors of the embedded studies are those that were stored, within their Monte-Carlo errors.

After a change that is meant to move them: `make baseline`, and the diff of the json for review.
"""

from __future__ import annotations

import numpy as np
import posterior_baseline as baseline
import pytest
from posterior_baseline import Figure


@pytest.mark.lasting
@pytest.mark.parametrize("name", baseline.STUDIES)
def test_posteriors_have_not_moved(name: str) -> None:
    """False alarm below 1e-3 over all studies together, where the sampler alone has changed."""
    old, new = baseline.stored(), baseline.figures(name)
    assert set(new) <= set(old)
    found = baseline.moved(old, new, baseline.limit(len(old)))
    assert not found, "\n".join(move.text for move in found)


def test_a_shift_of_a_fifth_of_a_posterior_sd_is_flagged() -> None:
    old = baseline.stored()
    for name in baseline.STUDIES:
        mean, sd = old[f"{name} mu mean"], old[f"{name} mu SD"]
        shifted = {f"{name} mu mean": Figure(mean.value + 0.2 * sd.value, mean.error)}
        assert baseline.moved(old, shifted, baseline.limit(len(old)))


def test_the_limit_keeps_the_false_alarms_at_their_rate() -> None:
    """20,000 sets of 24 normal numbers: 20 alarms expected, 40 or more at 5e-5."""
    rng = np.random.default_rng(1)
    worst = np.abs(rng.standard_normal((20_000, 24))).max(axis=1)
    assert np.count_nonzero(worst > baseline.limit(24)) < 40
