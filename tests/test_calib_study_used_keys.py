"""A key of [design] or [noise] that changes nothing is refused, one that is used is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.study.config import Study, StudyError, read_study
from calib.study.study_file import study_text

EMBEDDED = Path(__file__).parents[1] / "calib/study/embedded"
TEXT = (EMBEDDED / "virtual.toml").read_text()
FORCES = (EMBEDDED / "thesis-forces.toml").read_text()
SHARE = '\n[{}.discrepancy]\ndistribution = "half_cauchy"\nmedian = 0.1\nlow = 0.001\nhigh = 2.0\n'
RATIO = '\n[prior.discrepancy_of_force]\ndistribution = "uniform"\nlow = 0.5\nhigh = 4.0\n'


def study_of(text: str) -> Study:
    return read_study(text.encode(), file="study.toml", folder=Path())


def refusal(text: str) -> str:
    with pytest.raises(StudyError) as caught:
        study_of(text)
    return str(caught.value)


def noise(lines: str, text: str = TEXT) -> str:
    return text.replace("[noise]\n", f"[noise]\n{lines}\n")


def design(lines: str, text: str = TEXT) -> str:
    return text.replace("[design]\n", f"[design]\n{lines}\n")


def of_constants(*names: str) -> str:
    start, end = TEXT.index("[prior.kappa]"), TEXT.index("[design]")
    bounds = {"C10": (0.005, 0.012), "C01": (0.0, 0.01), "C11": (0.0, 0.004)}
    priors = [
        f'[prior.{name}]\ndistribution = "uniform"\nlow = {low}\nhigh = {high}\n\n'
        for name, (low, high) in bounds.items()
        if name in names
    ]
    return TEXT[:start] + "".join(priors) + TEXT[end:]


def under_stuck(section: str) -> str:
    return TEXT.replace('base = "stick"\n', 'base = "stick"\n' + section)


TWO = (
    of_constants("C10", "C01")
    .replace("[material]\n", '[material]\nlaw = "mooney-rivlin-2"\n')
    .replace("C11 = 0.0024", "C11 = 0.0")
)

UNUSED = {
    "r, with priors of the ratios": (design("r = [0.0, 0.4]"), "design.r", "[prior.C01]"),
    "s, with priors of the ratios": (design("s = [0.0, 0.4]"), "design.s", "[prior.C11]"),
    "s, of a law without it": (design("s = [0.0, 0.4]", TWO), "design.s", "[prior.C11]"),
    "a ratio of the forces without a share": (
        noise("discrepancy_of_force = 1.5"),
        "noise.discrepancy_of_force",
        "without [prior.discrepancy]",
    ),
    "a ratio of the forces that has a prior": (
        noise("discrepancy_of_force = 1.5") + SHARE.format("prior") + RATIO,
        "noise.discrepancy_of_force",
        "beside [prior.discrepancy_of_force]",
    ),
    "a length without a share": (
        noise("discrepancy_length = 1.0"),
        "noise.discrepancy_length",
        "without [prior.discrepancy]",
    ),
    "a length of travel without a share": (
        noise("discrepancy_travel_length = 1.0"),
        "noise.discrepancy_travel_length",
        "without [prior.discrepancy]",
    ),
    "a length over a face that was not seen": (
        noise("discrepancy_length = 1.0", FORCES) + SHARE.format("prior"),
        "noise.discrepancy_length",
        "have no field",
    ),
    "a known share that has a prior": (
        noise("discrepancy = 0.1") + SHARE.format("prior"),
        "noise.discrepancy",
        "0 beside [prior.discrepancy]",
    ),
}


@pytest.mark.parametrize("case", UNUSED)
def test_a_key_that_changes_nothing_is_refused_by_its_line(case: str) -> None:
    text, key, expected = UNUSED[case]
    section, _, name = key.partition(".")
    start = text.index(f"[{section}]\n")
    line = text[: text.index(f"\n{name} = ", start) + 1].count("\n") + 1
    message = refusal(text)
    assert message.startswith(f"study.toml:{line}: {key}: found ")
    assert expected in message.partition(", expected ")[2]


USED = {
    "a known share with its ratio and lengths": noise(
        "discrepancy = 0.1\ndiscrepancy_of_force = 1.5\n"
        "discrepancy_length = 1.0\ndiscrepancy_travel_length = 1.0"
    ),
    "an unknown share with a known ratio": noise("discrepancy_of_force = 1.5\n")
    + SHARE.format("prior"),
    "a known share where one hypothesis has an unknown one": under_stuck(
        SHARE.format("hypothesis.prior")
    ).replace("[noise]\n", "[noise]\ndiscrepancy = 0.1\ndiscrepancy_length = 1.0\n"),
    "a known share with an unknown ratio": noise("discrepancy = 0.1") + RATIO,
    "a length of travel without a field": noise("discrepancy_travel_length = 1.0", FORCES)
    + SHARE.format("prior"),
    "a range of r of a law of two constants": design("r = [0.0, 0.4]", TWO),
    "ranges with priors of three": design(
        "r = [0.0, 0.4]\ns = [0.0, 0.3]", of_constants("C10", "C01", "C11")
    ),
}


@pytest.mark.parametrize("case", USED)
def test_a_key_that_is_used_under_one_hypothesis_is_read_and_written(case: str) -> None:
    study = study_of(USED[case])
    assert study_of(study_text(study)) == study


def test_lengths_as_by_default_are_taken_for_not_given() -> None:
    plain = study_of(TEXT)
    assert "discrepancy_length = 1.5" in study_text(plain)
    assert study_of(noise("discrepancy_length = 1.5\ndiscrepancy_travel_length = 0.8")) == plain
