"""The discrepancy is a Gaussian error of stated size, smooth and apart from the parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import TRAVEL
from scipy.spatial.distance import cdist
from test_benchmarks_calibration import POINTS, likelihood

from calib.inference.discrepancy import (
    KEPT,
    LENGTH,
    field_discrepancy,
    step_discrepancy,
    with_discrepancy,
)

THETA = np.array([[0.02, 0.4, 0.2], [0.01, 0.1, 0.05]])


def test_patterns_make_the_squared_exponential() -> None:
    """But for the share of the variance that is left out on purpose."""
    size = 0.01 * np.arange(1.0, 16.0).reshape(5, 3)
    patterns = field_discrepancy(POINTS, TRAVEL, size).reshape(-1, 5, len(POINTS), 3)
    found = np.einsum("qipc,qjrd->ipcjrd", patterns, patterns)
    space = np.exp(-0.5 * (cdist(POINTS, POINTS) / LENGTH) ** 2)
    dense = np.einsum(
        "ij,pr,ic,jd,cd->ipcjrd", step_discrepancy(TRAVEL), space, size, size, np.eye(3)
    )
    assert np.abs(found - dense).max() < 2 * (1.0 - KEPT) * dense.max() * len(POINTS)
    assert np.einsum("ipcipc->", found) == pytest.approx(np.einsum("ipcipc->", dense), rel=0.011)


def test_forces_err_by_the_share_of_what_is_predicted() -> None:
    own = likelihood()
    wider = with_discrepancy(own, TRAVEL, POINTS, 0.1)
    here, there = own.forward.predict(THETA), wider.forward.predict(THETA)
    assert here.force_covariance is not None and there.force_covariance is not None
    added = there.force_covariance - here.force_covariance
    outer = here.force[:, :, None] * here.force[:, None, :]
    assert added == pytest.approx(0.01 * outer * step_discrepancy(TRAVEL), rel=1e-9)


def test_a_small_share_changes_nothing_and_a_large_one_flattens() -> None:
    own = likelihood()
    field = own.field
    assert field is not None
    truth = field.basis.fields(np.array([[1.0, 0.4, 0.16, 0.2]]))[0]
    force = own.forward.predict(THETA[:1]).force[0]
    known = replace(own, force=force, field=replace(field, observed=truth))
    spread = {
        share: np.ptp(with_discrepancy(known, TRAVEL, POINTS, share).log_prob(THETA))
        for share in (1e-6, 0.3)
    }
    # The offset of this basis is zero, so that of the field's size is, too.
    assert spread[1e-6] == pytest.approx(np.ptp(known.log_prob(THETA)), rel=1e-4)
    assert spread[0.3] < spread[1e-6]


def test_a_share_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match="share: expected a positive"):
        with_discrepancy(likelihood(), TRAVEL, POINTS, 0.0)
