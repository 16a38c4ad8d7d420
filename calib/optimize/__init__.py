"""Constrained minimisation: the method of feasible directions, and SciPy's beside it.

A leaf package: imports nothing else of `calib`.
"""

from calib.optimize.feasible_directions import feasible_directions
from calib.optimize.minimum import Minimum, Settings, Status
from calib.optimize.multistart import METHODS, Method, best_of, multistart
from calib.optimize.problem import DifferenceSteps, Evaluations, Problem
from calib.optimize.scipy_methods import slsqp, trust_constr

__all__ = [
    "METHODS",
    "DifferenceSteps",
    "Evaluations",
    "Method",
    "Minimum",
    "Problem",
    "Settings",
    "Status",
    "best_of",
    "feasible_directions",
    "multistart",
    "slsqp",
    "trust_constr",
]
