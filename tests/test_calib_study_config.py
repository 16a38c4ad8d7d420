"""A wrong study is refused by file, line and key; a right one is read as it is written."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import calib
from calib.study import Study, StudyError, embedded_studies, load_study
from calib.study.config import read_study
from calib.study.usual_meshes import RUBBING, SLIDING, STUCK, field_order

BASE = """\
name = "own"
seed = 7
increments = [0.5, 1.0]

[data]
source = "forces.csv"

[geometry]
width = 10.0
depth = 10.0
height = 2.5
pin_width = 4.0
pin_fillet = 0.3

[mesh]
sampling = [4, 2, 4]
check = [6, 3, 6]

[[hypothesis]]
name = "stuck"
pin = "stick"
base = "stick"

[[hypothesis]]
name = "mixed"
pin = "slide"
base = "stick"
height = 2.7

[noise]
load_cell_sd = 0.05
sample_correlation = 0.9
travel_zero_sd = 0.02

[prior.kappa]
distribution = "log_uniform"
low = 0.001
high = 0.1

[prior.r]
distribution = "uniform"
low = 0
high = 1

[prior.s]
distribution = "normal"
low = 0.0
high = 0.5
mean = 0.1
sd = 0.1
"""
FORCES = """\
travel_mm,force_mean_N,force_sd_N,n_samples
0.5,1.0,0.1,8
1.0,3.0,0.2,8
"""
VIRTUAL = """
[virtual]
hypothesis = "stuck"
C10 = 0.01
C01 = 0.01
C11 = 0.001
cells = [5, 3, 5]
n_samples = 10
force_sd_share = 0.08
field_noise_std = [0.01, 0.01, 0.02]
field_correlation_length = 0.5
field_reference_share = 0.5
"""
AS_VIRTUAL = BASE.replace("forces.csv", "virtual") + VIRTUAL


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "forces.csv").write_text(FORCES)
    return tmp_path


def refusal(folder: Path, text: str | bytes) -> str:
    """The message with which a study file of this content is refused, without its folder."""
    path = folder / "own.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(StudyError) as caught:
        load_study(path)
    message = str(caught.value)
    assert "\n" not in message
    return message.replace(f"{folder}/", "")


def line_of(text: str, part: str) -> int:
    assert text.count(part) == 1, part
    return text[: text.index(part)].count("\n") + 1


def test_a_study_is_read_as_written(folder):
    (folder / "own.toml").write_text(BASE)
    study = load_study(folder / "own.toml")
    assert (study.name, study.seed, study.increments) == ("own", 7, (0.5, 1.0))
    assert [h.name for h in study.hypotheses] == ["stuck", "mixed"]
    assert [study.height(h) for h in study.hypotheses] == [2.5, 2.7]
    assert study.prior.r.high == 1.0
    assert study.prior.s.sd == 0.1
    assert study.data.source == str(folder / "forces.csv")


@pytest.mark.parametrize("name", embedded_studies())
def test_embedded_studies_are_valid_and_bear_their_name(name):
    assert load_study(name).name == name


def test_the_data_file_is_looked_for_beside_the_study(folder, monkeypatch):
    (folder / "own.toml").write_text(BASE)
    monkeypatch.chdir(folder.parent)
    study = load_study(Path(folder.name) / "own.toml")
    assert Path(study.data.source) == folder / "forces.csv"


def test_a_study_is_changed_by_copy_and_checked_again(folder):
    (folder / "own.toml").write_text(BASE)
    study = load_study(folder / "own.toml")
    assert dataclasses.replace(study, hypotheses=study.hypotheses[:1]).hypotheses[0].pin == "stick"
    with pytest.raises(ValueError, match="greater than low"):
        dataclasses.replace(study.prior.r, high=-1.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        study.seed = 8


WRONG = {
    # what is wrong: (text replaced, by, key, found, expected)
    "unknown key": ("depth = 10.0", "deep = 10.0", "geometry.deep", "unknown", "width, depth"),
    "unknown section": ("[mesh]", "[grid]", "grid", "an unknown key", "geometry, material, mesh"),
    "text for a whole number": ("seed = 7", 'seed = "7"', "seed", '"7"', "a whole number"),
    "fraction for a whole number": ("seed = 7", "seed = 7.5", "seed", "7.5", "a whole number"),
    "true for a number": ("width = 10.0", "width = true", "geometry.width", "true", "a number"),
    "date for a number": ("sd = 0.1", "sd = 1979-05-27", "prior.s.sd", "1979-05-27", "a number"),
    "date for a text": ('"own"', "1979-05-27", "name", "the date or time 1979-05-27", "in quotes"),
    "time in an array": ("[0.5, 1.0]", "[0.5, 07:32:00]", "increments[1]", "07:32:00", "a number"),
    "number for a text": ('"own"', "3", "name", "3", "a text"),
    "number for a table": ("[mesh]\nsampling = [4, 2, 4]\ncheck =", "mesh =", "geometry.mesh",
                           "unknown key", "pin_fillet"),
    "number for an array": ("[0.5, 1.0]", "1.0", "increments", "1.0", "an array"),
    "too few cells": ("[6, 3, 6]", "[6, 3]", "mesh.check", "[6, 3]", "three numbers"),
    "too many cells": ("[6, 3, 6]", "[6, 3, 6, 1]", "mesh.check", "[6, 3, 6, 1]", "three numbers"),
    "no cells": ("[4, 2, 4]", "[4, 0, 4]", "mesh.sampling[1]", "0", "greater than or equal to 1"),
    "check as good as the same": ("[6, 3, 6]", "[5, 2, 4]", "mesh.check", "[5, 2, 4]", "1.3 times"),
    "endless cells": (
        "[6, 3, 6]", "[600, 300, 600]", "mesh.check", "[600, 300, 600]", "at most 20,000 elements",
    ),
    "coarse check": ("[6, 3, 6]", "[6, 1, 6]", "mesh.check", "[6, 1, 6]", "finer than the samp"),
    "coarse check of one": ("height = 2.7", "check = [4, 3, 4]", "hypothesis[1].check", "[4, 3, 4]",
                            "1.3 times"),
    "fine sampling of one": ("height = 2.7", "sampling = [6, 3, 5]", "hypothesis[1].sampling",
                             "[6, 3, 5]", "1.3 times"),
    "negative length": ("height = 2.5", "height = -2.5", "geometry.height", "-2.5", "than 0"),
    "infinite length": ("width = 10.0", "width = inf", "geometry.width", "Infinity", "finite"),
    "micrometres": ("width = 10.0", "width = 10000.0", "geometry.width", "10000.0", "in mm"),
    "metres": ("height = 2.5", "height = 0.0025", "geometry.height", "0.0025", "0.1 to 1000"),
    "a friction of many digits": ('pin = "slide"', f"pin = {'9' * 400}", "hypothesis[1].pin",
                                  "9", "friction"),
    "no number": ("width = 10.0", "width = nan", "geometry.width", "NaN", "finite"),
    "wide pin": ("pin_width = 4.0", "pin_width = 12.0", "geometry.pin_width", "12.0", "10 mm"),
    "large fillet": ("fillet = 0.3", "fillet = 2.0", "geometry.pin_fillet", "2.0", "half of"),
    "unknown contact": ('pin = "slide"', 'pin = "glue"', "hypothesis[1].pin", '"glue"', "'stick'"),
    "negative friction": ('pin = "slide"', "pin = -0.3", "hypothesis[1].pin", "-0.3", "0 or more"),
    "true for a friction": ('pin = "slide"', "pin = true", "hypothesis[1].pin", "true", "friction"),
    "endless friction": ('pin = "slide"', "pin = inf", "hypothesis[1].pin", "Infinity", "friction"),
    "list of contacts": ('pin = "slide"', "pin = [0.1]", "hypothesis[1].pin", "[0.1]", "friction"),
    "same name twice": ('"mixed"', '"stuck"  # 2', "hypothesis[1].name", '"stuck"', "no other"),
    "name that is no folder": ('"own"', '"../own"', "name", '"../own"', "letters, digits"),
    "negative seed": ("seed = 7", "seed = -7", "seed", "-7", "greater than or equal to 0"),
    "correlation of one": ("correlation = 0.9", "correlation = 1.0", "noise.sample_correlation",
                           "1.0", "less than 1"),
    "list of correlations": ("correlation = 0.9", "correlation = 0.9\ncorrelation_study = [0.1, 2]",
                             "noise.correlation_study[1]", "2", "less than 1"),
    "bounds the wrong way": ("high = 0.1", "high = 0.0001", "prior.kappa.high", "0.0001", "low"),
    "stiffness of zero": ("low = 0.001", "low = 0.0", "prior.kappa.low", "0.0", "greater than 0"),
    "unknown distribution": ('"normal"', '"gauss"', "prior.s.distribution", '"gauss"', "lognorm"),
    "shape of a uniform": ("high = 1\n", "high = 1\nsd = 2.0\n", "prior.r.sd", "2.0", "no such"),
    "increments that fall": ("[0.5, 1.0]", "[1.0, 0.5]", "increments[1]", "0.5", "more than"),
    "increment of zero": ("[0.5, 1.0]", "[0.0, 1.0]", "increments[0]", "0.0", "greater than 0"),
    "increment beyond the sample": ("[0.5, 1.0]", "[0.5, 2.6]", "increments[1]", "2.6", "2.5 mm"),
    "increment not measured": ("[0.5, 1.0]", "[0.5, 0.8]", "increments[1]", "0.8", "0.5, 1 mm"),
    "noise above the data": ("load_cell_sd = 0.05", "load_cell_sd = 0.15", "noise.load_cell_sd",
                             "0.15", "0.1 N"),
    "data of unknown kind": ('"forces.csv"', '"forces.xls"', "data.source", "forces.xls", ".csv"),
    "data file absent": ('"forces.csv"', '"none.csv"', "data.source", "none.csv", "a file"),
    "virtual without its section": ('"forces.csv"', '"virtual"', "data.source", '"virtual"',
                                    "[virtual]"),
    "sharp pin": ("fillet = 0.3", "fillet = 0.01", "geometry.pin_fillet", "0.01", "no limit"),
    "a sample of another height": ("height = 2.7", "height = 7.6", "hypothesis[1].height", "7.6",
                                   "within a factor 3 of geometry.height (2.5 mm)"),
    "negative C01": ("low = 0\n", "low = -0.1\n", "prior.r.low", "-0.1", "C01 is negative"),
    "negative C10": ("high = 1\n", "high = 1.1\n", "prior.r.high", "1.1", "C10 is negative"),
    "negative C11": ('"normal"\nlow = 0.0', '"normal"\nlow = -0.1', "prior.s.low", "-0.1",
                     "C11 is negative"),
    "endless stiffening": ("high = 0.5", "high = 11.0", "prior.s.high", "11.0", "10 or less"),
    "a mean far outside": ("mean = 0.1", "mean = 9.0", "prior.s.mean", "9.0", "within [0, 0.5]"),
    "a narrow bell outside": ("mean = 0.1\nsd = 0.1", "sd = 1e-9\nmean = 0.6", "prior.s.mean",
                              "0.6", "within [0, 0.5]"),
    "a lognormal beyond floats": ('"normal"\nlow = 0.0\nhigh = 0.5\nmean = 0.1\nsd = 0.1',
                                  '"lognormal"\nlow = 0.1\nhigh = 0.5\nsd = 1e150\nmean = 1e-9',
                                  "prior.s.mean", "1e-09", "within [0.1, 0.5]"),
    "a chain shorter than its memory": ("[prior.kappa]", "[sampler]\nn_autocorrelation = 0.5",
                                        "sampler.n_autocorrelation", "0.5", "equal to 1"),
    "more walkers than starts": ("[prior.kappa]", "[sampler]\nn_walkers = 1026",
                                 "sampler.n_walkers", "1026", "1024"),
    "a single increment": ("[0.5, 1.0]", "[0.5]", "increments", "[0.5]", "two or more"),
}  # fmt: skip


@pytest.mark.parametrize("number", ["0.3", "1", "0"])
def test_a_number_for_a_contact_is_its_coefficient_of_friction(folder, number):
    study = read_study(
        BASE.replace('pin = "slide"', f"pin = {number}").encode(), file="own.toml", folder=folder
    )
    assert study.hypotheses[1].pin == float(number)
    assert study.hypotheses[0].pin == "stick"


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_named_by_file_line_key_found_and_expected(folder, case):
    old, new, key, found, expected = WRONG[case]
    written = BASE[: BASE.index(old)] + new.rstrip("\n")
    line = written.count("\n") + 1
    message = refusal(folder, BASE.replace(old, new, 1))
    place, _, reason = message.partition(" found ")
    shown, _, wanted = reason.partition(", expected ")
    assert place == f"own.toml:{line}: {key}:"
    assert found in shown
    assert expected in wanted


WRONG_VIRTUAL = {
    "unknown hypothesis": ('"stuck"\nC10', '"free"\nC10', "virtual.hypothesis", "stuck, mixed"),
    "coarse mesh": ("[5, 3, 5]", "[3, 3, 5]", "virtual.cells", "finer than the sampling mesh"),
    "a single sample": ("n_samples = 10", "n_samples = 1", "virtual.n_samples", "equal to 2"),
    "a pin nearer to the check's than to a rigid one": (
        "n_samples = 10",
        "stiffening = 2\nn_samples = 10",
        "virtual.stiffening",
        "8 at least, twice mesh.check_stiffening",
    ),
    "two noise levels": (
        "[0.01, 0.01, 0.02]",
        "[0.01, 0.01]",
        "virtual.field_noise_std",
        "x, y, z",
    ),
}


def test_a_virtual_study_needs_no_data_file(tmp_path):
    study = read_study(AS_VIRTUAL.encode(), file="own.toml", folder=tmp_path)
    assert study.virtual is not None
    assert study.virtual.cells == (5, 3, 5)


@pytest.mark.parametrize("case", WRONG_VIRTUAL)
def test_an_impossible_virtual_experiment_is_refused(folder, case):
    old, new, key, expected = WRONG_VIRTUAL[case]
    message = refusal(folder, AS_VIRTUAL.replace(old, new))
    assert message.startswith(f"own.toml:{line_of(AS_VIRTUAL, old)}: {key}: found ")
    assert expected in message


def test_a_virtual_section_beside_real_data_is_refused(folder):
    text = BASE + VIRTUAL
    line = line_of(text, "[virtual]")
    assert refusal(folder, text).startswith(f"own.toml:{line}: virtual: found a table")


@pytest.mark.parametrize(
    ("missing", "at", "key"),
    [
        ("seed = 7\n", "name", "seed"),
        ("depth = 10.0\n", "[geometry]", "geometry.depth"),
        ('base = "stick"\nheight', '[[hypothesis]]\nname = "mixed"', "hypothesis[1].base"),
        ("mean = 0.1\n", "[prior.s]", "prior.s.mean"),
    ],
)
def test_a_missing_key_is_named_at_its_section(folder, missing, at, key):
    kept = "height" if missing.endswith("height") else ""
    text = BASE.replace(missing, kept)
    message = refusal(folder, text)
    assert message.startswith(f"own.toml:{line_of(text, at) if at != 'name' else 1}: {key}: ")
    assert "found nothing, expected " in message


def test_single_brackets_where_double_ones_are_meant_are_shown(folder):
    start, end = BASE.index('[[hypothesis]]\nname = "mixed"'), BASE.index("[noise]")
    text = (BASE[:start] + BASE[end:]).replace("[[hypothesis]]", "[hypothesis]")
    line = line_of(text, "[hypothesis]")
    expected = "found a table, expected one or more sections [[hypothesis]]"
    assert refusal(folder, text) == f"own.toml:{line}: hypothesis: {expected}"


def test_a_missing_section_is_named(folder):
    text = BASE[: BASE.index("[prior.kappa]")]
    assert refusal(folder, text).startswith("own.toml:1: prior: found nothing, expected sections")


def test_the_first_of_several_mistakes_is_reported(folder):
    text = BASE.replace("width = 10.0", "width = 0.0").replace("high = 0.5", "high = true")
    assert refusal(folder, text).startswith("own.toml:9: geometry.width")


def test_a_file_that_is_no_toml_is_refused_with_the_line(folder):
    text = BASE.replace("[geometry]", "[geometry")
    assert refusal(folder, text).startswith(
        f"own.toml:{line_of(text, '[geometry')}: found no valid"
    )


def test_bytes_that_are_not_utf8_are_refused_with_the_line(folder):
    text = BASE.replace("[noise]", "# Prüfstand\n[noise]")
    line = line_of(text, "# Prüf")
    message = refusal(folder, text.encode("latin-1"))
    assert message == f"own.toml:{line}: found the byte 0xfc, expected text saved as UTF-8"


def test_windows_line_ends_and_a_byte_order_mark_are_read(folder):
    content = BASE.replace("\n", "\r\n").encode("utf-8-sig")
    assert read_study(content, file="own.toml", folder=folder).name == "own"


@pytest.mark.parametrize("value", ["9" * 5000, "[" * 5000 + "]" * 5000])
def test_values_beyond_the_reader_are_refused(folder, value):
    assert refusal(folder, BASE.replace("seed = 7", f"seed = {value}")).startswith("own.toml:")


def test_a_missing_study_names_the_embedded_ones(tmp_path):
    with pytest.raises(StudyError, match=r"none\.toml: found no such file.*thesis-forces"):
        load_study(tmp_path / "none.toml")


def test_a_folder_is_no_study(tmp_path):
    with pytest.raises(StudyError) as caught:
        load_study(tmp_path)
    assert str(caught.value) == f"{tmp_path}: found a folder, expected a study file"


def test_a_large_file_is_refused_unread(folder):
    assert "expected a study file" in refusal(folder, b"#" * 2_000_000)


def test_a_wrong_data_file_is_named_with_its_own_line(folder):
    (folder / "forces.csv").write_text(FORCES.replace("3.0", "three"))
    assert refusal(folder, BASE).startswith("forces.csv:3: force_mean_N: found 'three'")


_TEXT = st.sampled_from(BASE.splitlines() + AS_VIRTUAL.splitlines()) | st.text(max_size=8)
_VALUE = st.sampled_from(
    ["0", "-1", "1e308", "nan", "inf", "true", '"x"', "[]", "[1]", "{}", "{a = 1}", "1979-05-27",
     "07:32:00", '"""\n"""', "[[[]]]", "9" * 30, '""', "''", "[1, 'a']", "{low.x = 1}"]
)  # fmt: skip


@st.composite
def mutated(draw: st.DrawFn) -> str:
    """A study file with a few lines dropped, doubled, moved, given another value or cut."""
    lines = draw(st.sampled_from([BASE, AS_VIRTUAL])).splitlines()
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(lines) - 1))
        change = draw(st.sampled_from(["drop", "double", "move", "value", "insert", "cut"]))
        if change == "drop":
            lines[at] = ""
        elif change == "double":
            lines.insert(at, lines[at])
        elif change == "move":
            lines.insert(draw(st.integers(0, len(lines) - 1)), lines[at])
        elif change == "value":
            lines[at] = lines[at].partition("=")[0] + "= " + draw(_VALUE)
        elif change == "insert":
            lines.insert(at, draw(_TEXT))
        else:
            lines[at] = lines[at][: draw(st.integers(0, len(lines[at])))]
    return "\n".join(lines)


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=mutated())
def test_any_mutated_study_is_read_or_refused_with_its_name(folder, text):
    try:
        study = read_study(text.encode(), file="own.toml", folder=folder)
    except StudyError as error:
        assert str(error).startswith("own.toml:")
        assert "found" in str(error) and "expected" in str(error)
    else:
        assert isinstance(study, Study)


@settings(max_examples=100)
@given(content=st.binary(max_size=60))
def test_any_bytes_are_refused_with_their_name(content):
    with pytest.raises(StudyError, match=r"^own\.toml:\d+: "):
        read_study(content, file="own.toml", folder=Path())


def test_a_mistake_in_the_only_hypothesis_is_named_not_that_there_is_none(folder):
    start, end = BASE.index('[[hypothesis]]\nname = "mixed"'), BASE.index("[noise]")
    text = (BASE[:start] + BASE[end:]).replace('pin = "stick"', 'pin = "glue"')
    line = line_of(text, 'pin = "glue"')
    assert refusal(folder, text).startswith(f"own.toml:{line}: hypothesis[0].pin: found")


MESH = BASE[BASE.index("[mesh]") : BASE.index("[[hypothesis]]")]


@pytest.mark.parametrize(
    ("pin", "base", "meshes"),
    [
        ("'stick'", "'stick'", STUCK),
        ("'slide'", "'stick'", STUCK),
        ("0.3", "0.3", RUBBING),
        ("'slide'", "0.1", RUBBING),
        ("'slide'", "'slide'", SLIDING),
    ],
)
def test_a_study_without_meshes_has_those_of_its_contact(folder, pin, base, meshes) -> None:
    text = BASE.replace(MESH, "").replace('pin = "stick"', f"pin = {pin}")
    study = read_study(
        text.replace('base = "stick"', f"base = {base}").encode(), file="own.toml", folder=folder
    )
    of_it = study.hypotheses[0]
    assert (study.sampling_cells(of_it), study.check_cells(of_it)) == meshes
    assert field_order(of_it) == (2.0 if meshes is SLIDING else 1.0)
    assert all(
        check > 1.2 * cell for check, cell in zip(meshes.check, meshes.sampling, strict=True)
    )


def test_a_round_pin_without_meshes_has_those_of_glue_at_any_contact(folder) -> None:
    text = BASE.replace(MESH, "").replace('pin = "slide"\nbase = "stick"', "pin = 0.3\nbase = 0.3")
    text = text.replace("pin_fillet = 0.3", 'pin_fillet = 0.3\npin_shape = "round"')
    study = read_study(text.encode(), file="own.toml", folder=folder)
    assert all((study.sampling_cells(h), study.check_cells(h)) == STUCK for h in study.hypotheses)
    assert [field_order(h) for h in study.hypotheses] == [1.0, 1.0]


def test_meshes_that_are_too_close_to_those_of_the_contact_are_refused_by_name(folder) -> None:
    alone = BASE.replace(MESH, "[mesh]\nsampling = [20, 14, 5]\n\n")
    assert "mesh.sampling: found [20, 14, 5], expected mesh.check beside it, a mesh finer than" in (
        refusal(folder, alone)
    )
    alone = BASE.replace(MESH, "[mesh]\ncheck = [12, 5, 3]\n\n")
    assert "mesh.check: found [12, 5, 3], expected a mesh finer than the sampling mesh" in (
        refusal(folder, alone)
    )


OGDEN = """
[prior.alpha1]
distribution = "uniform"
low = 0.5
high = 4.0

[prior.alpha2]
distribution = "uniform"
low = {low}
high = 8.0

[prior.share2]
distribution = "uniform"
low = 0.0
high = 1.0

[design]"""


@pytest.mark.parametrize("low", [0.5, 4.0])
def test_terms_of_an_ogden_law_are_in_some_order(tmp_path: Path, low: float) -> None:
    embedded = Path(calib.__file__).parent / "study" / "embedded" / "thesis-forces.toml"
    text = embedded.read_text()
    before, rest = text.split("[prior.r]")
    text = before + "[design]" + rest.split("[design]")[1]
    text = text.replace("[material]", '[material]\nlaw = "ogden-2"')
    text = text.replace("[design]", OGDEN.format(low=low).lstrip())
    file = tmp_path / "own.toml"
    file.write_text(text)
    if low < 4.0:
        with pytest.raises(StudyError, match=r"alpha2\.low: found 0\.5, expected a range apart"):
            load_study(str(file))
    else:
        load_study(str(file))
