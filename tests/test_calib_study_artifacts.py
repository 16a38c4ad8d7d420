"""Artifacts: atomic writes, hashes that see every change, and the words why a stage is stale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.study import artifacts
from calib.study.artifacts import (
    StageRecord,
    hash_of,
    hash_of_file,
    outdated,
    plain,
    read_json,
    read_npz,
    why_stale,
    write_bytes,
    write_json,
    write_npz,
    write_record,
)

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=8,
)


@dataclass(frozen=True)
class Point:
    x: float
    y: np.ndarray


def _finished(out: Path) -> StageRecord:
    write_bytes(out / "campaign" / "a.npz", b"content")
    record = StageRecord(
        stage="simulate",
        version="1",
        seed=3,
        inputs={"mesh": "aa", "design": "bb"},
        outputs={"campaign/a.npz": hash_of_file(out / "campaign" / "a.npz")},
        seconds=1.5,
    )
    write_record(out, record)
    return record


def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.json"
    write_json(path, {"value": 1})

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_json(path, {"value": 2})
    assert read_json(path) == {"value": 1}
    assert [found.name for found in tmp_path.iterdir()] == ["a.json"]


@given(json_values)
def test_plain_json_values_stay_as_they_are(value: object) -> None:
    assert plain(value) == value


def test_dataclasses_and_arrays_become_json_and_nan_becomes_null() -> None:
    found = plain({"p": Point(np.float64(1.5), np.array([1.0, np.nan]))})
    assert found == {"p": {"x": 1.5, "y": [1.0, None]}}


def test_what_json_cannot_hold_is_refused_by_type() -> None:
    with pytest.raises(TypeError, match="found object"):
        plain({"a": object()})


def test_hash_sees_every_value_and_not_the_order_of_keys() -> None:
    assert hash_of({"a": 1.0, "b": [1, 2]}) == hash_of({"b": [1, 2], "a": 1.0})
    assert hash_of({"a": 1.0}) != hash_of({"a": np.nextafter(1.0, 2.0)})


def test_a_damaged_json_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "map.json").write_text('{"a": ')
    with pytest.raises(ValueError, match=r"map\.json: not a readable JSON file"):
        read_json(tmp_path / "map.json")


@pytest.mark.parametrize("read", [read_json, read_npz])
def test_a_file_that_is_not_there_says_that_the_study_is_not_finished(
    read: Callable[[Path], object], tmp_path: Path
) -> None:
    path = tmp_path / "map"
    with pytest.raises(ValueError) as refusal:
        read(path)
    expected = "found no such file, the study is not finished: run `calib run` on it"
    assert str(refusal.value) == f"{path}: {expected}"


def test_arrays_come_back_and_a_damaged_or_foreign_npz_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    write_npz(path, {"x": np.arange(3)})
    assert read_npz(path, ("x",))["x"].tolist() == [0, 1, 2]
    with pytest.raises(ValueError, match=r"a\.npz: found no array y, z; delete it and `calib run`"):
        read_npz(path, ("x", "y", "z"))
    whole = path.read_bytes()
    for content in (b"", b"junk", whole[:100], whole[:-30]):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"a\.npz: not a readable npz file; delete it and"):
            read_npz(path)


def test_a_finished_stage_is_up_to_date(tmp_path: Path) -> None:
    record = _finished(tmp_path)
    found, reason = why_stale(tmp_path, "simulate", dict(record.inputs), "1")
    assert (found, reason) == (record, "")


def test_the_reason_names_what_changed(tmp_path: Path) -> None:
    record = _finished(tmp_path)
    inputs = dict(record.inputs)
    assert "changed: mesh" in why_stale(tmp_path, "simulate", inputs | {"mesh": "xx"}, "1")[1]
    assert "changed: extra" in why_stale(tmp_path, "simulate", inputs | {"extra": "x"}, "1")[1]
    assert "made by version 1" in why_stale(tmp_path, "simulate", inputs, "2")[1]
    assert why_stale(tmp_path, "train", inputs, "1")[1] == "not run yet"
    write_bytes(tmp_path / "campaign" / "a.npz", b"edited")
    assert "a.npz is not what" in why_stale(tmp_path, "simulate", inputs, "1")[1]
    (tmp_path / "campaign" / "a.npz").unlink()
    assert "a.npz is missing" in why_stale(tmp_path, "simulate", inputs, "1")[1]


def test_a_stage_that_was_stopped_is_told_from_one_that_never_began(tmp_path: Path) -> None:
    artifacts.mark_begun(tmp_path, "simulate")
    assert why_stale(tmp_path, "simulate", {}, "1")[1] == "stopped before its end"
    record = _finished(tmp_path)
    assert why_stale(tmp_path, "simulate", dict(record.inputs), "1")[1] == ""
    artifacts.record_path(tmp_path, "simulate").unlink()
    assert why_stale(tmp_path, "simulate", {}, "1")[1] == "not run yet"


def test_a_damaged_record_means_the_stage_runs_again(tmp_path: Path) -> None:
    record = _finished(tmp_path)
    write_bytes(artifacts.record_path(tmp_path, "simulate"), b"{")
    why = why_stale(tmp_path, "simulate", dict(record.inputs), "1")[1]
    assert why == "its record cannot be read"


def test_later_stages_see_other_outputs_as_another_input(tmp_path: Path) -> None:
    record = _finished(tmp_path)
    assert record.digest() != replace(record, outputs={"campaign/a.npz": "other"}).digest()
    assert record.digest() == replace(record, seconds=99.0).digest()


def test_a_stage_is_outdated_where_one_that_it_needs_wrote_something_else(tmp_path: Path) -> None:
    def wrote(stage: str, digest: str, inputs: dict[str, str]) -> StageRecord:
        record = StageRecord(stage, "1", 0, inputs, {"file": digest}, 0.0)
        write_record(tmp_path, record)
        return record

    assert outdated(tmp_path, "predict") == ""  # nothing is known
    data, sample = wrote("data", "a", {}), wrote("sample", "b", {})
    wrote("predict", "c", {"stage data": data.digest(), "stage sample": sample.digest(), "x": "1"})
    assert outdated(tmp_path, "predict") == ""
    wrote("sample", "other", {})
    assert outdated(tmp_path, "predict") == "sample" and outdated(tmp_path, "sample") == ""
    (tmp_path / "stages" / "sample.json").unlink()
    assert outdated(tmp_path, "predict") == "sample"
