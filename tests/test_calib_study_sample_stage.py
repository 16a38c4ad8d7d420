"""The stage `sample` keeps its chains while they grow, and only while they grow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from analytic_block import analytic_block
from test_calib_inference_sampling import POSTERIOR

from calib.inference import predictive_forces
from calib.study import sample_stage
from calib.study.config import load_study
from calib.study.context import Context
from calib.study.sample_stage import chains_folder, load_samples
from fe.executors import serial_map
from fe.response import Array


def test_a_stage_that_was_stopped_goes_on_with_its_chains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = load_study("thesis-forces")
    study = replace(
        study,
        hypotheses=study.hypotheses[:2],
        sampler=replace(study.sampler, n_ensembles=2, n_walkers=8, max_steps=500),
    )
    monkeypatch.setattr(sample_stage, "emulator_posterior", lambda *_: POSTERIOR)
    monkeypatch.setattr(sample_stage, "refuse_bad_emulators", lambda _: None)

    def context(folder: str) -> Context:
        return Context(study, tmp_path / folder, analytic_block, serial_map, lambda _: None, False)

    for folder in ("whole", "stopped"):
        (tmp_path / folder).mkdir()
    sample_stage.run(context("whole"))
    asked: list[object] = []
    with monkeypatch.context() as stopping:
        stopping.setattr(sample_stage, "predictive_forces", _stopped_at(2, asked))
        with pytest.raises(KeyboardInterrupt):
            sample_stage.run(context("stopped"))
    kept = [chains_folder(tmp_path / "stopped", each) for each in study.hypotheses]
    assert [len(list(folder.glob("block_*.h5"))) for folder in kept] == [2, 2]
    written = {path: path.stat().st_mtime_ns for folder in kept for path in folder.glob("*.h5")}
    with monkeypatch.context() as looking:
        looking.setattr(sample_stage.shutil, "rmtree", lambda *_, **__: None)
        sample_stage.run(context("stopped"))
    assert {path: path.stat().st_mtime_ns for path in written} == written, "sampled anew"
    sample_stage.run(context("stopped"))
    assert not any(folder.exists() for folder in kept)
    for hypothesis in study.hypotheses:
        whole, again = (load_samples(tmp_path / name, hypothesis) for name in ("whole", "stopped"))
        assert np.array_equal(whole.result.chains, again.result.chains)
        assert np.array_equal(whole.predictive, again.predictive)


def test_a_hypothesis_that_was_not_sampled_is_told_in_one_sentence(tmp_path: Path) -> None:
    hypothesis = load_study("thesis-forces").hypotheses[0]
    with pytest.raises(ValueError) as refusal:
        load_samples(tmp_path, hypothesis)
    expected = "found no such file, the study is not sampled yet: run `calib run` on it"
    assert str(refusal.value) == f"{tmp_path / 'samples_stuck.npz'}: {expected}"


def _stopped_at(number: int, asked: list[object]) -> Callable[..., Array]:
    """As `predictive_forces` until it is asked for the time of this number, then Ctrl-C."""

    def predict(*arguments: Any) -> Array:
        asked.append(None)
        if len(asked) == number:
            raise KeyboardInterrupt
        return predictive_forces(*arguments)

    return predict
