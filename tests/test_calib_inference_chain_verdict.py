"""What is said of chains that were stopped at their longest."""

from __future__ import annotations

import numpy as np

from calib.inference.chain_verdict import judge, what_is_missing


def test_only_what_is_missing_is_named() -> None:
    rng = np.random.default_rng(0)
    fine = rng.standard_normal((2, 400, 8, 1))
    rules = {"n_autocorrelation": 50.0, "max_r_hat": 1.05}

    def said(chains: np.ndarray) -> str:
        found = judge(chains, **rules, max_steps=400, check_every=100)
        assert found.ended
        return what_is_missing(found, **rules)

    assert said(fine) == ""
    assert said(np.cumsum(fine, axis=1)) == "; stopped at max_steps before 50 times were reached"
    rules["n_autocorrelation"] = 10.0  # a burn-in of 5 times asks for 15 that are kept
    assert said(np.cumsum(fine, axis=1)) == "; stopped at max_steps before 15 times were reached"
    apart = fine + 3.0 * np.arange(2.0)[:, None, None, None]
    assert said(apart).startswith("; stopped at max_steps before their R-hat of ")
    assert said(apart).endswith(" fell to 1.05")
