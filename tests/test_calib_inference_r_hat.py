"""R-hat is that of ArviZ, and sees ensembles that disagree."""

from __future__ import annotations

import arviz as az
import numpy as np
import pytest

from calib.inference.r_hat import r_hat, r_hat_of_ensembles


@pytest.mark.parametrize("n_draw", [100, 101])
def test_r_hat_is_that_of_arviz(n_draw: int) -> None:
    rng = np.random.default_rng(n_draw)
    chains = rng.standard_normal((4, n_draw)).cumsum(axis=1) + rng.normal(0, 3, (4, 1))
    assert r_hat(chains) == pytest.approx(float(az.rhat(chains, method="rank")), rel=1e-10)


def test_ensembles_of_other_spread_are_seen() -> None:
    chains = np.random.default_rng(1).standard_normal((4, 200, 8, 2))
    chains[0, :, :, 1] *= 3.0
    alike, other = r_hat_of_ensembles(chains)
    assert alike < 1.01 < other


def test_chains_that_do_not_move_or_are_too_short_have_none() -> None:
    assert r_hat(np.ones((4, 50))) == np.inf
    assert r_hat(np.zeros((4, 3))) == np.inf
