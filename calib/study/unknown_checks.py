"""What is refused of the priors of a study, each in one sentence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from calib.inference.laws import RATIOS
from calib.study.prior_limits import check_errors, check_inputs, check_law, key_of
from calib.study.truth_checks import check_truth
from calib.study.unknowns import (
    CONSTANTS,
    ERRORS,
    FRICTION,
    INPUTS,
    by_constants,
    given,
    law_of,
    off_centre,
    prior_of,
    rubs,
)
from calib.study.used_keys import check_used_keys
from calib.toml_file.refusal import Contradiction

if TYPE_CHECKING:
    from calib.study.config import Study
    from calib.study.sections import Hypothesis


def check_unknowns(study: Study) -> None:
    """Raise Contradiction for priors that are missing, are of nothing, or allow the impossible."""
    for index, hypothesis in enumerate(study.hypotheses):
        if hypothesis.prior is not None and hypothesis.prior.positive is not None:
            key = f"hypothesis.{index}.prior.positive"
            raise Contradiction(key, hypothesis.prior.positive, "it in [prior], for all hypotheses")
        _check_stated(study, index, hypothesis)
        check_law(study, index, hypothesis)
        check_inputs(study, index, hypothesis)
        check_errors(study, index, hypothesis)
        _check_size(study, index, hypothesis)
        if study.design.shape == "prior" and by_constants(study, hypothesis):
            expected = '"uniform": a design is over ratios, and the priors are of the constants'
            raise Contradiction("design.shape", "prior", expected)
    _check_used(study)
    check_used_keys(study)
    check_truth(study)
    _check_field(study)


def section_of(study: Study, index: int, name: str) -> str:
    """Where the prior of this name under a hypothesis stands in the file."""
    return key_of(index, study.hypotheses[index], name)


def _check_stated(study: Study, index: int, hypothesis: Hypothesis) -> None:
    """All that the law needs has a prior: kappa and ratios, or the constants."""
    ratios = [ratio.name for ratio in law_of(study, hypothesis).ratios]
    of = by_constants(study, hypothesis)
    for name in of or ("kappa", *ratios):
        if given(study, hypothesis, name) is None:
            raise Contradiction(f"prior.{name}", None, f"a section [prior.{name}]")
    if of and hypothesis.prior is None and study.prior.kappa is not None:
        expected = "no such section beside [prior.C10]: constants or kappa and ratios have priors"
        raise Contradiction("prior.kappa", {}, expected)
    law = law_of(study, hypothesis).name
    if of and law not in ("mooney-rivlin-2", "mooney-rivlin-3"):
        expected = f"none: under {law} the priors are of kappa and the ratios"
        raise Contradiction(key_of(index, hypothesis, "C10"), {}, expected)


def _check_field(study: Study) -> None:
    """Nuisances of a field are asked for only where the data have one, which all models see."""
    if study.data.has_field:
        if len({off_centre(study, hypothesis) for hypothesis in study.hypotheses}) > 1:
            index = next(i for i, h in enumerate(study.hypotheses) if off_centre(study, h))
            expected = "it in [prior], for all hypotheses: they see one field, of both sides"
            raise Contradiction(section_of(study, index, "pin_shift"), {}, expected)
        return
    noise = study.noise
    of_field = ("face_travel_sd", "field_scale_sd", "translation_sd", "rotation_sd")
    for name in (*of_field, "field_freedom"):
        if getattr(noise, name):
            expected = "no such key: the data of this study have no field"
            raise Contradiction(f"noise.{name}", getattr(noise, name), expected)


def _check_size(study: Study, index: int, hypothesis: Hypothesis) -> None:
    """Enough walkers and runs for the number of unknowns."""
    space = prior_of(study, hypothesis, with_field=True).space
    if study.sampler.n_walkers < 2 * space.size:
        expected = f"at least twice the {space.size} unknowns of {hypothesis.name}"
        raise Contradiction("sampler.n_walkers", study.sampler.n_walkers, expected)
    d = space.n_forward - 1
    if study.design.n_runs < 4 * d:
        expected = f"at least four for each of the {d} inputs of {hypothesis.name}"
        raise Contradiction("design.n_runs", study.design.n_runs, expected)


def _check_used(study: Study) -> None:
    """No prior of [prior] is of something that no hypothesis has."""
    used: set[str] = {"positive", *ERRORS}
    for hypothesis in study.hypotheses:
        used |= set(by_constants(study, hypothesis) or ("kappa",))
        if not by_constants(study, hypothesis):
            used |= {ratio.name for ratio in law_of(study, hypothesis).ratios}
        used |= {name for name in INPUTS if rubs(hypothesis, name)}
    for where, prior in _priors(study):
        own = used if where == "prior" else used | {"kappa"}
        for name in (*_RATIO_NAMES, *CONSTANTS, *FRICTION):
            if getattr(prior, name) is not None and name not in own:
                expected = "none: no hypothesis has such a parameter"
                if name in FRICTION:
                    expected = "a hypothesis with a coefficient of friction as its pin or base"
                raise Contradiction(f"{where}.{name}", {}, expected)


def _priors(study: Study) -> Iterator[tuple[str, object]]:
    yield "prior", study.prior
    for index, hypothesis in enumerate(study.hypotheses):
        if hypothesis.prior is not None:
            yield f"hypothesis.{index}.prior", hypothesis.prior


_RATIO_NAMES = tuple(dict.fromkeys(r.name for ratios in RATIOS.values() for r in ratios))
