"""What is unknown under one hypothesis of a study: names, priors, coordinates, design."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calib.inference.coordinates import Unknown
from calib.inference.laws import LawCoordinates, Ratio
from calib.inference.prior import Marginal, Prior, hull_of
from calib.study.prior_sections import ParameterPrior
from fe.campaign_parameters import RATIOS, Parameter
from fe.response import Array
from surrogate.design import unit_design

if TYPE_CHECKING:
    from calib.study.config import Study
    from calib.study.sections import Hypothesis

INPUTS = {
    unknown.name: (unknown, role)
    for unknown, role in (
        (Unknown("bulk_ratio", "1", "bulk modulus over shear modulus", log=True), "material"),
        (Unknown("friction", "1", "coefficient of friction of pin and base"), "contact"),
        (Unknown("pin_friction", "1", "coefficient of friction of the pin"), "contact"),
        (Unknown("base_friction", "1", "coefficient of friction of the base"), "contact"),
        (Unknown("height", "mm", "height of the sample"), "geometry"),
        (Unknown("fillet", "mm", "radius of the pin's edges"), "geometry"),
        (Unknown("pin_width", "mm", "width of the pin"), "geometry"),
        (Unknown("pin_shift", "mm", "distance of the pin from the centre"), "geometry"),
    )
}
"""further unknowns of the forward model, and what they belong to"""
FRICTION = {"friction": ("pin", "base"), "pin_friction": ("pin",), "base_friction": ("base",)}
"""what each coefficient is of"""
ERRORS = {
    unknown.name: unknown
    for unknown in (
        Unknown("force_noise", "1", "factor of the SD of the force's errors", log=True),
        Unknown("field_noise", "1", "factor of the SD of the field's noise", log=True),
        Unknown("discrepancy", "1", "share by which the model errs", log=True),
        Unknown("discrepancy_of_force", "1", "SD of ln of the forces' factor over it", log=True),
    )
}
"""unknowns of the errors"""
OF_FIELD = ("field_noise",)
RATIO = ParameterPrior(distribution="lognormal", low=0.2, high=20.0, mean=2.5, sd=2.0)
"""of `discrepancy_of_force` where nothing is said of it: 2, known to a factor of two. Taken as
known it covers the stiffness of half of the wrong models tried"""
CONSTANTS = ("C10", "C01", "C11")
LARGEST_CORNERS = 8
"""corners of the box that a design begins with where there are more than three inputs"""


def law_of(study: Study, hypothesis: Hypothesis) -> LawCoordinates:
    """The law under a hypothesis, by kappa and ratios."""
    return LawCoordinates(hypothesis.law or study.material.law)


def given(study: Study, hypothesis: Hypothesis, name: str) -> ParameterPrior | None:
    """The prior of one parameter under a hypothesis: its own, or else the study's."""
    own = None if hypothesis.prior is None else getattr(hypothesis.prior, name)
    found: ParameterPrior | None = getattr(study.prior, name) if own is None else own
    if found is None and name == "discrepancy_of_force":
        known = study.noise.discrepancy_of_force is not None
        return None if known or given(study, hypothesis, "discrepancy") is None else RATIO
    return found


def by_constants(study: Study, hypothesis: Hypothesis) -> tuple[str, ...]:
    """Names of the constants that have the priors; none where kappa and ratios have them."""
    own = hypothesis.prior
    if own is not None and own.kappa is not None:
        return ()
    names = CONSTANTS[: 1 + len(law_of(study, hypothesis).ratios)]
    return names if given(study, hypothesis, "C10") is not None else ()


def inputs_of(study: Study, hypothesis: Hypothesis) -> tuple[str, ...]:
    """Names of the further unknowns of the forward model under a hypothesis, in order.

    A coefficient of friction is one where pin or base have a number.
    """
    return tuple(
        name
        for name in INPUTS
        if given(study, hypothesis, name) is not None and rubs(hypothesis, name)
    )


def rubs(hypothesis: Hypothesis, name: str) -> bool:
    """Whether there is contact with friction for a coefficient of this name; True for others."""
    sides = FRICTION.get(name)
    return sides is None or any(not isinstance(getattr(hypothesis, s), str) for s in sides)


def ratio_bounds(study: Study, hypothesis: Hypothesis) -> tuple[Marginal, ...]:
    """Marginals of the ratios: their priors, or the box around what priors of constants allow.

    Ranges of the design narrow that box, and never widen it.
    """
    names = by_constants(study, hypothesis)
    if not names:
        ratios = law_of(study, hypothesis).ratios
        return tuple(_marginal(study, hypothesis, ratio.name) for ratio in ratios)
    hull = hull_of(tuple(_marginal(study, hypothesis, name) for name in names))[1:]
    ranges = (study.design.r, study.design.s)
    return tuple(
        box
        if limits is None
        else Marginal("uniform", max(limits[0], box.low), min(limits[1], box.high))
        for box, limits in zip(hull, ranges, strict=False)
    )


def prior_of(study: Study, hypothesis: Hypothesis, *, with_field: bool) -> Prior:
    """The study's prior of all that is unknown under a hypothesis.

    `with_field`: whether there is a measured field, whose errors may have unknowns.
    """
    names = by_constants(study, hypothesis)
    of = tuple(_marginal(study, hypothesis, name) for name in names)
    ratios = ratio_bounds(study, hypothesis)
    law = law_of(study, hypothesis)
    named = dict(zip((ratio.name for ratio in law.ratios), ratios, strict=True))
    inputs = inputs_of(study, hypothesis)
    errors = [name for name in ERRORS if given(study, hypothesis, name) is not None]
    return Prior(
        kappa=hull_of(of)[0] if of else _marginal(study, hypothesis, "kappa"),
        r=named.pop("r", None),
        s=named.pop("s", None),
        ratios=tuple(named.values()),
        law=law.name,
        inputs=tuple((INPUTS[n][0], _marginal(study, hypothesis, n)) for n in inputs),
        errors=tuple(
            (ERRORS[n], _marginal(study, hypothesis, n))
            for n in errors
            if with_field or n not in OF_FIELD
        ),
        of=of,
    )


def parameters_of(study: Study, hypothesis: Hypothesis) -> tuple[Parameter, ...]:
    """Columns of a design: the coordinates that the emulator learns over."""
    ratios, inputs = law_of(study, hypothesis).ratios, inputs_of(study, hypothesis)
    if not inputs and tuple(ratio.name for ratio in ratios) == ("r", "s"):
        return RATIOS
    columns = [Parameter(ratio.name, "1", "material") for ratio in ratios]
    for name in inputs:
        unknown, role = INPUTS[name]
        columns.append(Parameter(unknown.x_name, unknown.unit, role))
    return tuple(columns)


def design_box(study: Study, hypothesis: Hypothesis) -> Array:
    """(d, 2) bounds of the columns of a design."""
    prior = prior_of(study, hypothesis, with_field=False)
    return prior.bounds[1 : prior.space.n_forward]


def design_points(study: Study, hypothesis: Hypothesis) -> Array:
    """(n_runs + n_held_out, d) design over the box of the priors; training runs first.

    Corners come first, all of them up to three inputs, so that the emulator interpolates
    everywhere; the runs held out are later points of the same sequence, inside the box. Points of
    a uniform design are denser at small s: there C11, which matters most at large strain, changes
    the shape of the force curve fastest. Those of the prior's shape have its quantiles.
    """
    n, box = study.design.n_runs + study.design.n_held_out, design_box(study, hypothesis)
    corners = None if len(box) <= 3 else LARGEST_CORNERS
    unit = unit_design(n, len(box), study.seed, sequence=study.design.sequence, n_corners=corners)
    if study.design.shape == "prior":
        return _by_prior(unit, prior_of(study, hypothesis, with_field=False), box)
    names = [parameter.name for parameter in parameters_of(study, hypothesis)]
    if "s" in names:
        unit[:, names.index("s")] **= 2
    return np.column_stack(
        [low + (high - low) * unit[:, i] for i, (low, high) in enumerate(box.tolist())]
    )


def _by_prior(unit: Array, prior: Prior, box: Array) -> Array:
    """(n, d) quantiles of the prior at (n, d) places of the unit box, whose faces are the box'."""
    probability = np.full((len(unit), prior.space.size), 0.5)
    probability[:, 1 : prior.space.n_forward] = unit
    points = np.clip(prior.quantile(probability)[:, 1 : prior.space.n_forward], *box.T)
    # Each prior ends at its face of the box; logarithms are rounded there.
    low, high = np.broadcast_to(box.T[:, None], (2, *unit.shape))
    found: Array = np.where(unit == 0.0, low, np.where(unit == 1.0, high, points))
    return found


def fixed_values(study: Study, hypothesis: Hypothesis) -> Array:
    """(n_input,) coordinates of the numbers that the study gives for its further unknowns.

    They are the truth of a synthetic experiment.
    """
    names, values = inputs_of(study, hypothesis), numbers_of(study, hypothesis)
    pairs = zip(names, values, strict=True)
    return np.array([np.log(value) if INPUTS[name][0].log else value for name, value in pairs])


def numbers_of(study: Study, hypothesis: Hypothesis) -> tuple[float, ...]:
    """(n_input,) the numbers that the study gives for its further unknowns, in their units."""
    rubbing = [s for s in (hypothesis.pin, hypothesis.base) if not isinstance(s, str)]
    numbers = {
        "bulk_ratio": study.bulk_ratio(hypothesis),
        "friction": rubbing[0] if rubbing else 0.0,
        "pin_friction": hypothesis.pin,
        "base_friction": hypothesis.base,
        "height": study.height(hypothesis),
        "fillet": study.geometry.pin_fillet,
        "pin_width": study.geometry.pin_width,
        "pin_shift": study.geometry.pin_shift,
    }
    return tuple(float(numbers[name]) for name in inputs_of(study, hypothesis))


def off_centre(study: Study, hypothesis: Hypothesis) -> bool:
    """Whether the pin may stand off the sample's centre, so that a half is modelled."""
    return study.geometry.pin_shift != 0.0 or given(study, hypothesis, "pin_shift") is not None


def least_height(study: Study, hypothesis: Hypothesis) -> float:
    """The least height of the sample that a hypothesis allows for, mm."""
    prior = given(study, hypothesis, "height")
    return study.height(hypothesis) if prior is None else prior.low


def _marginal(study: Study, hypothesis: Hypothesis, name: str) -> Marginal:
    prior = given(study, hypothesis, name)
    assert prior is not None, name  # refused when the study was read
    return prior.marginal()


def allowed(ratio: Ratio, *, positive: bool) -> tuple[float, float]:
    """Interval in which a ratio may lie."""
    return (ratio.low, ratio.high) if positive else (-np.inf, np.inf)
