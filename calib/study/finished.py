"""A finished study as the questions put to it find it: settings, data, posteriors, draws."""

from __future__ import annotations

from pathlib import Path

from calib.inference.coordinates import PARAMETERS
from calib.inference.posterior import Posterior
from calib.study.config import Study, load_study
from calib.study.context import Context, block_pin_model
from calib.study.posterior_setup import emulator_posterior
from calib.study.sections import Hypothesis
from calib.study.unknowns import prior_of
from fe.executors import serial_map


def finished(out: Path) -> Context:
    """The context of a study's folder; nothing is run.

    Raises ValueError where the folder holds no study whose emulators are trained.
    """
    file = out / "study.toml"
    if not file.is_file() or not (out / "data.json").is_file():
        raise ValueError(f"{out}: found no study with data, expected the folder of a finished run")
    study: Study = load_study(file)
    return Context(
        study=study,
        out=out,
        simulate_factory=block_pin_model,
        map_fn=serial_map,
        echo=print,
        show_progress=False,
    )


def posteriors(context: Context) -> dict[str, Posterior]:
    """Posterior of each hypothesis by its emulator.

    Raises ValueError naming what is missing where the study was not finished.
    """
    try:
        return {h.name: emulator_posterior(context, h) for h in context.study.hypotheses}
    except OSError as error:
        raise ValueError(f"{context.out}: not a finished study ({error})") from error


def chosen(study: Study, name: str | None) -> Hypothesis:
    """A hypothesis by name, the first one when none is given.

    Raises ValueError for a name that the study does not have.
    """
    known = {hypothesis.name: hypothesis for hypothesis in study.hypotheses}
    if name is None:
        return study.hypotheses[0]
    if name not in known:
        raise ValueError(f"--hypothesis: found {name}, expected one of {', '.join(known)}")
    return known[name]


def check_three_unknowns(study: Study, hypothesis: Hypothesis, *known: str) -> None:
    """Refuse a hypothesis with other unknowns than kappa, r and s, and those that are `known`.

    Raises ValueError: the question is answered for mooney-rivlin-3 alone.
    """
    found = prior_of(study, hypothesis, with_field=True).space.names
    if found[:3] != PARAMETERS or set(found[3:]) - set(known):
        raise ValueError(
            f"hypothesis {hypothesis.name}: found the unknowns {', '.join(found)}, "
            f"expected {', '.join(PARAMETERS)} (the law mooney-rivlin-3) alone for this question"
        )
