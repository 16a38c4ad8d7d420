"""`calib baseline` asks the emulator where it was trained, and nowhere else."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from analytic_models import TRAVEL, AnalyticBlock, AnalyticForward

from calib.inference.coordinates import CONSTANTS, constants_of
from calib.study import baseline as module
from calib.study.baseline import BaselineStudy, methods_table, starts_table
from calib.study.context import Context
from calib.study.sections import Hypothesis
from fe.response import Array

POINTS = np.random.default_rng(2).random((20, 2)) * [5.0, 2.5]
BLOCK = AnalyticBlock(points=POINTS)


class Trained(AnalyticForward):
    """Stands in for an emulator trained in a box of (r, s) and, say, a height."""

    def __init__(self, box: list[list[float]]) -> None:
        super().__init__(BLOCK, field=True)
        self.bounds = np.array([*box, [2.3, 2.7]])


def ran(
    monkeypatch: pytest.MonkeyPatch,
    box: list[list[float]],
    ratios: Array | None,
    truth: tuple[float, float, float] | None = None,
) -> BaselineStudy:
    """The baseline on the field of some ratios (2,) [None: of a truth] with such an emulator."""
    field, constants = None, None
    if ratios is not None:
        field = SimpleNamespace(displacement=BLOCK(ratios).displacement)
        values = constants_of(np.array([[0.05, *ratios]]))[0]
        constants = dict(zip(CONSTANTS, values, strict=True))
    dataset = SimpleNamespace(field=field, synthetic=True, travel=TRAVEL)
    data = SimpleNamespace(dataset=dataset, truth=constants)
    stand_ins: dict[str, Any] = {
        "load_data": data,
        "load_emulator": None,
        "ScaledEmulator": None,
        "EmulatorForward": Trained(box),
        "load_mesh_error": SimpleNamespace(correction=None),
        "inputs_of": (),
    }
    for name, value in stand_ins.items():
        monkeypatch.setattr(module, name, lambda *_, value=value, **__: value)
    context = cast("Context", SimpleNamespace(out=None, study=None))
    return module._run(context, cast("Hypothesis", SimpleNamespace(name="stuck")), truth)


def test_a_truth_beyond_the_usual_box_is_reached_by_an_emulator_trained_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = ran(monkeypatch, [[0.0, 1.0], [0.0, 1.0]], np.array([0.4, 0.7]))
    assert found.error_at_truth == pytest.approx(0.0, abs=1e-12)
    exact = found.runs[1]
    best = exact.result[exact.error.argmin()]
    assert best[2] / best[:2].sum() == pytest.approx(0.7, abs=0.1)


def test_no_answer_is_beyond_what_the_emulator_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    found = ran(monkeypatch, [[0.0, 0.8], [0.0, 0.05]], np.array([0.4, 0.3]))
    assert found.error_at_truth is None
    for run in found.runs:
        known = np.isfinite(run.error)
        assert 0 < known.sum() < len(known)
        ratios = run.result[known] / run.kappa[known, None]
        assert ratios[:, 1].max() <= 0.8 and ratios[:, 2].max() <= 0.05
    tables = starts_table(found).text() + methods_table(found).text()
    assert "inf" not in tables and "nan" not in tables


def test_a_synthetic_truth_that_the_emulator_does_not_know_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises(ValueError, match=r"--truth: expected r from 0 to 0.8 and s from 0 to 0.2"):
        ran(monkeypatch, [[0.0, 0.8], [0.0, 0.2]], None, (0.03, 0.02, 0.02))
