"""What a campaign hands on: results in the order of its design, good up to the travel reached."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fe.campaign_parameters import RATIOS, Parameter
from fe.response import Array, Response, Status

BoolArray = npt.NDArray[np.bool_]

SAME_TRAVEL = 1e-9
"""mm within which a travel counts as reached"""


@dataclass(frozen=True)
class Campaign:
    """Results of all runs of a design, in its order; arrays hold NaN where a run is not good.

    Raises ValueError when results are not one a row or differ in travels.
    """

    theta: Array
    """(n, d) design in the units of the parameters; a factor as the index of its level"""
    responses: tuple[Response, ...]
    """n results, failed ones among them"""
    n_reused: int
    """runs that were found in the store"""
    parameters: tuple[Parameter, ...] = RATIOS
    """the d columns of theta"""
    unused: tuple[Path, ...] = ()
    """run files in the store of another design, model, version or format; left as they are"""

    def __post_init__(self) -> None:
        if self.theta.ndim != 2 or len(self.theta) != len(self.responses):
            raise ValueError(
                f"responses: expected one for each row of theta {self.theta.shape}, "
                f"got {len(self.responses)}"
            )
        first = self.responses[0]
        for index, response in enumerate(self.responses):
            if not np.array_equal(response.travel, first.travel):
                raise ValueError(
                    f"responses: expected the travels {first.travel.tolist()} mm in all runs, "
                    f"found {response.travel.tolist()} in run {index}"
                )
            if response.displacement.shape != first.displacement.shape:
                raise ValueError(
                    f"responses: expected fields of shape {first.displacement.shape} in all runs, "
                    f"found {response.displacement.shape} in run {index}"
                )

    @property
    def travel(self) -> Array:
        """(n_step,) travels at which responses were asked, mm."""
        return self.responses[0].travel

    @property
    def good(self) -> BoolArray:
        """(n, n_step) whether a run is good at a travel: reached, and finite up to there."""
        return np.stack([good_steps(response) for response in self.responses])

    @property
    def stable(self) -> BoolArray:
        """(n, n_step) whether a run is good and its equilibrium stable: no negative pivots.

        Values of an unstable one are a solution; its gradients need not be those along the design.
        """
        stable: BoolArray = np.stack([r.negative_pivots == 0 for r in self.responses])
        return self.good & stable

    @property
    def reached(self) -> BoolArray:
        """(n,) whether the run converged and is good up to its last travel."""
        return np.array([is_reached(response) for response in self.responses], dtype=bool)

    @property
    def n_failed(self) -> int:
        """Runs that ended before their last travel."""
        return int(np.count_nonzero(~self.reached))

    @property
    def force(self) -> Array:
        """(n, n_step) forces of the whole sample at kappa = 1 MPa, N; NaN where not good."""
        return self._where_good([response.force for response in self.responses])

    @property
    def displacement(self) -> Array:
        """(n, n_step, n_point, 3) displacements of the points seen, mm; NaN where not good."""
        return self._where_good([response.displacement for response in self.responses])

    @property
    def gradient_parameters(self) -> tuple[str, ...]:
        """Names of all parameters that the gradients of any run are in, in order of appearance."""
        names = (name for response in self.responses for name in response.parameters)
        return tuple(dict.fromkeys(names))

    @property
    def force_gradient(self) -> Array:
        """(n, n_step, n_gradient) N per unit of the parameter; NaN where not good or not known."""
        return self._where_good([self._aligned(r, r.force_gradient) for r in self.responses])

    @property
    def displacement_gradient(self) -> Array:
        """(n, n_step, n_point, 3, n_gradient) mm per unit of the parameter; NaN likewise."""
        return self._where_good([self._aligned(r, r.displacement_gradient) for r in self.responses])

    def _aligned(self, response: Response, gradient: Array) -> Array:
        """The gradient in `gradient_parameters`, NaN in those that this run does not know."""
        names = self.gradient_parameters
        aligned = np.full((*gradient.shape[:-1], len(names)), np.nan)
        aligned[..., [names.index(name) for name in response.parameters]] = gradient
        return aligned

    def _where_good(self, values: list[Array]) -> Array:
        stacked = np.stack(values)
        stacked[~self.good] = np.nan
        return stacked


def good_steps(response: Response) -> BoolArray:
    """(n_step,) whether a result is reached and finite at a travel and all before it."""
    n_step = response.travel.size
    finite = np.isfinite(response.force)
    finite &= np.isfinite(response.displacement.reshape(n_step, -1)).all(axis=1)
    within = response.travel <= response.reached + SAME_TRAVEL
    good: BoolArray = np.logical_and.accumulate(finite & within)
    return good


def is_reached(response: Response) -> bool:
    """Whether a run converged and holds finite forces and displacements at every travel."""
    return response.status is Status.CONVERGED and bool(good_steps(response).all())
