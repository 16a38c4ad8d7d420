"""Full steps with friction: which are taken, and what a refused one leaves behind."""

from __future__ import annotations

import numpy as np
import pytest

import fe.newton
from fe import BlockPin, BlockPinModel, Contact
from fe.potential import Assembly
from fe.whole_step import is_nearer


@pytest.fixture(scope="module")
def pressed():
    """Steps by a line search of a pressed block: (state that was kept is its own, was tried)."""
    descend, found = fe.newton._descend, []

    def watched(potential, along, here, travel, memory, recent, negative, options, tried):
        moved = descend(potential, along, here, travel, memory, recent, negative, options, tried)
        if isinstance(moved, str):
            return moved
        u, p, kept = moved
        pressure = potential.pressure_step(u)
        whole = potential.coupled_tangent().data
        anew = potential.assemble(u, p, travel, memory)
        same = (
            np.array_equal(kept.gradient, anew.gradient)
            and np.array_equal(kept.data, anew.data)
            and np.array_equal(pressure, potential.pressure_step(u))
            and np.array_equal(whole, potential.coupled_tangent().data)
        )
        taken = tried is not None and kept is tried.trial
        found.append((same, tried is not None, taken))
        return moved

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fe.newton, "_descend", watched)
        model = BlockPinModel(BlockPin(), Contact(0.1, 0.1), (8, 2, 2), (1.4,))
        assert model([0.5, 0.05]).reached == 1.4
    return np.array(found)


def test_a_refused_step_that_the_line_search_takes_is_not_assembled_again(pressed):
    same, tried, taken = pressed.T
    assert tried.sum() > taken.sum() > 0
    assert same.all()


def test_a_refused_step_that_does_not_go_down_leaves_the_state_assembled(monkeypatch):
    """Else the search's pressure steps would be of the place where that step led."""
    whole_step, descend, asked, found = fe.newton.whole_step, fe.newton._descend, [], []

    def uphill(potential, solver, u, p, assembly, travel, memory, **options):
        step = whole_step(potential, solver, u, p, assembly, travel, memory, **options)
        asked.append(potential.pressure_step(u))
        away = potential.assemble(u - 0.5 * step.du, p, travel, memory)
        return step._replace(along=-step.along, du=-0.5 * step.du, trial=away)

    def watched(potential, along, here, travel, memory, *rest):
        u, p, _ = here
        if asked:
            asked.clear()
            assert rest[-1] is None
            before = potential.pressure_step(u)
            potential.assemble(u, p, travel, memory)
            found.append(np.array_equal(before, potential.pressure_step(u)))
        return descend(potential, along, here, travel, memory, *rest)

    monkeypatch.setattr(fe.newton, "whole_step", uphill)
    monkeypatch.setattr(fe.newton, "_descend", watched)
    BlockPinModel(BlockPin(), Contact(0.3, 0.3), (4, 2, 1), (0.1,))([0.5, 0.05])
    assert len(found) > 3 and all(found)


def state(residual: float, energy: float = 1.0, smallest_J: float = 0.5) -> Assembly:
    none = np.zeros(0)
    return Assembly(
        energy, smallest_J, np.array([0.0, residual]), none, none, 1.0, none, 0.0, 1.0, None
    )


@pytest.mark.parametrize(
    ("trial", "expected"),
    [
        (state(0.69), True),
        (state(-0.69), True),
        (state(0.71), False),
        (state(np.nan), False),
        (state(0.1, energy=np.inf), False),
        (state(0.1, smallest_J=0.0), False),
    ],
)
def test_a_step_is_taken_where_the_residual_falls_far_enough_and_no_element_turns(trial, expected):
    assert is_nearer(trial, state(1.0), 0.7) is expected
