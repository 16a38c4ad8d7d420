"""The cost of sensitivities by the parts of a run."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.sensitivity_cost import Parts, cost_of, parts_of
from benchmarks.taylor import CONTACTS, model, rubber

PLAIN = Parts(total=11.0, solving=10.0, coupled=0.0, n_coupled=0, n_outside=0)


def test_cost_is_that_of_sensitivities_whatever_the_machines_speed() -> None:
    every = replace(PLAIN, total=12.1)
    slower = Parts(24.2, 20.0, 0.0, 0, 0)
    assert cost_of(every, PLAIN) == pytest.approx(10.0)
    assert cost_of(slower, PLAIN) == pytest.approx(10.0)


def test_a_factorisation_that_the_predictor_makes_anyway_is_the_solves() -> None:
    plain = Parts(total=11.0, solving=10.0, coupled=0.0, n_coupled=9, n_outside=0)
    every = Parts(total=12.2, solving=9.1, coupled=1.0, n_coupled=10, n_outside=10)
    assert cost_of(every, plain) == pytest.approx(100.0 * (12.2 / 11.0 - 1.0))
    alone = replace(plain, n_coupled=0)  # where a march without them makes none, it is theirs
    assert cost_of(every, alone) == pytest.approx(100.0 * (12.2 / 9.1 / 1.1 - 1.0))


@pytest.mark.parametrize("case", ["slide", "friction"])
def test_parts_of_a_run_are_within_the_whole(case: str) -> None:
    every = replace(model(CONTACTS[case]), sensitivities=("C10",))
    plain = replace(every, sensitivities=())
    with_them, without = parts_of(every, rubber()), parts_of(plain, rubber())
    for parts in (with_them, without):
        assert 0.0 < parts.solving + parts.coupled < parts.total
    assert without.coupled == 0.0
    assert with_them.n_coupled == with_them.n_outside == (3 if case == "friction" else 0)
