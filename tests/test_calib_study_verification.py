"""Rounds of verification: runs at the FE maximum train the emulator until the two agree.

On an analytic stand-in whose force waves over r in a way that a first emulator cannot know.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from analytic_block import AnalyticBlock, analytic_block

from calib.study import verification
from calib.study.artifacts import hash_of_file, read_json, write_json
from calib.study.config import Study, load_study
from calib.study.context import Context
from calib.study.map_stage import trained_at
from calib.study.maxima_table import (
    CONFIRMED_SD,
    confirmation,
    is_verified,
    largest_difference,
    rounds_table,
)
from calib.study.sections import Cells, Hypothesis
from calib.study.stages import run_stages
from calib.study.train_stage import DIAGNOSTICS, load_emulator
from fe.executors import serial_map
from fe.response import Array, Response


@dataclass(frozen=True)
class Wavy:
    """The stand-in with forces that wave over r, most at the last travel, with exact slopes."""

    block: AnalyticBlock
    rate: float = 200.0
    height: float = 0.06

    def points(self) -> Array:
        return self.block.points()

    def __call__(self, ratios: Array) -> Response:
        found = self.block(ratios)
        wave = self.height * found.travel / found.travel[-1]
        factor = 1.0 + wave * np.sin(self.rate * ratios[0])
        gradient = found.force_gradient * factor[:, None]
        gradient[:, 0] += found.force * wave * self.rate * np.cos(self.rate * ratios[0])
        return replace(found, force=found.force * factor, force_gradient=gradient)


def wavy_block(study: Study, hypothesis: Hypothesis, cells: Cells) -> Wavy:
    return Wavy(analytic_block(study, hypothesis, cells))


def small(max_rounds: int) -> Study:
    """One hypothesis, few runs, short chains; the emulator is told no slopes."""
    study = load_study("thesis-forces")
    return replace(
        study,
        hypotheses=study.hypotheses[1:],
        prior=replace(
            study.prior,
            kappa=replace(study.prior.kappa, low=0.008, high=0.02),
            r=replace(study.prior.r, high=0.5),
            s=replace(study.prior.s, high=0.25),
        ),
        design=replace(study.design, n_runs=8, n_held_out=4, n_refine=3),
        emulator=replace(study.emulator, gradients=False, max_force_error=1.0, max_field_error=1.0),
        sampler=replace(study.sampler, n_ensembles=2, n_walkers=16, max_steps=600),
        verification=replace(study.verification, max_rounds=max_rounds),
    )


def a_context(
    out: Path, max_rounds: int = 3, echo: Callable[[str], None] = lambda _: None
) -> Context:
    return Context(small(max_rounds), out, wavy_block, serial_map, echo, show_progress=False)  # type: ignore[arg-type]


def facts(difference: list[float | None], at: list[float]) -> dict[str, object]:
    """A hypothesis' part of map.json: the FE maximum is at x = (ln kappa, *at)."""
    return {
        "difference_sd_x": difference,
        "foretold_sd_x": difference,
        "fe_x": [-4.0, *at],
        "solved_at": [at, [at[0] + 0.001, at[1]], [at[0] + 0.1, at[1]], [0.4, 0.2]],
        "n_fe_solves": 4,
    }


@pytest.fixture
def mapped(tmp_path: Path) -> Context:
    """A folder in which a search by direct FE ended 0.5 SD from the emulator's maximum."""
    context = a_context(tmp_path, max_rounds=2)
    write_json(tmp_path / "map.json", {"sliding": facts([0.1, -0.5, 0.0], [0.25, 0.1])})
    write_json(tmp_path / DIAGNOSTICS, {"sliding": {"n_train": 8}})
    write_json(tmp_path / "refinement.json", {})
    return context


def add(context: Context, base: str = "b", trained: Array | None = None) -> bool:
    at = np.array([[0.0, 0.0], [0.4, 0.2]]) if trained is None else trained
    return verification.add_round(context, base, context.out / "refinement.json", {"sliding": at})


def test_only_a_difference_of_every_unknown_within_the_limit_is_verified() -> None:
    assert is_verified(facts([0.1, -CONFIRMED_SD], [0.2, 0.1]))
    assert not is_verified(facts([0.1, -0.201], [0.2, 0.1]))
    assert not is_verified(facts([None, None], [0.2, 0.1]))
    assert largest_difference(facts([0.1, -0.3], [0.2, 0.1])) == 0.3
    assert "not verified" in confirmation("a", facts([0.1, -0.3], [0.2, 0.1]))
    assert "0.3 SD apart" in confirmation("a", facts([0.1, -0.3], [0.2, 0.1]))


def test_the_fe_maximum_is_learnt_from_and_what_is_apart_of_all_runs(mapped: Context) -> None:
    assert add(mapped)
    # The solve 0.001 away would contradict slopes, and (0.4, 0.2) has trained the emulator.
    found = verification.added(mapped.out, mapped.study.hypotheses[0], 2)
    np.testing.assert_allclose(found, [[0.25, 0.1], [0.35, 0.1]])
    assert list(verification.inputs(mapped)) == ["runs at the maximum"]


def test_rounds_end_at_the_studys_number_and_where_nothing_is_left_to_learn(
    mapped: Context,
) -> None:
    assert add(mapped) and add(mapped)
    assert not add(mapped)
    assert len(verification.load_rounds(mapped.out)) == 2
    known = np.array([[0.25, 0.1], [0.35, 0.1], [0.4, 0.2]])
    (mapped.out / verification.FILE).unlink()
    assert not add(mapped, trained=known)
    assert verification.load_rounds(mapped.out) == []


def test_no_round_is_added_to_what_is_verified(mapped: Context) -> None:
    write_json(mapped.out / "map.json", {"sliding": facts([0.1, 0.0, 0.0], [0.25, 0.1])})
    assert not add(mapped)
    assert not (mapped.out / verification.FILE).exists()


def test_rounds_belong_to_what_the_first_maximum_was_made_from(mapped: Context) -> None:
    assert add(mapped) and add(mapped)
    verification.drop_foreign(mapped, "b")
    assert len(verification.load_rounds(mapped.out)) == 2
    verification.drop_foreign(a_context(mapped.out, max_rounds=1), "b")
    assert len(verification.load_rounds(mapped.out)) == 1
    verification.drop_foreign(mapped, "another")
    assert verification.load_rounds(mapped.out) == []


def test_the_rounds_are_shown_with_the_last_state(mapped: Context) -> None:
    assert add(mapped)
    last = {"sliding": facts([0.02, 0.05, 0.0], [0.25, 0.1])}
    table = rounds_table(last, verification.load_rounds(mapped.out), {"sliding": 10})
    assert table is not None
    assert [row[1:] for row in table.rows] == [
        ("0", "8", "0.500", "4", "NO", "2"),
        ("1", "10", "0.0500", "4", "yes", "-"),
    ]
    assert rounds_table(last, [], {"sliding": 8}) is None


@pytest.mark.slow
def test_a_poor_emulator_is_told_without_rounds_and_repaired_by_them(tmp_path: Path) -> None:
    lines: list[str] = []
    never = a_context(tmp_path, max_rounds=0, echo=lines.append)
    ran = run_stages(never, until="map")
    assert ran.count("refine") == 1 and ran.count("map") == 1
    maps = read_json(tmp_path / "map.json")
    # That is said, with the figure.
    apart = largest_difference(maps["sliding"])
    assert apart > CONFIRMED_SD and not is_verified(maps["sliding"])
    assert f"{apart:.2g} SD apart" in confirmation("sliding", maps["sliding"])
    assert verification.load_rounds(tmp_path) == []
    assert load_emulator(tmp_path, never.study.hypotheses[0]).header.n_train == 11
    runs = {p.name: hash_of_file(p) for p in tmp_path.rglob("run_*.npz")}

    more = a_context(tmp_path, max_rounds=3)
    assert run_stages(more, until="map") == ("refine", "check", "sample", "map")
    maps, rounds = read_json(tmp_path / "map.json"), verification.load_rounds(tmp_path)
    assert is_verified(maps["sliding"]) and 1 <= len(rounds) <= 3
    assert rounds[0]["sliding"]["difference_sd"] == pytest.approx(apart, rel=1e-9)
    # Nothing that was solved was solved again, and a finished study stays as it is.
    assert runs.items() <= {p.name: hash_of_file(p) for p in tmp_path.rglob("run_*.npz")}.items()
    assert run_stages(more, until="map") == ()
    n_points = sum(len(each["sliding"]["added"]) for each in rounds)
    assert len(trained_at(more, more.study.hypotheses[0])) == 11 + n_points


@pytest.mark.slow
def test_the_rounds_do_not_depend_on_the_folders_past(tmp_path: Path) -> None:
    folders = [tmp_path / "fresh", tmp_path / "other"]
    run_stages(a_context(folders[0], max_rounds=1), until="map")
    run_stages(a_context(folders[1], max_rounds=0), until="map")
    run_stages(a_context(folders[1], max_rounds=1), until="map")
    for name in ("map.json", "samples_sliding.npz", "emulator_sliding.npz", "verification.json"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes(), name
