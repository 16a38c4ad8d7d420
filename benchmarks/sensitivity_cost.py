"""What all sensitivities of a design sample cost, by the clock of the parts of a run.

Between two runs the speed of a machine moves by more than the cost: whole runs with sensitivities
against whole runs without gave 9 to 19 % of one program in one hour.  The parts of one run share
its speed: what is not iteration for equilibrium (set-up, what is kept of each step, sensitivities)
is held against what is, with sensitivities and without.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from statistics import median
from typing import Any
from unittest.mock import patch

from threadpoolctl import threadpool_limits

from benchmarks.meshes import SAMPLING_CELLS
from fe import BlockPin, BlockPinModel, Contact, load_stepping
from fe.linear_solver import installed_library
from fe.materials import Material

CASES = {"stick": "bar, stick", "slide": "bar, frictionless", "friction": "bar, friction"}
"""whose sampling meshes the cost is measured on"""
TRAVEL = (0.6, 0.8, 1.0, 1.2, 1.4)
"""mm, of a design sample"""


@dataclass(frozen=True)
class Parts:
    """Processor time of a run, s."""

    total: float
    solving: float
    """predictors and iterations for equilibrium, factorisations in them too"""
    coupled: float
    """factorisations of the unsymmetric tangent of friction outside `solving`"""
    n_coupled: int
    """number of factorisations of that tangent, within `solving` and outside"""
    n_outside: int
    """number of those outside"""


def cost_of(every: Parts, plain: Parts) -> float:
    """Cost of the sensitivities of run `every` over a run without them, per cent.

    The unsymmetric tangent of a step is factorised once for its sensitivities and the predictor of
    the next step; as many times as a run without sensitivities does so it is the solve's.
    """
    shared = min(every.n_outside, plain.n_coupled) / max(every.n_outside, 1)
    solving = every.solving + shared * every.coupled
    with_them, without = every.total / solving, plain.total / plain.solving
    return 100.0 * (with_them / without - 1.0)


def cost_percent(case: str, contact: Contact, law: Material, repeats: int = 5) -> float:
    """Median of `repeats` pairs of runs of a design sample, one with and one without, per cent."""
    plain = BlockPinModel(
        BlockPin(), contact, SAMPLING_CELLS[CASES[case]], TRAVEL, sensitivities=()
    )
    every = replace(plain, sensitivities=plain.parameter_names(law))
    with threadpool_limits(limits=1):
        every.respond(law)  # compiles
        return median(cost_of(parts_of(every, law), parts_of(plain, law)) for _ in range(repeats))


def parts_of(model: BlockPinModel, law: Material) -> Parts:
    """Processor time of the parts of one run of a model with a material."""
    clock = _Clock()
    with clock.running():
        started = time.process_time()
        model.respond(law)
        total = time.process_time() - started
    return Parts(total, clock.solving, clock.coupled, clock.n_coupled, clock.n_outside)


class _Clock:
    """Times the functions that solve, and factorisations of unsymmetric matrices."""

    def __init__(self) -> None:
        self.solving = self.coupled = 0.0
        self.n_coupled = self.n_outside = 0
        self._within = False

    @contextmanager
    def running(self) -> Iterator[None]:
        matrix = installed_library().matrix
        with ExitStack() as patches:
            for name in ("equilibrate", "_predict"):
                timed = self._solving(getattr(load_stepping, name))
                patches.enter_context(patch.object(load_stepping, name, timed))
            timed = self._factorising(matrix.factorise)
            patches.enter_context(patch.object(matrix, "factorise", timed))
            yield

    def _solving(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any, **named: Any) -> Any:
            started, self._within = time.process_time(), True
            try:
                return function(*arguments, **named)
            finally:
                self.solving += time.process_time() - started
                self._within = False

        return timed

    def _factorising(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(matrix: Any, data: Any) -> Any:
            if matrix._symmetric:
                return function(matrix, data)
            self.n_coupled += 1
            started = time.process_time()
            found = function(matrix, data)
            if not self._within:
                self.coupled += time.process_time() - started
                self.n_outside += 1
            return found

        return timed
