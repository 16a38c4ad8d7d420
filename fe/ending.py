"""How a march ended, in the words of a `Response`."""

from __future__ import annotations

from typing import NamedTuple

from fe.force_control import Control
from fe.response import Status
from fe.steps import March


class Ending(NamedTuple):
    """Status of a run, the travel up to which it is good, and one sentence."""

    status: Status
    reached: float
    """mm"""
    message: str


def ending(outcome: March, control: Control, symmetry: float, *, complete: bool) -> Ending:
    """Ending of a march that met all its targets (`complete`) or not; the sample has `symmetry`
    modelled parts.
    """
    parts = [f"reached every asked {control}"] if complete else [outcome.reason]
    if not complete and control == "force":
        parts.append(f"the largest force was {symmetry * outcome.largest_force:.4g} N")
    parts.extend(outcome.warnings.values())
    if outcome.unstable_from is not None:
        parts.append(
            f"{outcome.n_unstable} of {outcome.n_steps} steps ended in an unstable equilibrium, "
            f"the first at a travel of {outcome.unstable_from:.4f} mm"
        )
    reached = outcome.reached if outcome.good_until is None else outcome.good_until
    met = outcome.left_by or Status.CONVERGED
    return Ending(met if complete else Status.STOPPED, reached, "; ".join(parts))
