"""The FE model of a study's block: what is fixed about it, for all hypotheses or for one."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.data import FieldData, thesis_forces
from calib.study import data_checks
from calib.study.assumptions import assumptions_table
from calib.study.config import Study, StudyError, load_study, read_study
from calib.study.context import Context, block_pin_model, stiffened
from calib.study.refine_outlook import pin_plan
from calib.study.unknowns import fixed_values
from calib.study.varied_block import VariedBlock
from calib.study.virtual_stage import truth_model
from fe import NotchedPlate, TensileModel
from fe.contact import PenaltyLaw
from fe.executors import serial_map
from fe.specimens.block_pin import BlockPinModel

TEXT = (Path(__file__).parents[1] / "calib/study/embedded/thesis-forces.toml").read_text()
SLIDING = TEXT[TEXT.index("[[hypothesis]]  # without friction") : TEXT.index("[noise]")]
ONLY_STUCK = TEXT.replace(SLIDING, "")
SHIFTED = ONLY_STUCK.replace("pin_width = 4.0", "pin_width = 4.0\npin_shift = -0.4")
RUBS = SHIFTED.replace('pin = "stick"\nbase = "stick"', "pin = 0.2\nbase = 0.2")


def uniform(name: str, low: float, high: float) -> str:
    return f'\n[prior.{name}]\ndistribution = "uniform"\nlow = {low}\nhigh = {high}\n'


UNKNOWN = uniform("pin_shift", -0.5, 0.5)
FRICTION = uniform("friction", 0.0, 0.5)


def read(text: str) -> Study:
    return read_study(text.encode(), file="study.toml", folder=Path())


def model(study: Study, name: str) -> BlockPinModel:
    hypothesis = next(found for found in study.hypotheses if found.name == name)
    found = block_pin_model(study, hypothesis, study.sampling_cells(hypothesis))
    assert isinstance(found, BlockPinModel)
    return found


def penalty(found: object) -> PenaltyLaw:
    block = found.template if isinstance(found, VariedBlock) else found
    assert isinstance(block, BlockPinModel)
    return block.penalty


@pytest.mark.parametrize("more", ["", uniform("height", 2.4, 2.6)])
def test_the_pin_of_the_check_gives_way_less_than_that_of_the_emulators_runs(more: str) -> None:
    study = read(TEXT + more)
    context = Context(study, Path(), block_pin_model, serial_map, lambda _: None, False)
    n_ratios = 3 if more else 2
    for hypothesis in study.hypotheses:
        assert penalty(context.sampling_model(hypothesis)) == PenaltyLaw()
        assert penalty(context.check_model(hypothesis)) == PenaltyLaw().stiffened(4.0)
        of_pin = pin_plan(context, hypothesis, np.array([[0.5] * n_ratios]))
        assert of_pin is not None
        assert of_pin.simulate == stiffened(context.sampling_model(hypothesis), 4.0)
    rows = [
        name for name, value, _ in assumptions_table(study, thesis_forces()).rows if value == "4"
    ]
    assert rows == ["how many times less the pin of the check gives way"]
    same = replace(context, study=replace(study, mesh=replace(study.mesh, check_stiffening=1.0)))
    assert penalty(same.check_model(study.hypotheses[0])) == PenaltyLaw()
    assert pin_plan(same, study.hypotheses[0], np.array([[0.5] * n_ratios])) is None


def test_fields_of_hypotheses_of_other_heights_are_seen_at_the_same_places() -> None:
    text = (Path(__file__).parents[1] / "calib/study/embedded/virtual.toml").read_text()
    apart = text.replace('name = "stuck"', 'name = "stuck"\nheight = 2.7')
    plain, study = read(text), read(apart)
    stuck, sliding = (model(study, name).points() for name in ("stuck", "sliding"))
    np.testing.assert_allclose(stuck, sliding, atol=1e-12)
    np.testing.assert_allclose(stuck, model(plain, "sliding").points(), atol=1e-12)
    forces = TEXT.replace('name = "stuck"', 'name = "stuck"\nheight = 2.7')
    assert model(read(forces), "stuck").field_grid == (35, 24)


def test_the_pin_of_a_synthetic_truth_gives_way_less_still() -> None:
    context = Context(load_study("virtual"), Path(), block_pin_model, serial_map, print, False)
    assert penalty(truth_model(context)) == PenaltyLaw().stiffened(8.0)


def test_a_model_without_a_pin_is_not_stiffened() -> None:
    plate = TensileModel(NotchedPlate(), (2, 3, 1), (1.0,))
    assert stiffened(plate, 4.0) is plate


@pytest.mark.parametrize("value", ["0.5", "0", "1.5", "100", "true"])
def test_a_stiffening_that_is_none_is_refused_by_its_line(value: str) -> None:
    text = TEXT.replace("check = [18, 6, 4]", f"check = [18, 6, 4]\ncheck_stiffening = {value}")
    with pytest.raises(StudyError, match=r"mesh\.check_stiffening: found"):
        read(text)


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


def test_both_sides_of_the_pin_are_seen_where_the_height_is_unknown_too() -> None:
    study = read(SHIFTED + uniform("height", 2.4, 2.6))
    hypothesis = study.hypotheses[0]
    varied = block_pin_model(study, hypothesis, study.sampling_cells(hypothesis))
    assert isinstance(varied, VariedBlock)
    x, y = varied.template.points().T
    assert len(x) == 2 * 840 and x.min() == -x.max() and y.max() < 2.4


def test_a_bulk_modulus_that_is_unknown_is_not_told_as_that_of_the_hypothesis() -> None:
    text = TEXT.replace('name = "stuck"\n', 'name = "stuck"\nbulk_ratio = 10\n')
    rows = assumptions_table(read(text + uniform("bulk_ratio", 100.0, 400.0)), thesis_forces()).rows
    assert not any("bulk modulus 10 mu" in value for _, value, _ in rows)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            RUBS + FRICTION,
            "geometry.pin_shift: found -0.4, expected 0 where nothing need keep the sample",
        ),
        (RUBS.replace("pin_shift = -0.4\n", "") + FRICTION + UNKNOWN, "prior.pin_shift: found"),
        (
            SHIFTED + uniform("pin_width", 3.5, 9.5),
            "prior.pin_width.high: found 9.5, expected 9.2 or less: the pin stands on the sample",
        ),
        (SHIFTED.replace("-0.4", "3.5"), "geometry.pin_shift: found 3.5, expected from -3 to 3 mm"),
        (SHIFTED.replace("-0.4", "nan"), "geometry.pin_shift: found NaN, expected a finite"),
        (
            TEXT.replace("pin_width = 4.0", "pin_width = 4.0\npin_shift = 0.1"),
            "geometry.pin_shift: found 0.1, expected 0 where nothing need keep the sample from "
            "sliding away, as under sliding",
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


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (SHIFTED, "study.toml:14: geometry.pin_shift: found -0.4, expected 0 beside a measured"),
        (ONLY_STUCK + UNKNOWN, "prior.pin_shift: found a table, expected none beside a measured"),
    ],
)
def test_a_measured_field_is_about_the_pin_and_leaves_no_shift(
    monkeypatch: pytest.MonkeyPatch, text: str, said: str
) -> None:
    points = np.array([[0.5, 0.5], [4.5, 2.0]])
    field = FieldData(points, np.zeros((5, 2, 3)), np.full(3, 0.01), 0.5, 0.5)
    monkeypatch.setattr(
        data_checks, "measured_dataset", lambda _: replace(thesis_forces(), field=field)
    )
    assert read(ONLY_STUCK)
    with pytest.raises(StudyError, match=re.escape(said)):
        read(text)
