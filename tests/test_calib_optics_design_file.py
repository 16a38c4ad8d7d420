"""Lens files are read or refused by line, and `calib lens` answers with the codes it documents."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib import cli
from calib.optics.design_file import MOST_TRIED, load_design
from calib.toml_file import FileRefused

GOOD = """\
[sample]
width = 4
height = 2
out_of_plane = 0.4

[camera]
columns = 2448
rows = 2050
pixel = 0.00345

[[lens]]
name = "85"
focal_lengths = [85]
f_stops = [5.6, 8]
image_circle = 12
nearest_distance = 850
barrel_diameter = 50

[search]
extension_tubes = [0, 20]
half_angles = [15]
distances = 10
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "own.toml"
    path.write_text(text)
    return path


def test_a_lens_file_is_read_with_whole_numbers_and_defaults(tmp_path: Path) -> None:
    design = load_design(write(tmp_path, GOOD))
    assert design.sample.width == 4.0
    assert design.limits.least_points == 500
    assert design.lenses[0].f_stops == (5.6, 8.0)
    assert design.camera.diagonal == pytest.approx(11.0158, abs=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "line", "parts"),
    [
        ("width = 4", "width = -4", 2, ["sample.width", "-4", "greater than", "mm"]),
        ("width = 4", "widht = 4", 2, ["sample.widht", "unknown key", "width, height"]),
        ("columns = 2448", "columns = 2448.5", 7, ["camera.columns", "2448.5"]),
        ("pixel = 0.00345", "", 6, ["camera.pixel", "found nothing", "side of one pixel"]),
        ("[[lens]]", "[lens]", 11, ["lens: found a table", "[[lens]]"]),
        ("[[lens]]", "[[lenses]]", 11, ["lenses", "unknown key", "[[lens]]"]),
        ("= 850", "= 170", 16, ["nearest_distance", "170", "twice the focal length (170 mm)"]),
        ("[5.6, 8]", "[]", 14, ["f_stops", "one or more apertures"]),
        ("[15]", "[95]", 21, ["half_angles", "95", "less than 90"]),
        ("= 10", "= 1", 22, ["search.distances", "found 1"]),
        ("= 0.4", "= nan", 4, ["out_of_plane"]),
        ("= 0.4", "= = 0.4", 4, ["no valid TOML"]),
    ],
)
def test_a_wrong_lens_file_is_refused_by_line_and_key(
    tmp_path: Path, old: str, new: str, line: int, parts: list[str]
) -> None:
    path = write(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(FileRefused) as caught:
        load_design(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:{line}: ")
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_more_combinations_than_memory_allows_are_refused(tmp_path: Path) -> None:
    tubes = f"[{', '.join(str(i) for i in range(200))}]"
    angles = f"[{', '.join(str(i) for i in range(1, 90))}]"
    text = GOOD.replace("[0, 20]", tubes).replace("[15]", angles).replace("= 10", "= 10000")
    with pytest.raises(FileRefused, match=rf"search\.distances: .*at most {MOST_TRIED}"):
        load_design(write(tmp_path, text))


def test_a_lens_that_reaches_nothing_within_the_room_is_named(tmp_path: Path) -> None:
    text = GOOD.replace("[0, 20]", "[0]") + "farthest = 500\n"
    with pytest.raises(ValueError, match=r"search\.farthest: found 500 mm.* 850 mm.*lens '85'"):
        from calib.optics.search import search

        search(load_design(write(tmp_path, text)))


def test_a_lens_out_of_reach_is_told_and_does_not_end_the_search_of_others(
    tmp_path: Path, capsys
) -> None:
    lens = GOOD[GOOD.index("[[lens]]") : GOOD.index("[search]")]
    near = lens.replace('"85"', '"near"').replace("= 850", "= 350")
    text = GOOD.replace("[0, 20]", "[0]").replace("[search]", f"{near}[search]")
    cli.main(["lens", str(write(tmp_path, f"{text}farthest = 500\n"))])
    said = capsys.readouterr()
    assert "lens '85' focuses with these tubes; it is left out" in said.err
    assert said.out.count("near ") == 1
    assert "\n85 " not in said.out


def test_lens_without_a_file_prints_the_thesis_tables_and_the_4_mm_search(capsys) -> None:
    assert cli.main(["lens"]) == 0
    said = capsys.readouterr()
    assert "Table 3.3     lens set 3, field of view            51  " in said.out
    assert "macro 100 mm" in said.out
    assert "calib: Table 3.4, Pixel Width: printed 0.0109" in said.err
    assert "none of" in said.err


def test_lens_with_a_file_searches_and_draws(tmp_path: Path, capsys) -> None:
    figure = tmp_path / "lens.png"
    assert cli.main(["lens", str(write(tmp_path, GOOD)), "--figure", str(figure)]) == 0
    said = capsys.readouterr()
    assert "Table 3.3" not in said.out
    assert said.err == ""
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_lens_exits_with_1_when_no_lens_is_usable(tmp_path: Path, capsys) -> None:
    text = GOOD.replace("image_circle = 12", "image_circle = 6")
    assert cli.main(["lens", str(write(tmp_path, text))]) == cli.FAILED
    assert "image circle (need/have 1.84)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["absent.toml"], "absent.toml: found no such file, expected a lens file or one of"),
        ([str(Path(__file__).parent)], "tests: found a folder, expected a lens file"),
        (["--figure", "lens.pdf"], "--figure: found lens.pdf, expected a file name that ends"),
        (
            ["--figure", f"{__file__}/x.png"],
            f"--figure: found the file {__file__}, expected a folder",
        ),
    ],
)
def test_lens_refuses_wrong_input_in_one_sentence(arguments: list[str], part: str, capsys) -> None:
    assert cli.main(["lens", *arguments]) == cli.WRONG_INPUT
    said = capsys.readouterr()
    assert said.out == ""
    assert part in said.err
    assert said.err.count("\n") == 1
