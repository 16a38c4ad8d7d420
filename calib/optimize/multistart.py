"""The same minimisation from several starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from calib.optimize.feasible_directions import feasible_directions
from calib.optimize.minimum import Minimum, Settings
from calib.optimize.problem import Array, Problem
from calib.optimize.scipy_methods import MET, slsqp, trust_constr

Method = Callable[[Problem, Array, Settings | None], Minimum]
METHODS: Mapping[str, Method] = {
    "feasible-directions": feasible_directions,
    "slsqp": slsqp,
    "trust-constr": trust_constr,
}


def multistart(
    problem: Problem,
    starts: Sequence[Array],
    settings: Settings | None = None,
    method: str = "feasible-directions",
) -> tuple[Minimum, ...]:
    """One result for each start, in order. Raises ValueError for an unknown method or no start."""
    if method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    if not len(starts):
        raise ValueError("starts: expected at least one")
    return tuple(METHODS[method](problem, start, settings) for start in starts)


def best_of(minima: Sequence[Minimum], feasibility: float = Settings.feasibility) -> Minimum:
    """The lowest of those that meet the constraints best and whose objective did not fail.

    A constraint is met up to `MET` times `feasibility`, as SciPy's methods make it. Raises
    ValueError when there is none.
    """
    if not minima:
        raise ValueError("minima: expected at least one")

    def rank(found: Minimum) -> tuple[bool, float, float]:
        is_met = found.violation <= MET * feasibility
        return not np.isfinite(found.value), 0.0 if is_met else found.violation, found.value

    return min(minima, key=rank)
