"""What a solve tells while it goes on."""

from __future__ import annotations

import logging
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fe
from fe.ending import ending
from fe.progress import StepReport
from fe.steps import March, StepOptions

BLOCK = fe.BlockPinModel(
    fe.BlockPin(),
    fe.Contact("stick", "stick"),
    (3, 1, 1),
    (0.1, 0.2),
    field_grid=(2, 2),
    steps=StepOptions(0.05, 0.05),
)
SPECIMENS = {
    "uniaxial": fe.UniaxialModel(fe.Bar(), (0.2, 0.4)),
    "tensile": fe.TensileModel(fe.NotchedPlate(), (2, 2, 1), (2.0, 4.0), field_grid=(2, 3)),
    "cylinder": fe.CylinderModel(fe.Cylinder(), (2, 2), (1.0, 2.0), n_point=4),
    "block_pin": BLOCK,
    "block_pin at forces": replace(BLOCK, travel=(), force=(0.3, 0.9)),
}


@pytest.mark.parametrize("specimen", SPECIMENS.values(), ids=SPECIMENS.keys())
def test_every_step_is_told_with_the_force_of_the_whole_sample(specimen):
    told: list[StepReport] = []
    response = fe.simulate(specimen, "neo-hookean", (0.02, 6.0), progress=told.append)
    travels = [step.travel for step in told]
    assert len(told) > 2
    assert (np.diff(travels) > 0.0).all()
    for travel, force, negative in zip(
        response.travel, response.force, response.negative_pivots, strict=True
    ):
        step = told[travels.index(travel)]
        assert (step.force, step.negative_pivots) == (force, negative)
    assert all(0 < step.iterations < 20 for step in told)  # of the step, not up to it


def test_print_shows_a_line_a_step_and_the_log_has_the_same(capsys, caplog):
    with caplog.at_level(logging.INFO, logger="fe"):
        fe.simulate(BLOCK, "neo-hookean", (0.02, 6.0), progress=print)
    lines = capsys.readouterr().out.splitlines()
    assert lines == [record.getMessage() for record in caplog.records]
    assert len(lines) == 4
    assert lines[0].startswith("travel 0.0500 mm, force 0.")
    assert lines[0].endswith(" iterations")


def test_an_unstable_step_says_so():
    assert str(StepReport(1.0, 2.5, 7, 0)) == "travel 1.0000 mm, force 2.5 N, 7 iterations"
    assert str(StepReport(1.0, 2.5, 7, 3)).endswith("unstable: 3 negative pivots")


def test_warnings_and_unstable_steps_between_those_asked_are_told_in_the_end():
    outcome = March()
    for travel, negative in ((0.1, 0), (0.2, 2), (0.3, 1), (0.4, 0)):
        at = SimpleNamespace(assembly=SimpleNamespace(pin_force=1.0), iterations=3)
        outcome.accept(SimpleNamespace(equilibrium=at, travel=travel, negative=negative))
    outcome.warn("derivatives", "no derivatives")
    outcome.warn("fall", "the force falls")
    outcome.warn("fall", "the force falls again")
    end = ending(outcome, "travel", 4.0, complete=True)
    assert end.status is fe.Status.CONVERGED
    assert end.message == (
        "reached every asked travel; no derivatives; the force falls; 2 of 4 steps ended in an "
        "unstable equilibrium, the first at a travel of 0.2000 mm"
    )


def test_listening_changes_nothing():
    quiet = fe.simulate(BLOCK, "neo-hookean", (0.02, 6.0))
    told = fe.simulate(BLOCK, "neo-hookean", (0.02, 6.0), progress=lambda step: None)
    assert told.displacement.tobytes() == quiet.displacement.tobytes()


@pytest.mark.parametrize("error", [ZeroDivisionError, ArithmeticError, OverflowError])
def test_an_error_of_the_listener_is_its_own(error):
    """And not a tangent that is singular, for which the step would be tried again."""

    def progress(step: StepReport) -> None:
        raise error("mine")

    with pytest.raises(error, match="mine"):
        fe.simulate(BLOCK, "neo-hookean", (0.02, 6.0), progress=progress)
