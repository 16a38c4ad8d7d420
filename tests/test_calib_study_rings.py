"""A study's meshes about a round pin: read, given to the FE model, refused where none can be."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.study import Study, StudyError
from calib.study.assumptions import assumptions_table
from calib.study.block_cells import RingCells, n_elements
from calib.study.config import read_study
from calib.study.context import block_pin_model
from calib.study.data_stage import measured
from fe import BlockPinModel, Rings
from tests.test_calib_study_config import BASE, FORCES

FINE, COARSE = (
    "{ rings = 12, layers = 8, sectors = 2 }",
    "{ rings = 6, layers = 4, sectors = 2 }",
)
ROUND = BASE.replace("pin_fillet = 0.3", 'pin_fillet = 0.3\npin_shape = "round"')
ROUND = ROUND.replace("[4, 2, 4]", COARSE).replace("[6, 3, 6]", FINE)
SHIFTED = """
[prior.pin_shift]
distribution = "uniform"
low = -0.1
high = 0.1
"""


def read(text: str, folder: Path) -> Study:
    (folder / "forces.csv").write_text(FORCES)
    return read_study(text.encode(), file="own.toml", folder=folder)


def test_rings_are_read_and_become_the_models_mesh(tmp_path):
    study = read(ROUND, tmp_path)
    assert study.mesh.check == RingCells(rings=12, layers=8, sectors=2)
    model = block_pin_model(study, study.hypotheses[0], study.check_cells(study.hypotheses[0]))
    assert isinstance(model, BlockPinModel)
    assert model.specimen.pin == "round"
    assert model.cells == Rings(12, 8, 2)
    assert model.mesh().nelements == n_elements(study.mesh.check) == 416
    assert study.refinement(study.hypotheses[0]) == pytest.approx((416 / 112) ** (1 / 3))


def test_rival_pins_have_shapes_and_meshes_of_their_own(tmp_path):
    own = f'height = 2.7\npin_shape = "round"\nsampling = {COARSE}\ncheck = {FINE}'
    study = read(BASE.replace("height = 2.7", own), tmp_path)
    bar, round_ = study.hypotheses
    models = [block_pin_model(study, h, study.sampling_cells(h)) for h in (bar, round_)]
    assert [m.specimen.pin for m in models] == ["bar", "round"]
    assert [m.cells for m in models] == [(4, 2, 4), Rings(6, 4, 2)]


def test_the_reports_assumptions_name_the_rings(tmp_path):
    study = read(ROUND, tmp_path)
    rows = assumptions_table(study, measured(study).dataset).rows
    assert "12 rings x 8 layers x 2 sectors" in {value for _, value, _ in rows}


@pytest.mark.parametrize(
    ("text", "key", "reason"),
    [
        (ROUND.replace('"round"', '"bar"'), "mesh.sampling", "this one is a bar"),
        (ROUND + SHIFTED, "mesh.sampling", "[prior.pin_shift] takes the pin off the middle"),
        (ROUND.replace("pin_width = 4.0", "pin_width = 8.0"), "mesh.sampling", "7 mm"),
        (ROUND.replace("depth = 10.0", "depth = 16.0"), "mesh.sampling", "here 1.6"),
        (ROUND.replace(FINE, "[6, 3, 6]"), "mesh.check", "of rings too"),
        (ROUND.replace("rings = 12", "rings = 5"), "mesh.check", "finer than the sampling mesh"),
        (ROUND.replace("layers = 8", "layers = 0"), "mesh.check.layers", "equal to 1"),
        (ROUND.replace("layers = 8, ", ""), "mesh.check.layers", "number of layers over"),
        (ROUND.replace("rings = 12", "circles = 12"), "mesh.check.circles", "rings, layers"),
        (ROUND.replace(FINE, "12"), "mesh.check", "three numbers of elements (x, y, z)"),
        (ROUND.replace('"round"', '"oval"'), "geometry.pin_shape", '"oval"'),
    ],
)
def test_what_no_rings_can_be_is_refused_at_its_key(tmp_path, text, key, reason):
    with pytest.raises(StudyError) as caught:
        read(text, tmp_path)
    place, _, sentence = str(caught.value).partition(": found ")
    assert place.startswith("own.toml:")
    assert place.endswith(f": {key}")
    assert reason in sentence
