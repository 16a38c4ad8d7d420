"""Which rules of a study an emulator is held to."""

from __future__ import annotations

import numpy as np
import pytest

from calib.study import judgement, load_study
from calib.study.training_runs import PartialRuns
from tests.test_surrogate_emulator import TRAVEL, _emulator, _runs

NONE_PARTIAL = PartialRuns(
    np.zeros((0, 2)), np.zeros(0), np.zeros((0, TRAVEL.size)), np.zeros((0, TRAVEL.size)), None
)


@pytest.mark.parametrize(("name", "stopped"), [("thesis-forces", False), ("virtual", True)])
def test_a_field_that_errs_by_more_than_it_says_stops_only_studies_of_fields(
    name: str, stopped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(judgement, "MAX_RMS_Z", 0.0)  # so that any error is more than it says
    found = judgement.judge(_emulator(), _runs(), None, NONE_PARTIAL, load_study(name))
    assert any("force error over" in told for told in found.facts["failures"])
    assert any("field error over" in told for told in found.facts["failures"]) is stopped
