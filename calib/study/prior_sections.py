"""Sections [prior.<parameter>] of a study file, of the whole study or of one hypothesis.

The text under a field is also what a refusal says it expects.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from calib.inference.prior import Marginal
from calib.toml_file.refusal import Contradiction
from calib.toml_file.strict import STRICT


@dataclass(frozen=True, kw_only=True, config=STRICT)
class ParameterPrior:
    """[prior.<parameter>] Prior of one parameter between two bounds."""

    distribution: Literal["uniform", "log_uniform", "normal", "lognormal", "half_cauchy"]
    """family of the prior"""
    low: float
    """lower bound, in the unit of the parameter"""
    high: float
    """upper bound, in the unit of the parameter"""
    mean: float | None = None
    """mean of a normal or lognormal before it is cut off, in the unit of the parameter"""
    sd: Annotated[float, Field(gt=0)] | None = None
    """SD of a normal or lognormal before it is cut off, in the unit of the parameter"""
    median: Annotated[float, Field(gt=0)] | None = None
    """median of a half-Cauchy about 0 before it is cut off, in the unit of the parameter"""

    def __post_init__(self) -> None:
        if self.high <= self.low:
            raise Contradiction("high", self.high, f"greater than low ({self.low:g})")
        if self.distribution in {"log_uniform", "lognormal"} and self.low <= 0:
            expected = f"greater than 0 with the distribution {self.distribution}"
            raise Contradiction("low", self.low, expected)
        is_bell = self.distribution in {"normal", "lognormal"}
        is_half = self.distribution == "half_cauchy"
        if is_half and self.low < 0:
            raise Contradiction("low", self.low, "0 or more with the distribution half_cauchy")
        keys = (("mean", self.mean, is_bell), ("sd", self.sd, is_bell))
        for key, value, needed in (*keys, ("median", self.median, is_half)):
            if needed != (value is not None):
                rule = "a number" if needed else "no such key"
                expected = f"{rule} with the distribution {self.distribution}"
                raise Contradiction(key, value, expected)
        if self.distribution == "lognormal" and self.mean is not None and self.mean <= 0:
            raise Contradiction("mean", self.mean, "greater than 0 for a lognormal")
        try:
            self.marginal()
        except (ValueError, ArithmeticError) as error:  # all else that it refuses was refused above
            within = f"[{self.low:g}, {self.high:g}]"
            expected = f"a mean and an sd that leave some probability within {within}"
            raise Contradiction("mean", self.mean, expected) from error

    def marginal(self) -> Marginal:
        """The distribution; mean and SD are those of the parameter before it is cut off."""
        return Marginal(self.distribution, self.low, self.high, self.mean, self.sd, self.median)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Prior:
    """[prior] What is unknown: kappa and the ratios of the law, or its constants, and others."""

    positive: bool | None = None
    """true or false: whether constants may not be negative; true where it is not given"""
    kappa: ParameterPrior | None = None
    """a section [prior.kappa]"""
    r: ParameterPrior | None = None
    """a section [prior.r]"""
    s: ParameterPrior | None = None
    """a section [prior.s]"""
    C10: ParameterPrior | None = None
    """a section [prior.C10], with C01 (and C11) in place of kappa, r (and s), MPa"""
    C01: ParameterPrior | None = None
    """a section [prior.C01], with C10 (and C11) in place of kappa, r (and s), MPa"""
    C11: ParameterPrior | None = None
    """a section [prior.C11], with C10 and C01 in place of kappa, r and s, MPa"""
    c20: ParameterPrior | None = None
    """a section [prior.c20]: C20 / kappa of the law yeoh"""
    c30: ParameterPrior | None = None
    """a section [prior.c30]: C30 / kappa of the law yeoh"""
    alpha1: ParameterPrior | None = None
    """a section [prior.alpha1]: first exponent of an Ogden law"""
    alpha2: ParameterPrior | None = None
    """a section [prior.alpha2]: second exponent of an Ogden law"""
    share2: ParameterPrior | None = None
    """a section [prior.share2]: share of the second Ogden term in the shear modulus"""
    alpha3: ParameterPrior | None = None
    """a section [prior.alpha3]: third exponent of an Ogden law"""
    share3: ParameterPrior | None = None
    """a section [prior.share3]: share of the third Ogden term in the shear modulus"""
    bulk_ratio: ParameterPrior | None = None
    """a section [prior.bulk_ratio]: bulk modulus over shear modulus"""
    friction: ParameterPrior | None = None
    """a section [prior.friction]: coefficient of pin and base where these are numbers"""
    pin_friction: ParameterPrior | None = None
    """a section [prior.pin_friction]: coefficient of the pin where that is a number"""
    base_friction: ParameterPrior | None = None
    """a section [prior.base_friction]: coefficient of the base plate where that is a number"""
    height: ParameterPrior | None = None
    """a section [prior.height]: height of the sample, mm"""
    fillet: ParameterPrior | None = None
    """a section [prior.fillet]: radius of the pin's edges, mm"""
    pin_width: ParameterPrior | None = None
    """a section [prior.pin_width]: width of the pin, mm"""
    pin_shift: ParameterPrior | None = None
    """a section [prior.pin_shift]: how far the pin is off the sample's centre along x, mm"""
    force_noise: ParameterPrior | None = None
    """a section [prior.force_noise]: factor of the SD of the measured force's errors"""
    field_noise: ParameterPrior | None = None
    """a section [prior.field_noise]: factor of the SD of the field's noise"""
    discrepancy: ParameterPrior | None = None
    """a section [prior.discrepancy]: share by which the model errs, in the field and the forces"""
    discrepancy_of_force: ParameterPrior | None = None
    """a section [prior.discrepancy_of_force]: ln of the forces' common factor over that share"""
