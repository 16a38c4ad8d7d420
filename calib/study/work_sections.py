"""The sections of a study file on how the work is done: runs, emulator, chains, verification.

The text under a field is also what a refusal says it expects.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from calib.study.sections import Positive
from calib.toml_file.refusal import Contradiction
from calib.toml_file.strict import STRICT

LEAST_LOCAL = 4
"""runs of a second design, corners of a box of two ratios"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Design:
    """[design] FE runs over ratios and further unknowns within the bounds of their priors."""

    n_runs: Annotated[int, Field(ge=8, le=100_000)] = 20
    """number of runs that train the emulator"""
    n_held_out: Annotated[int, Field(ge=2, le=100_000)] = 4
    """number of further runs that only judge the emulator"""
    sequence: Literal["sobol", "latin"] = "sobol"
    """the points after the corners: "sobol" or "latin", a Latin hypercube whose points are far from
    each other; designs with more runs keep the points of either"""
    shape: Literal["uniform", "prior"] = "uniform"
    """how they lie between the bounds: "uniform", denser at small s alone, or "prior", as dense as
    the prior of each is"""
    n_refine: Annotated[int, Field(ge=3, le=100_000)] = 8
    """largest number of runs added where the posterior is, for each hypothesis; fewer when its mean
    will not move any more; those for further checks of the mesh not counted"""
    n_local: Annotated[int, Field(ge=0, le=256)] = 16
    """number of runs (0: none, else 4 or more) of a second design in the posterior's box, where the
    data have a field and this box is less than a tenth of the prior's; the emulator that is sampled
    then learns from the runs in it"""
    r: tuple[float, float] | None = None
    """two numbers: the range of r, where priors of the constants would leave a wider one"""
    s: tuple[float, float] | None = None
    """two numbers: the range of s, where priors of the constants would leave a wider one"""
    max_failure_rate: Annotated[float, Field(ge=0, lt=1)] = 0.2
    """share of a hypothesis' runs that may end before the last increment; beyond it the study
    stops"""

    def __post_init__(self) -> None:
        if 0 < self.n_local < LEAST_LOCAL:
            expected = f"0 or at least {LEAST_LOCAL} runs, of which an emulator can learn"
            raise Contradiction("n_local", self.n_local, expected)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class EmulatorLimits:
    """[emulator] What an emulator learns from, and the errors above which it is refused."""

    gradients: bool = True
    """whether the derivatives of the runs by r and s teach the emulator beside their values"""
    max_force_error: Positive = 0.02
    """largest relative error of a force on the runs held out"""
    max_field_error: Positive = 0.01
    """largest root mean square error of a field on the runs held out, mm"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Sampler:
    """[sampler] emcee: independent ensembles, stopped by autocorrelation time."""

    n_ensembles: Annotated[int, Field(ge=2, le=256)] = 4
    """number of independent ensembles, at least 2 so that R-hat means something"""
    n_walkers: Annotated[int, Field(ge=8, le=1024, multiple_of=2)] = 32
    """walkers of one ensemble, at least twice the number of parameters"""
    n_autocorrelation: Annotated[float, Field(ge=1)] = 50.0
    """length of the chains in integrated autocorrelation times"""
    max_steps: Annotated[int, Field(ge=100, le=10_000_000)] = 20_000
    """steps after which sampling stops in any case"""
    min_ess: Positive = 400.0
    """smallest effective sample size that passes"""
    max_r_hat: Annotated[float, Field(gt=1)] = 1.01
    """largest R-hat that passes"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Verification:
    """[verification] What follows where direct FE contradicts the emulator's maximum."""

    max_rounds: Annotated[int, Field(ge=0, le=20)] = 3
    """number of times (0 to 20) that runs are added there and the posterior is sampled anew"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Compute:
    """[compute] How the work is done; results do not depend on it."""

    workers: Annotated[int, Field(ge=0)] = 0
    """number of processes for the FE runs, 0 for one a core"""
