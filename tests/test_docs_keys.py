"""What the documents say of keys, defaults, commands and links is what the code has."""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import pytest

from calib.cli import _parser
from calib.data.qc.experiment_file import Experiment
from calib.data.readers import read_dic, read_machine
from calib.dic_study.config import DicStudy, Images, Options, Region, Scale, Strains
from calib.dic_study.stereo_config import Plates, Stereo, StereoStudy
from calib.study.second_test import (
    FIELD_GRID,
    PlateSection,
    SecondMesh,
    SecondTest,
    load_second_test,
)
from calib.study.sections import Noise
from calib.toml_file import read_document

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *DOCS.glob("*.md")])
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
WORDS: dict[str, object] = {
    "none": None,
    "off": None,
    "by the force": None,
    "false": False,
    "folder's name": "",
    "all folders with a machine.csv": None,
}
"""what the table of experiment.toml says in place of a value"""
KEY = re.compile(r"\b(\w+) = ")


def blocks(page: str, language: str = "toml") -> list[str]:
    """Fenced blocks of one language."""
    fenced = re.findall(
        r"^```(\w*)\n(.*?)^```$", (DOCS / page).read_text(), re.DOTALL | re.MULTILINE
    )
    return [block for name, block in fenced if name == language]


def rows(text: str) -> list[list[str]]:
    """Cells of all lines of tables whose first cell begins with a name in backticks."""
    lines = re.findall(r"^\| (`.*) \|$", text, re.MULTILINE)
    return [re.split(r"(?<!\\) \| ", line) for line in lines]


def values(settings: Any) -> dict[str, object]:
    """Value of every key, sections first."""
    found: dict[str, object] = {}
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        own = values(value) if dataclasses.is_dataclass(value) else {"": value}
        found |= {".".join(filter(None, (field.name, key))): each for key, each in own.items()}
    return found


def said(cell: str) -> list[object]:
    """The defaults in one cell: JSON, or one of `WORDS`."""
    parts = re.findall(r"\[[^]]*\]|[^,]+", cell.partition(" (")[0])
    each = [part.strip() for part in parts]
    plain = [one for one in each if one not in WORDS]
    assert all(re.fullmatch(r"-?[\d.e-]+|\[.*\]|\".*\"|true", one) for one in plain), cell
    return [WORDS[one] if one in WORDS else json.loads(one) for one in each]


def named(*sections: type) -> set[str]:
    """Keys of sections of a file."""
    return {field.name for section in sections for field in dataclasses.fields(section)}


def test_the_table_of_the_experiment_file_has_every_key_with_its_default() -> None:
    section = (DOCS / "experiment.md").read_text().partition("## experiment.toml")[2]
    stated: dict[str, object] = {}
    for cells in rows(section.partition("## What is done")[0]):
        names = re.findall(r"`([^`]+)`", cells[0])
        before = names[0].rpartition(".")[0]
        keys = [name if "." in name or not before else f"{before}.{name}" for name in names]
        defaults = said(cells[1])
        if len(defaults) == 1:  # of all keys of the line
            defaults *= len(keys)
        stated |= dict(zip(keys, defaults, strict=True))
    expected = {k: list(v) if isinstance(v, tuple) else v for k, v in values(Experiment()).items()}
    assert stated == expected


def test_the_study_of_one_camera_is_read_and_its_defaults_are_those() -> None:
    (written,) = blocks("dic.md")
    assert set(KEY.findall(written)) == named(Images, Region, Options, Scale, Strains)
    study = read_document(written.encode(), "dic.md", "study").checked(DicStudy)
    assert study.correlation == Options()
    assert study.strain == Strains(radius_px=30.0)
    assert "the default is [0, 0]" in written and Scale(mm_per_px=1.0).origin_px == (0.0, 0.0)


def test_the_study_of_two_cameras_is_read() -> None:
    (written,) = blocks("stereo.md")
    study = read_document(written.encode(), "stereo.md", "study").checked(StereoStudy)
    plates = study.calibration
    assert plates is not None and f"columns = {plates.columns} and rows = {plates.rows}" in written
    assert set(KEY.findall(written)) >= named(Stereo, Plates)
    told = dict(re.findall(r"^#? ?(\w+) = (\S+) +# (?:the default|steps)", written, re.MULTILINE))
    assert set(told) == {"axes", "max_epipolar_px", "to_x_marker", "least_poses", "radial"}
    for key, value in told.items():
        owner = study.stereo if key in named(Stereo) else plates
        assert getattr(owner, key) == json.loads(value)
    assert not study.stereo.refine_pose and not plates.tangential and plates.to_y_marker == 3


def test_the_second_test_is_read_and_its_defaults_are_those(tmp_path: Path) -> None:
    text = (DOCS / "validation.md").read_text()
    (written,) = re.findall(r'^    name = "plate"\n(?:    .*\n)+', text, re.MULTILINE)
    path = tmp_path / "second.toml"
    path.write_text(re.sub("^    ", "", written, flags=re.MULTILINE))
    test, _ = load_second_test(path)
    assert (test.plate, test.mesh) == (PlateSection(), SecondMesh())
    plain = {field.name: field.default for field in dataclasses.fields(SecondTest)}
    assert all(getattr(test, key) == plain[key] for key in ("control", "draws", "judged"))
    plain["field_grid"] = FIELD_GRID
    for key in ("max_error", "min_r2", "field_grid"):
        (value,) = re.findall(rf"`{key} = ([^`]+)`", text)
        assert json.loads(value) == (list(plain[key]) if key == "field_grid" else plain[key])


def test_nuisances_are_keys_of_the_noise_and_are_left_out_by_default() -> None:
    section = (DOCS / "inference.md").read_text().partition("| key | nuisance |")[2]
    names = [cells[0].split("`")[1] for cells in rows(section.partition("\n\n")[0])]
    noise = {field.name: field.default for field in dataclasses.fields(Noise)}
    assert names[0] == "travel_zero_sd" and noise[names[0]] is dataclasses.MISSING
    assert [noise[name] for name in names[1:]] == [0.0] * 6


def test_the_examples_of_our_own_csv_are_read(tmp_path: Path) -> None:
    points, machine = (block for block in blocks("file-formats.md", "") if block.startswith("# so"))
    (tmp_path / "points.csv").write_text(points)
    (tmp_path / "machine.csv").write_text(machine)
    (frame,) = read_dic(tmp_path / "points.csv").frames
    assert frame.valid.tolist() == [True, False] and frame.grid_shape == (1, 2)
    assert read_machine(tmp_path / "machine.csv").positive == "compression"


def test_the_commands_of_the_readme_are_those_that_there_are() -> None:
    verbs = next(a for a in _parser()._actions if isinstance(a, argparse._SubParsersAction)).choices
    text = (ROOT / "README.md").read_text().partition("| command | does |")[2].partition("\n\n")[0]
    commands = re.findall(r"^\| `(calib .*)` \|", text, re.MULTILINE)
    stated = {command.split()[1]: command for command in commands}
    assert set(stated) == set(verbs)
    for verb, command in stated.items():
        options = set(re.findall(r"--[a-z-]+", command))
        assert options <= set(verbs[verb]._option_string_actions), command


def anchors(page: Path) -> set[str]:
    """Those that a reader's program makes of the headings."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    heads = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", [*PAGES, *NOTEBOOKS], ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text()
    if page.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        text = "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if target.startswith("http"):
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), target
        assert not anchor or anchor in anchors(there), target
