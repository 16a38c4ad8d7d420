"""The FE model of a study's block: what is fixed about it, for all hypotheses or for one."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.data import thesis_forces
from calib.study.assumptions import assumptions_table
from calib.study.config import Study, StudyError, read_study
from calib.study.context import block_pin_model
from calib.study.unknowns import fixed_values
from fe.specimens.block_pin import BlockPinModel

TEXT = (Path(__file__).parents[1] / "calib/study/embedded/thesis-forces.toml").read_text()
SLIDING = TEXT[TEXT.index("[[hypothesis]]  # without friction") : TEXT.index("[noise]")]
ONLY_STUCK = TEXT.replace(SLIDING, "")
SHIFTED = ONLY_STUCK.replace("pin_width = 4.0", "pin_width = 4.0\npin_shift = -0.4")
UNKNOWN = '\n[prior.pin_shift]\ndistribution = "uniform"\nlow = -0.5\nhigh = 0.5\n'


def read(text: str) -> Study:
    return read_study(text.encode(), file="study.toml", folder=Path())


def model(study: Study, name: str) -> BlockPinModel:
    hypothesis = next(found for found in study.hypotheses if found.name == name)
    found = block_pin_model(study, hypothesis, study.sampling_cells(hypothesis))
    assert isinstance(found, BlockPinModel)
    return found


def test_a_hypothesis_may_have_its_own_bulk_modulus() -> None:
    study = read(TEXT.replace('name = "stuck"\n', 'name = "stuck"\nbulk_ratio = 10\n'))
    assert model(study, "stuck").bulk_ratio == 10.0
    assert model(study, "sliding").bulk_ratio == study.material.bulk_ratio == 200.0
    told = [value for _, value, _ in assumptions_table(study, thesis_forces()).rows]
    assert sum("bulk modulus 10 mu" in value for value in told) == 1


def test_a_pin_that_is_known_to_stand_off_the_centre_is_modelled_there() -> None:
    study = read(SHIFTED)
    found = model(study, "stuck")
    assert found.specimen.pin_shift == (-0.4, 0.0) and found.part == "half"
    assert model(read(ONLY_STUCK), "stuck").part == "quarter"
    rows = {name: value for name, value, _ in assumptions_table(study, thesis_forces()).rows}
    assert rows["pin off the sample's centre"] == "-0.4"
    assert "mesh of the emulator's runs, stuck (half)" in rows


def test_where_the_shift_is_unknown_the_number_is_the_truth_of_a_synthetic_experiment() -> None:
    study = read(SHIFTED + UNKNOWN)
    assert fixed_values(study, study.hypotheses[0]).tolist() == [-0.4]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (SHIFTED.replace("-0.4", "3.5"), "geometry.pin_shift: found 3.5, expected from -3 to 3 mm"),
        (SHIFTED.replace("-0.4", "nan"), "geometry.pin_shift: found NaN, expected a finite"),
        (
            TEXT.replace("pin_width = 4.0", "pin_width = 4.0\npin_shift = 0.1"),
            "geometry.pin_shift: found 0.1, expected 0 where nothing keeps the sample from sliding "
            "away, as under sliding",
        ),
        (
            TEXT.replace('name = "stuck"\n', 'name = "stuck"\nbulk_ratio = 0.5\n'),
            "hypothesis[0].bulk_ratio: found 0.5, expected",
        ),
    ],
)
def test_what_no_block_can_be_is_refused_at_its_line(text: str, said: str) -> None:
    with pytest.raises(StudyError) as refused:
        read(text)
    assert said in str(refused.value)
