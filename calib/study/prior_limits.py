"""How far priors may reach: what laws, constants, inputs and sizes of errors allow."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from calib.inference.laws import Ratio
from calib.inference.prior import Marginal, hull_of
from calib.study.prior_sections import ParameterPrior
from calib.study.unknowns import (
    ERRORS,
    FRICTION,
    INPUTS,
    OF_FIELD,
    allowed,
    by_constants,
    given,
    law_of,
    off_centre,
    prior_of,
    ratio_bounds,
    rubs,
)
from calib.toml_file.refusal import Contradiction

if TYPE_CHECKING:
    from calib.study.config import Study
    from calib.study.sections import Hypothesis

LARGEST_S = 10.0  # C11 / kappa, far beyond any published for a silicone or tissue
WIDEST = 1e4  # range of a size of the errors, whose table grows with the logarithm of it
SHARPEST = 0.05  # mm, as of geometry.pin_fillet
_NEGATIVE = {"r": ("C01", "C10"), "s": ("C11", None), "c20": ("C20", None), "c30": ("C30", None)}
"""constants that are negative below and above the interval of a ratio"""


def is_positive(study: Study) -> bool:
    """Whether the study keeps constants from being negative."""
    return study.prior.positive is not False


def key_of(index: int, hypothesis: Hypothesis, name: str) -> str:
    """Where the prior of this name stands in the file: under the hypothesis or in [prior]."""
    own = hypothesis.prior is not None and getattr(hypothesis.prior, name) is not None
    return f"hypothesis.{index}.prior.{name}" if own else f"prior.{name}"


def check_law(study: Study, index: int, hypothesis: Hypothesis) -> None:
    """Raise Contradiction for constants or ratios that the law, or the sign asked for, forbids."""
    law, positive = law_of(study, hypothesis), is_positive(study)
    of = by_constants(study, hypothesis)
    if of:
        _check_constants(study, index, hypothesis, of)
    else:
        kappa = given(study, hypothesis, "kappa")
        assert kappa is not None
        if kappa.low <= 0:
            key = f"{key_of(index, hypothesis, 'kappa')}.low"
            raise Contradiction(key, kappa.low, "greater than 0: kappa is a stiffness")
        for ratio in law.ratios:
            prior = given(study, hypothesis, ratio.name)
            assert prior is not None
            _check_ratio(key_of(index, hypothesis, ratio.name), prior, ratio, positive=positive)
    _check_shares(study, index, hypothesis, positive=positive)
    _check_exponents(study, index, hypothesis)
    if not law.ratios and not any(_used(study, hypothesis, name) for name in INPUTS):
        key = "material.law" if hypothesis.law is None else f"hypothesis.{index}.law"
        expected = "a further unknown with it, e.g. [prior.bulk_ratio]: it has no ratio for an "
        raise Contradiction(key, law.name, expected + "emulator to learn over")


def _check_shares(study: Study, index: int, hypothesis: Hypothesis, *, positive: bool) -> None:
    """Shares of terms leave the first one 0 or more, where constants are to be positive."""
    names = [r.name for r in law_of(study, hypothesis).ratios if r.name.startswith("share")]
    priors = [given(study, hypothesis, name) for name in names]
    highs = [prior.high for prior in priors if prior is not None]
    if positive and sum(highs) > 1:
        key = f"{key_of(index, hypothesis, names[-1])}.high"
        left = 1 - sum(highs[:-1])
        expected = f"{left:g} or less, so that the shares leave the first term 0 or more"
        raise Contradiction(key, highs[-1], expected)


def _check_exponents(study: Study, index: int, hypothesis: Hypothesis) -> None:
    """Terms of an Ogden law in some order: exchanged, they are the same law in another place.

    A posterior of several equal modes is more than its samplers are made for.
    """
    names = [r.name for r in law_of(study, hypothesis).ratios if r.name.startswith("alpha")]
    ranges = [(name, given(study, hypothesis, name)) for name in names]
    for place, (name, prior) in enumerate(ranges):
        for other, before in ranges[:place]:
            assert prior is not None and before is not None
            if prior.low < before.high and before.low < prior.high:
                key = f"{key_of(index, hypothesis, name)}.low"
                expected = f"a range apart from that of {other} ({before.low:g} to "
                expected += f"{before.high:g}): terms in another order are the same law"
                raise Contradiction(key, prior.low, expected)


def _check_ratio(key: str, prior: ParameterPrior, ratio: Ratio, *, positive: bool) -> None:
    low, high = allowed(ratio, positive=positive)
    below, above = _NEGATIVE.get(ratio.name, ("a term of the law", "another one"))
    if prior.low < low:
        raise Contradiction(f"{key}.low", prior.low, f"{low:g} or more: below, {below} is negative")
    if prior.high > high:
        expected = f"{high:g} or less: above, {above} is negative"
        raise Contradiction(f"{key}.high", prior.high, expected)
    if ratio.name == "s" and prior.high > LARGEST_S:
        expected = f"{LARGEST_S:g} or less: no soft solid stiffens more"
        raise Contradiction(f"{key}.high", prior.high, expected)
    if ratio.nonzero and prior.low <= 0 <= prior.high:
        raise Contradiction(f"{key}.low", prior.low, "an interval of exponents without 0")


def _check_constants(
    study: Study, index: int, hypothesis: Hypothesis, names: tuple[str, ...]
) -> None:
    priors = {name: given(study, hypothesis, name) for name in names}
    for name, prior in priors.items():
        assert prior is not None
        if is_positive(study) and prior.low < 0:
            key = f"{key_of(index, hypothesis, name)}.low"
            raise Contradiction(key, prior.low, "0 or more, or prior.positive = false")
    first, second = priors["C10"], priors["C01"]
    assert first is not None and second is not None
    lowest = first.low + second.low
    if lowest <= 0:
        key = f"{key_of(index, hypothesis, 'C10')}.low"
        expected = f"C10 + C01 above 0 MPa at the lower bounds of both (their sum is {lowest:g})"
        raise Contradiction(key, first.low, expected)
    _check_ranges(study, hull_of(tuple(p.marginal() for p in priors.values() if p))[1:])
    if len(names) > 2:
        widest = ratio_bounds(study, hypothesis)[1].high
        if widest > LARGEST_S:
            expected = f"a range that ends at {LARGEST_S:g} or less: the priors of the constants "
            expected += f"allow C11 / kappa up to {widest:g}"
            raise Contradiction("design.s", study.design.s, expected)
    try:
        mass = prior_of(study, hypothesis, with_field=True).log_mass
        assert mass <= 0.0
    except ValueError as error:
        expected = "ranges that hold more of the constants' priors"
        raise Contradiction("design.r", study.design.r, expected) from error


def _check_ranges(study: Study, hull: tuple[Marginal, ...]) -> None:
    """Refuse ranges of a design that have nothing of what the priors of the constants allow."""
    ranges = (("design.r", study.design.r), ("design.s", study.design.s))
    for (key, limits), box in zip(ranges, hull, strict=False):
        if limits is None:
            continue
        if limits[0] >= limits[1]:
            raise Contradiction(key, limits, "two numbers low < high")
        if limits[0] >= box.high or limits[1] <= box.low:
            expected = f"a part of {box.low:g} to {box.high:g}, which the constants' priors allow"
            raise Contradiction(key, limits, expected)


def _used(study: Study, hypothesis: Hypothesis, name: str) -> bool:
    return given(study, hypothesis, name) is not None and rubs(hypothesis, name)


def check_inputs(study: Study, index: int, hypothesis: Hypothesis) -> None:
    """Raise Contradiction for inputs of the FE model beyond what it takes, or not there."""
    for name in INPUTS:
        prior = given(study, hypothesis, name)
        if prior is None:
            continue
        key = key_of(index, hypothesis, name)
        if name in FRICTION and not rubs(hypothesis, name):
            if key.startswith("hypothesis"):
                expected = f"none: under {hypothesis.name} no coefficient of friction is given"
                raise Contradiction(key, {}, expected)
            continue
        least, greatest, why = _limits(study, hypothesis, name)
        if prior.low < least:
            bound = f"more than {least:g}" if name == "height" else f"{least:g} or more"
            raise Contradiction(f"{key}.low", prior.low, f"{bound}{why}")
        if prior.high > greatest:
            raise Contradiction(f"{key}.high", prior.high, f"{greatest:g} or less{why}")
    if _used(study, hypothesis, "friction"):
        for name in ("pin_friction", "base_friction"):
            if _used(study, hypothesis, name):
                expected = "none beside [prior.friction], which is of pin and base together"
                raise Contradiction(key_of(index, hypothesis, name), {}, expected)
        sides = [side for side in (hypothesis.pin, hypothesis.base) if not isinstance(side, str)]
        if len(set(sides)) > 1:
            expected = f"{sides[0]:g} as for the pin: [prior.friction] is of both together"
            raise Contradiction(f"hypothesis.{index}.base", hypothesis.base, expected)
    if off_centre(study, hypothesis) and not any(_holds(study, hypothesis)):
        why = f"where nothing need keep the sample from sliding away, as under {hypothesis.name}"
        if _used(study, hypothesis, "pin_shift"):
            raise Contradiction(key_of(index, hypothesis, "pin_shift"), {}, f"none {why}")
        raise Contradiction("geometry.pin_shift", study.geometry.pin_shift, f"0 {why}")


def _holds(study: Study, hypothesis: Hypothesis) -> Iterator[bool]:
    """Whether pin and base hold the sample by the least friction that there may be."""
    for side in ("pin", "base"):
        least = getattr(hypothesis, side)
        for name, sides in FRICTION.items():
            prior = given(study, hypothesis, name)
            if side in sides and prior is not None and not isinstance(least, str):
                least = prior.low
        yield least not in ("slide", 0.0)


def check_errors(study: Study, index: int, hypothesis: Hypothesis) -> None:
    """Raise Contradiction for sizes of errors not positive or spread beyond what a table holds."""
    for name in ERRORS:
        prior = given(study, hypothesis, name)
        if prior is None:
            continue
        key = key_of(index, hypothesis, name)
        if prior.low <= 0:
            expected = "greater than 0: it is a size, of which the logarithm is inferred"
            raise Contradiction(f"{key}.low", prior.low, expected)
        if prior.high > WIDEST * prior.low:
            expected = f"at most {WIDEST:g} times low ({prior.low:g})"
            raise Contradiction(f"{key}.high", prior.high, expected)
        if name == "discrepancy" and study.noise.force_freedom is not None:
            expected = "none beside noise.force_freedom: both explain forces that are off"
            raise Contradiction(key, {}, expected)
        unknown = given(study, hypothesis, "discrepancy") is not None
        if name == "discrepancy_of_force" and not (unknown or study.noise.discrepancy > 0):
            expected = "none without [prior.discrepancy] or noise.discrepancy, which it multiplies"
            raise Contradiction(key, {}, expected)
        if name in OF_FIELD and not study.data.has_field:
            raise Contradiction(key, {}, "none: the data of this study have no field")


def _limits(study: Study, hypothesis: Hypothesis, name: str) -> tuple[float, float, str]:
    """Least and greatest value that the forward model takes, and why."""
    geometry = study.geometry
    if name == "bulk_ratio":
        return 1.0 + 1e-9, 1e5, ": it is the bulk modulus over the shear modulus"
    if name in FRICTION:
        return 0.0, 5.0, ": it is a coefficient of friction"
    if name == "height":
        last = max(study.increments) * (1 + 1e-9)
        why = f": beyond the last increment and within a factor 3 of {geometry.height:g} mm"
        return last, 3.0 * geometry.height, why
    if name == "fillet":
        widest = _least(study, hypothesis, "pin_width") / 2 * (1 - 1e-9)
        return SHARPEST, widest, ": no sharp edge, and less than half of the pin's width"
    if name == "pin_width":
        prior = given(study, hypothesis, "pin_shift")
        shifts = [geometry.pin_shift] if prior is None else [prior.low, prior.high]
        room = geometry.width - 2.0 * max(map(abs, shifts))
        least = 2.0 * _least(study, hypothesis, "fillet") * (1 + 1e-9)
        return least, room, ": the pin stands on the sample"
    room = 0.5 * (geometry.width - _least(study, hypothesis, "pin_width"))
    return -room, room, ": the pin stands on the sample"


def _least(study: Study, hypothesis: Hypothesis, name: str) -> float:
    """Least value of the pin's width or fillet: the number given, or that of its prior.

    Of two priors that bound each other, the check of the other one takes the greatest value.
    """
    prior = given(study, hypothesis, name)
    numbers = {"pin_width": study.geometry.pin_width, "fillet": study.geometry.pin_fillet}
    return numbers[name] if prior is None else prior.low
