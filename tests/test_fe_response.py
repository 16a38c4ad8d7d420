"""A simulation result: its file keeps every bit, and a damaged file is refused by name."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from fe.response import Response, Status, load_response, save_response


def _response() -> Response:
    rng = np.random.default_rng(5)
    force = np.array([1.0, 2.0, np.nan])
    return Response(
        travel=np.array([0.6, 0.8, 1.0]),
        force=force,
        displacement=rng.normal(size=(3, 7, 3)),
        force_gradient=rng.normal(size=(3, 2)),
        displacement_gradient=rng.normal(size=(3, 7, 3, 2)),
        reached=0.8,
        status=Status.STOPPED,
        message="step below its limit at 0.83 mm",
        negative_pivots=np.array([0, 1, -1]),
        n_factorisations=12,
        seconds=0.25,
    )


def _assert_same(a: Response, b: Response) -> None:
    for field in fields(Response):
        x, y = np.asarray(getattr(a, field.name)), np.asarray(getattr(b, field.name))
        assert x.dtype.kind == y.dtype.kind, field.name
        assert x.tobytes() == y.tobytes() or x.tolist() == y.tolist(), field.name


def test_a_saved_response_comes_back_bit_for_bit_with_its_status(tmp_path: Path) -> None:
    save_response(tmp_path / "run.npz", _response())
    loaded = load_response(tmp_path / "run.npz")
    _assert_same(loaded, _response())
    assert loaded.status is Status.STOPPED


def test_extra_arrays_are_stored_beside_the_response(tmp_path: Path) -> None:
    save_response(tmp_path / "run.npz", _response(), ratios=np.array([0.25, 0.5]))
    with np.load(tmp_path / "run.npz") as stored:
        assert stored["ratios"].tolist() == [0.25, 0.5]
    _assert_same(load_response(tmp_path / "run.npz"), _response())


def test_a_write_that_fails_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    save_response(path, _response())
    before = path.read_bytes()

    class Unwritable:
        def __array__(self, *args: object, **kwargs: object) -> np.ndarray:
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        save_response(path, _response(), broken=Unwritable())  # type: ignore[arg-type]
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("kept", [0, 10, 500, -40])
def test_a_truncated_file_is_refused_by_name(tmp_path: Path, kept: int) -> None:
    path = tmp_path / "run_0003_abc.npz"
    save_response(path, _response())
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(ValueError, match=r"run_0003_abc\.npz"):
        load_response(path)


def test_a_flipped_bit_in_the_stored_numbers_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    response = _response()
    save_response(path, response)
    content = bytearray(path.read_bytes())
    position = bytes(content).index(response.displacement.tobytes()) + 100
    content[position] ^= 1
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"run\.npz"):
        load_response(path)


def test_an_npz_without_the_fields_of_a_response_is_refused_by_name(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", force=np.ones(3))
    with pytest.raises(ValueError, match=r"other\.npz"):
        load_response(tmp_path / "other.npz")


@pytest.mark.parametrize(
    ("name", "value"),
    [("status", np.array("bogus")), ("force", np.ones(2)), ("reached", np.ones(2))],
)
def test_fields_that_no_response_has_are_refused_by_name(
    name: str, value: np.ndarray, tmp_path: Path
) -> None:
    path = tmp_path / "run.npz"
    save_response(path, _response())
    with np.load(path) as stored:
        values = dict(stored) | {name: value}
    np.savez(path, **values)
    with pytest.raises(ValueError, match=r"run\.npz: not a readable simulation result"):
        load_response(path)


def test_one_array_alone_is_no_response(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.ones(3))
    with pytest.raises(ValueError, match=r"a\.npy: not a readable simulation result"):
        load_response(tmp_path / "a.npy")


def test_extra_arrays_do_not_take_the_place_of_fields(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="extra: expected names beside the fields', found force"):
        save_response(tmp_path / "run.npz", _response(), force=np.ones(3))
    assert not (tmp_path / "run.npz").exists()


def test_pickled_content_is_never_loaded(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    save_response(path, _response())
    with np.load(path) as stored:
        values = dict(stored)
    values["force"] = np.array([{"a": 1}], dtype=object)
    np.savez(path, **values)
    with pytest.raises(ValueError, match=r"run\.npz"):
        load_response(path)


def test_arrays_of_another_number_of_steps_are_refused() -> None:
    with pytest.raises(ValueError, match="force: expected 3 steps as in travel, found 2"):
        replace(_response(), force=np.ones(2))


def test_what_would_be_stored_as_an_object_is_refused_and_nothing_is_written(
    tmp_path: Path,
) -> None:
    with pytest.raises(ValueError, match="message: expected numbers or text"):
        save_response(tmp_path / "run.npz", replace(_response(), message=None))  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_a_force_of_several_numbers_a_step_is_refused() -> None:
    with pytest.raises(ValueError, match="force: expected one number a step"):
        replace(_response(), force=np.ones((3, 2)))
