"""A finished study as the questions put to it find it: settings, data, posteriors, draws."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calib.inference.inference_data import stated_provenance
from calib.inference.laws import DEFAULT_LAW
from calib.inference.posterior import Posterior
from calib.study.artifacts import CONTENT, hash_of, hash_of_file, plain, read_record
from calib.study.config import Study, StudyError, load_study
from calib.study.context import Context, block_pin_model
from calib.study.local_design import BOXES
from calib.study.posterior_setup import emulator_posterior
from calib.study.sections import Hypothesis
from calib.study.study_file import STUDY_FILE
from calib.study.unknowns import law_of
from fe.executors import serial_map

POSTERIOR = "posterior.nc"
FREE = ("compute", "name")
"""sections and keys that change no result"""


def finished(out: Path) -> Context:
    """The context of a study's folder; nothing is run.

    Raises ValueError where the folder holds no finished study, whose posterior says what it was
    made from: parts of a run that was stopped may be of different inputs. So it does where the
    study file or those parts are others than when the posterior was sampled.
    """
    file = out / STUDY_FILE
    for wanted in (file, out / "data.json", out / POSTERIOR):
        if not wanted.is_file():
            raise ValueError(
                f"{out}: found no {wanted.name}, expected the folder of a finished study"
            )
    study: Study = load_study(file, with_data=False)
    check_unchanged(study, out)
    return Context(
        study=study,
        out=out,
        simulate_factory=block_pin_model,
        map_fn=serial_map,
        echo=print,
        show_progress=False,
    )


def check_unchanged(study: Study, out: Path) -> None:
    """Raise ValueError where the posterior in the folder is of another study file or other files.

    A run writes its file first, so that it may have been stopped, or asked for a part only.
    """
    path = out / POSTERIOR
    if not path.is_file():
        return
    check_same_run(out)
    made = stated_provenance(path).get("study_file")
    if not isinstance(made, dict):
        return
    now, before = _stated(plain(study)), _stated(made)
    changed = [name for name in now if name not in FREE and now[name] != before.get(name)]
    if changed:
        names = ", ".join(changed)
        raise ValueError(
            f"{out / STUDY_FILE}: found {names} changed since {POSTERIOR} was made, expected the "
            f"study of these results; `calib run {out / STUDY_FILE} --out {out}` makes them anew"
        )


def check_same_run(out: Path) -> None:
    """Raise ValueError where data, emulators or chains in the folder are not the posterior's.

    Data may have changed under the name that they had, and the run that took them been stopped.
    Files that are not there say nothing, as who needs them says so, but for that of the boxes,
    without which other emulators would be taken; nor does a posterior of an older version.
    """
    made = stated_provenance(out / POSTERIOR).get("input_hashes")
    known: dict[str, str] = made if isinstance(made, dict) else {}
    others = [
        name
        for name, digest in sorted(known.items())
        if (out / name).is_file() and hash_of_file(out / name) != digest
    ]
    if others or (BOXES in known and not (out / BOXES).is_file()):
        what = f"{', '.join(others)} of another run" if others else f"no {BOXES}"
        raise ValueError(
            f"{out / POSTERIOR}: found {what} beside it, expected what it was made from; "
            f"`calib run {out / STUDY_FILE} --out {out}` makes it anew"
        )


def changed_since(path: Path) -> str:
    """What the study file beside the posterior at `path` says otherwise; empty where nothing."""
    file = path.parent / STUDY_FILE
    if not file.is_file():
        return ""
    try:
        study: Study = load_study(file, with_data=False)
        check_unchanged(study, path.parent)
    except StudyError:  # not a study of today
        return ""
    except ValueError as error:
        return str(error)
    return _other_forces(study, path.parent)


def _other_forces(study: Study, out: Path) -> str:
    """Whether the file of the forces has changed since its data were taken, in words.

    Empty where it has not, or is not there; files of a laboratory are many, and not looked at.
    """
    source, record = Path(study.data.source), read_record(out, "data")
    if not study.data.is_file or record is None or not source.is_file():
        return ""
    now = hash_of(hash_of_file(source))
    if record.inputs.get(CONTENT, now) == now:
        return ""
    return (
        f"{source}: found it changed since {POSTERIOR} was made, expected the forces that it is "
        f"of; `calib run {out / STUDY_FILE} --out {out}` makes the posterior anew"
    )


def _stated(section: Any) -> Any:
    """A section without what is not set, which files of before may not have known."""
    if isinstance(section, list):
        return [_stated(item) for item in section]
    if not isinstance(section, dict):
        return section
    return {key: _stated(value) for key, value in section.items() if value is not None}


def posteriors(context: Context) -> dict[str, Posterior]:
    """Posterior of each hypothesis by its emulator of the prior's whole box.

    Raises ValueError naming the file that is missing where the study was not finished.
    """
    return {h.name: emulator_posterior(context, h, whole=True) for h in context.study.hypotheses}


def chosen(study: Study, name: str | None) -> Hypothesis:
    """A hypothesis by name, which may be left out where the study has one only.

    Raises ValueError for a name that the study does not have, and for none where it has several.
    """
    known = {hypothesis.name: hypothesis for hypothesis in study.hypotheses}
    if name is None and len(known) == 1:
        return study.hypotheses[0]
    if name is None or name not in known:
        expected = ", ".join(known)
        raise ValueError(f"--hypothesis: found {name or 'none'}, expected one of {expected}")
    return known[name]


def check_constants(study: Study, hypothesis: Hypothesis) -> None:
    """Refuse a hypothesis of another law than mooney-rivlin-3 with ValueError."""
    law = law_of(study, hypothesis).name
    if law != DEFAULT_LAW:
        raise ValueError(
            f"hypothesis {hypothesis.name}: found the law {law}, expected {DEFAULT_LAW}: "
            "the question is of its constants C10, C01 and C11"
        )
