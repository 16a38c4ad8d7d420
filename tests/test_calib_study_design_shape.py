"""A study's design: Sobol or Latin hypercube, even or as dense as the priors, all nested."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.study.config import Study, StudyError, load_study, read_study
from calib.study.unknowns import design_box, design_points, prior_of

TEXT = (Path(__file__).parents[1] / "calib/study/embedded/virtual.toml").read_text()
LOGNORMAL = (
    '\n[prior.fillet]\ndistribution = "lognormal"\nmean = 0.3\nsd = 0.02\nlow = 0.2\nhigh = 0.4\n'
)
OF_CONSTANTS = """
[prior.C10]
distribution = "uniform"
low = 0.001
high = 0.02
[prior.C01]
distribution = "uniform"
low = 0.001
high = 0.02
[prior.C11]
distribution = "uniform"
low = 0.0001
high = 0.002
"""


def study_of(**design: object) -> Study:
    study = read_study((TEXT + LOGNORMAL).encode(), file="study.toml", folder=Path())
    return replace(study, design=replace(study.design, n_runs=60, **design))  # type: ignore[arg-type]


def unit(study: Study) -> np.ndarray:
    """(n, d) design in its box."""
    hypothesis = study.hypotheses[0]
    low, high = design_box(study, hypothesis).T
    found: np.ndarray = (design_points(study, hypothesis) - low) / (high - low)
    return found


@pytest.mark.parametrize("sequence", ["sobol", "latin"])
@pytest.mark.parametrize("shape", ["uniform", "prior"])
def test_a_larger_design_holds_the_smaller_and_the_corners_of_its_box(
    sequence: str, shape: str
) -> None:
    small, large = (
        study_of(sequence=sequence, shape=shape),
        study_of(sequence=sequence, shape=shape),
    )
    large = replace(large, design=replace(large.design, n_runs=90))
    found, more = unit(small), unit(large)
    np.testing.assert_array_equal(more[: len(found)], found)
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    np.testing.assert_allclose(found[:8], corners, atol=1e-12)
    assert found.min() >= 0.0 and found.max() <= 1.0


def test_a_latin_hypercube_has_one_point_in_each_slice() -> None:
    study = study_of(sequence="latin", shape="prior", n_held_out=4)
    low, high = design_box(study, study.hypotheses[0])[0]
    r = design_points(study, study.hypotheses[0])[8 : 8 + 32, 0]  # r: uniform prior
    assert len(set(np.floor((r - low) / (high - low) * 32).astype(int))) == 32


def test_a_design_of_the_priors_shape_has_its_quantiles() -> None:
    study = study_of(shape="prior")
    prior = prior_of(study, study.hypotheses[0], with_field=False)
    fillet = np.sort(design_points(study, study.hypotheses[0])[8:, 2])
    probability = np.tile((np.arange(len(fillet)) + 0.5)[:, None] / len(fillet), prior.space.size)
    expected = prior.quantile(probability)[:, 3]
    assert np.abs(fillet - expected).max() < 0.2 * np.ptp(expected)
    even = np.sort(design_points(study_of(), study.hypotheses[0])[8:, 2])
    assert np.std(fillet) < 0.5 * np.std(even)  # sd 0.02 in a box of some eight


def test_a_prior_wider_than_its_box_is_cut_off_there_and_not_heaped_up() -> None:
    text = TEXT + LOGNORMAL.replace("sd = 0.02", "sd = 0.2")
    wide = read_study(text.encode(), file="study.toml", folder=Path())
    found = unit(replace(wide, design=replace(wide.design, n_runs=60, shape="prior")))[8:]
    assert ((found > 0.0) & (found < 1.0)).all()


def test_sequences_differ_and_the_default_is_sobol() -> None:
    sobol, latin = unit(study_of(sequence="sobol")), unit(study_of(sequence="latin"))
    np.testing.assert_array_equal(unit(study_of()), sobol)
    assert not np.array_equal(sobol[8:], latin[8:])


def test_priors_of_the_constants_have_no_design_of_their_shape(tmp_path: Path) -> None:
    text = TEXT[: TEXT.index("[prior.kappa]")] + OF_CONSTANTS
    rest = TEXT[TEXT.index("[prior.kappa]") :]
    text += rest[rest.index("[design]") :].replace("[design]", '[design]\nshape = "prior"')
    path = tmp_path / "study.toml"
    path.write_text(text)
    line = 1 + text.splitlines().index('shape = "prior"')
    with pytest.raises(StudyError) as caught:
        load_study(str(path))
    assert f'study.toml:{line}: design.shape: found "prior", expected' in str(caught.value)


def test_an_unknown_sequence_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(TEXT.replace("[design]", '[design]\nsequence = "halton"'))
    with pytest.raises(StudyError, match=r"design\.sequence: .*sobol"):
        load_study(str(path))
