"""A truth that no posterior can find is refused when the study is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.study.config import Study, StudyError, read_study

TEXT = (Path(__file__).parents[1] / "calib/study/embedded/virtual.toml").read_text()
CONSTANTS = {"C10": "0.008", "C01": "0.004", "C11": "0.0024"}
"""the truth of the embedded study, MPa: kappa 0.012, r 1/3, s 0.2"""


def study_of(text: str) -> Study:
    return read_study(text.encode(), file="study.toml", folder=Path())


def refusal(text: str) -> str:
    with pytest.raises(StudyError) as caught:
        study_of(text)
    return str(caught.value)


def with_truth(text: str = TEXT, **constants: str) -> str:
    for name, value in constants.items():
        text = text.replace(f"{name} = {CONSTANTS[name]}", f"{name} = {value}")
    return text


def line_of(text: str, name: str) -> int:
    return text[: text.index(f"\n{name} = ") + 1].count("\n") + 1


def uniform(section: str, low: float, high: float) -> str:
    return f'\n[{section}]\ndistribution = "uniform"\nlow = {low}\nhigh = {high}\n'


def of_constants(design: str = "") -> str:
    start, end = TEXT.index("[prior.kappa]"), TEXT.index("[design]")
    priors = uniform("prior.C10", 0.005, 0.012) + uniform("prior.C01", 0.0, 0.01)
    text = TEXT[:start] + priors + uniform("prior.C11", 0.0, 0.004) + "\n" + TEXT[end:]
    return text.replace("[design]\n", f"[design]\n{design}")


def with_prior(base: str, prior: str) -> str:
    return TEXT.replace(f'base = "{base}"\n', f'base = "{base}"\n{prior}')


BEYOND = {
    "kappa": (
        with_truth(C10="0.8"),
        "C10: found 0.8, expected kappa = C10 + C01 (MPa) within its prior under sliding, "
        "0.001 to 0.1 (it is 0.804): no posterior finds a truth beyond",
    ),
    "r": (
        TEXT.replace("high = 1.0", "high = 0.3"),
        "C01: found 0.004, expected r = C01 / kappa within its prior under sliding, 0 to 0.3",
    ),
    "s": (
        with_truth(C11="0.02"),
        "C11: found 0.02, expected s = C11 / kappa within its prior under sliding, 0 to 0.5 (it is "
        "1.66667)",
    ),
    "the true hypothesis' own s": (
        with_prior("slide", uniform("hypothesis.prior.s", 0.0, 0.1)),
        "C11: found 0.0024, expected s = C11 / kappa within its prior under sliding, 0 to 0.1",
    ),
    "a constant with a prior": (
        with_truth(of_constants(), C01="0.011"),
        "C01: found 0.011, expected C01 (MPa) within its prior under sliding, 0 to 0.01",
    ),
    "r cut off by the design": (
        of_constants("r = [0.0, 0.3]\n"),
        "C01: found 0.004, expected r = C01 / kappa within design.r, 0 to 0.3",
    ),
    "no stiffness": (
        with_truth(C10="0.0", C01="0.0"),
        "C10: found 0.0, expected more than 0 where C01 is 0",
    ),
}


@pytest.mark.parametrize("case", BEYOND)
def test_a_truth_beyond_the_priors_is_refused_by_its_line(case: str) -> None:
    text, expected = BEYOND[case]
    line = line_of(text, expected[:3])
    assert refusal(text).startswith(f"study.toml:{line}: virtual.{expected}")


@pytest.mark.parametrize(
    ("key", "low", "high", "truth"),
    [("height", 2.6, 2.9, "2.5"), ("bulk_ratio", 5.0, 50.0, "200")],
)
def test_a_truth_of_the_block_beyond_its_prior_is_refused(
    key: str, low: float, high: float, truth: str
) -> None:
    text = TEXT + uniform(f"prior.{key}", low, high)
    expected = f"found [{low}, {high}], expected a range around {truth}, which the truth of sliding"
    assert expected in refusal(text) and f"prior.{key}" in refusal(text)
    assert (
        study_of(TEXT + uniform(f"prior.{key}", float(truth), 1.5 * float(truth))).virtual
        is not None
    )


@pytest.mark.parametrize(
    "constants",
    [
        {"C10": "0.0", "C11": "0.001"},  # r is 1
        {"C01": "0.0", "C11": "0.004"},  # r is 0, s 0.5
        {"C10": "0.1", "C01": "0.0"},  # kappa 0.1
        {"C10": "0.07", "C01": "0.03"},  # 0.1 but for rounding
    ],
)
def test_a_truth_at_the_end_of_a_prior_is_read(constants: dict[str, str]) -> None:
    assert study_of(with_truth(**constants)).virtual is not None


def test_a_rival_hypothesis_may_exclude_the_truth() -> None:
    own = uniform("hypothesis.prior.s", 0.0, 0.1)
    assert study_of(with_prior("stick", own)).virtual is not None
