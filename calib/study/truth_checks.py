"""What is refused of the truth behind synthetic data, each in one sentence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from calib.inference.coordinates import theta_of_constants
from calib.study.prior_limits import key_of
from calib.study.unknowns import (
    by_constants,
    given,
    inputs_of,
    law_of,
    numbers_of,
    ratio_bounds,
)
from calib.toml_file.refusal import Contradiction

if TYPE_CHECKING:
    from calib.study.config import Study
    from calib.study.sections import Hypothesis, Virtual

OF_TRUTH = ("neo-hookean", "mooney-rivlin-2", "mooney-rivlin-3")  # each has a constant more
ROUNDING = 1e-9
"""share of a prior's range by which a ratio of constants at its end may seem beyond it"""
_RATIOS = {"r": ("C01", "r = C01 / kappa"), "s": ("C11", "s = C11 / kappa")}
"""the constant behind each ratio, and how the ratio follows from it"""


def check_truth(study: Study) -> None:
    """Raise Contradiction for constants that the true hypothesis' law or its priors exclude.

    Rival hypotheses may well exclude them: that one is wrong is what the study is to find.
    """
    virtual = study.virtual
    true = [h for h in study.hypotheses if virtual is not None and h.name == virtual.hypothesis]
    if virtual is None or not true:
        return
    law = law_of(study, true[0]).name
    if law not in OF_TRUTH:
        expected = f"a hypothesis with one of the laws {', '.join(OF_TRUTH)} (it has {law})"
        raise Contradiction("virtual.hypothesis", virtual.hypothesis, expected)
    for name in ("C01", "C11")[OF_TRUTH.index(law) :]:
        if getattr(virtual, name) != 0:
            expected = f"0: the law of {virtual.hypothesis}, {law}, has no such constant"
            raise Contradiction(f"virtual.{name}", getattr(virtual, name), expected)
    _check_inputs(study, true[0])
    for name, what, value, (low, high), within in _places(study, virtual, true[0]):
        slack = ROUNDING * (high - low)
        if not low - slack <= value <= high + slack:
            expected = f"{what} within {within}, {low:g} to {high:g} (it is {value:g}): "
            expected += "no posterior finds a truth beyond"
            raise Contradiction(f"virtual.{name}", getattr(virtual, name), expected)


def _check_inputs(study: Study, hypothesis: Hypothesis) -> None:
    """Raise Contradiction for a further unknown whose number, the truth, its prior excludes."""
    for name, value in zip(
        inputs_of(study, hypothesis), numbers_of(study, hypothesis), strict=True
    ):
        prior = given(study, hypothesis, name)
        assert prior is not None  # else it is no unknown
        if not prior.low <= value <= prior.high:
            index = study.hypotheses.index(hypothesis)
            expected = (
                f"a range around {value:g}, which the truth of {hypothesis.name} has: no posterior "
                "finds a truth beyond"
            )
            raise Contradiction(key_of(index, hypothesis, name), (prior.low, prior.high), expected)


def _places(
    study: Study, virtual: Virtual, hypothesis: Hypothesis
) -> Iterator[tuple[str, str, float, tuple[float, float], str]]:
    """Key, meaning and value of all that has a range, the range and what it is of."""
    kappa, *ratios = theta_of_constants(virtual.C10, virtual.C01, virtual.C11).tolist()
    constants = by_constants(study, hypothesis)
    for name in constants or ("kappa",):
        prior = given(study, hypothesis, name)
        assert prior is not None  # refused before
        of = f"its prior under {hypothesis.name}"
        if name == "kappa":
            yield "C10", "kappa = C10 + C01 (MPa)", kappa, (prior.low, prior.high), of
        else:
            yield name, f"{name} (MPa)", getattr(virtual, name), (prior.low, prior.high), of
    names = [ratio.name for ratio in law_of(study, hypothesis).ratios]
    for name, value, box in zip(names, ratios, ratio_bounds(study, hypothesis), strict=False):
        key, what = _RATIOS[name]
        of = f"design.{name}" if constants else f"its prior under {hypothesis.name}"
        yield key, what, value, (box.low, box.high), of
