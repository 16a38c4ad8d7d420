"""What a look at the posterior asks for: mesh checked again while the mean is far from it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib.study import next_runs
from calib.study.judgement import Noise
from calib.study.local_design import MOST_BOXES, MOST_CUT, MOST_LOST
from calib.study.mesh_remarks import FAR
from calib.study.next_runs import MOST_CHECKS, SETTLED, Choice
from calib.study.refine_rounds import Loop
from fe.response import Array

SD = np.array([0.1, 0.02, 0.01])
"""of ln kappa, r, s"""


def choice(*, field: float | None = 0.01, n_local: int = 0) -> Choice:
    return Choice(
        design=np.zeros((4, 2)),
        box=np.array([[0.0, 1.0], [0.0, 0.5]]),
        noise=Noise(np.full(5, 0.01), field),
        n_refine=8,
        n_local=n_local,
        seed=1,
    )


def look(*mean: float, rests: bool = True) -> Any:
    """An outlook with this posterior mean of (r, s)."""
    shift = np.zeros(3)
    return SimpleNamespace(
        mean=np.array(mean),
        quadrature=SimpleNamespace(sd=SD, space=SimpleNamespace(x_names=("ln kappa", "r", "s"))),
        shift=SimpleNamespace(is_small=rests, shift=shift),
        foretold=SimpleNamespace(shift=shift),
        seen=SimpleNamespace(stated=shift, seen=shift, sd_ratio=np.ones(3)),
        emulator=SimpleNamespace(header=SimpleNamespace(n_train=4)),
        proposals=lambda n, runs, noise, rng: np.full((n, 2), 0.5),
    )


@pytest.fixture(autouse=True)
def boxes(monkeypatch: pytest.MonkeyPatch) -> None:
    def box_of(quadrature: object, box: Array) -> Array:
        return box / 4.0

    monkeypatch.setattr(next_runs, "box_of", box_of)


def start() -> Loop:
    return Loop(np.zeros((0, 2)))


def go(loop: Loop, found: Any, by: Choice) -> Loop:
    return by.next_runs(loop, found, np.random.default_rng(1))


def test_the_mesh_is_checked_at_means_until_they_stay_near() -> None:
    by = choice()
    loop = go(start(), look(0.3, 0.1), by)
    assert loop.checked == (0,) and not loop.done
    for row, r in ((1, 0.6), (2, 0.7)):  # the correction of the mesh moves the mean
        loop = go(loop, look(r, 0.12), by)
        assert loop.checked == (*range(row + 1),) and not loop.done
        assert loop.ratios[-1].tolist() == [r, 0.12]
    near = 0.7 + 0.9 * SETTLED * FAR * SD[1]
    loop = go(loop, look(near, 0.12), by)
    assert loop.done and loop.checked == (0, 1, 2, 3)
    assert loop.ratios[-1, 0] == near


def test_after_a_check_that_may_have_moved_the_mean_there_is_another_look() -> None:
    by = choice()
    loop = go(start(), look(0.3, 0.1), by)
    off = 0.3 + 1.1 * SETTLED * FAR * SD[1]
    loop = go(loop, look(off, 0.1), by)  # near enough to go on, too far to end there
    assert loop.checked == (0, 1) and loop.ratios[-1, 0] == off and not loop.done
    loop = go(loop, look(off, 0.1), by)
    assert loop.done and loop.checked == (0, 1, 2)


def test_a_mean_that_never_stays_is_checked_a_few_times_only() -> None:
    by, loop = choice(), start()
    for k in range(MOST_CHECKS):
        assert not loop.done
        loop = go(loop, look(0.2 + 0.6 * (k % 2), 0.1), by)
    loop = go(loop, look(0.5, 0.1), by)
    assert loop.done and loop.checked == tuple(range(MOST_CHECKS + 1))


def test_forces_alone_have_the_mesh_checked_at_the_first_and_the_last_mean() -> None:
    by = choice(field=None)
    loop = go(start(), look(0.3, 0.1), by)
    loop = go(loop, look(0.9, 0.4, rests=False), by)
    assert loop.checked == (0,) and len(loop.ratios) == 1 + next_runs.BATCH
    loop = go(loop, look(0.9, 0.4), by)
    assert loop.done and loop.checked == (0, 1 + next_runs.BATCH)


def test_the_second_design_waits_for_a_mean_that_the_mesh_does_not_move() -> None:
    by = choice(n_local=6)
    loop = go(go(start(), look(0.3, 0.1), by), look(0.6, 0.1), by)
    assert loop.box is None
    loop = go(loop, look(0.61, 0.1), by)
    assert loop.box is not None and len(loop.local) == 6 and loop.checked == (0, 1)


@pytest.mark.parametrize("beyond", [MOST_CUT, MOST_LOST])
def test_a_box_that_does_not_hold_the_posterior_is_moved_and_given_up_in_the_end(
    beyond: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(next_runs, "mass_beyond", lambda *_: 1.01 * beyond)
    by = choice(n_local=6)
    loop = go(go(start(), look(0.3, 0.1), by), look(0.31, 0.1), by)
    for k in range(1, MOST_BOXES + 1):
        assert loop.box is not None and loop.n_boxes == k and len(loop.local) == 6 * k
        loop = go(loop, look(0.31, 0.1), by)
    assert loop.n_boxes == MOST_BOXES and len(loop.local) == 6 * MOST_BOXES
    if beyond == MOST_CUT:  # the last box holds enough of it
        assert loop.box is not None and loop.done
        return
    assert loop.box is None and not loop.done
    looked: list[Array] = []

    def proposals(n: int, runs: Array, *_: object) -> Array:
        looked.append(runs)
        return np.full((n, 2), 0.5)

    found = look(0.31, 0.1, rests=False)
    found.proposals = proposals
    loop = go(loop, found, by)
    # Its runs teach the emulator nothing any more, so that they keep no other run away.
    single = np.delete(loop.ratios, loop.local, axis=0)[: -next_runs.BATCH]
    np.testing.assert_array_equal(looked[0], np.concatenate([by.design, single]))
    loop = go(loop, look(0.31, 0.1), by)  # nor is there another one
    assert loop.box is None and loop.done and len(loop.local) == 6 * MOST_BOXES


def test_further_checks_do_not_count_as_runs_of_refinement() -> None:
    by = replace(choice(), n_refine=4)
    loop = go(go(start(), look(0.3, 0.1), by), look(0.6, 0.1), by)
    for _ in range(2):
        assert not loop.done
        loop = go(loop, look(0.6, 0.1, rests=False), by)
    # The first at the mean and two beside it, the check between not counted; now the last.
    loop = go(loop, look(0.6, 0.1, rests=False), by)
    assert loop.done and len(loop.ratios) - len(loop.checked) == 2
