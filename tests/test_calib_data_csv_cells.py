"""Text and cells of csv files: what cannot be read is one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.data.csv_cells import csv_cells, csv_text


def test_cells_are_stripped_and_quotes_kept_together() -> None:
    assert csv_cells(Path("a.csv"), 1, ' 1 ,"a, b",') == ["1", "a, b", ""]


def test_an_endless_cell_is_refused_with_its_line() -> None:
    with pytest.raises(ValueError, match=r"^a\.csv:3: found a cell of more than 131072 characters"):
        csv_cells(Path("a.csv"), 3, "9" * 200_000)


def test_a_file_that_is_no_text_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "latin.csv").write_bytes("Prüfstand".encode("latin-1"))
    with pytest.raises(ValueError, match=r"latin\.csv: expected a text file that can be read, fou"):
        csv_text(tmp_path / "latin.csv")
    with pytest.raises(ValueError, match=r"expected a text file that can be read, found Is a dir"):
        csv_text(tmp_path)
    (tmp_path / "mark.csv").write_bytes(b"\xef\xbb\xbfa")
    assert csv_text(tmp_path / "mark.csv") == "a"
