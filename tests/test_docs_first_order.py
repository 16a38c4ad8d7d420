"""What the documents say of first-order meshes is what their command wrote."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
RUNS = {run["n"]: run for run in json.loads((DOCS / "verification/first_order.json").read_text())}
FINEST = json.loads((DOCS / "verification/fe_speed.json").read_text())["bars"][-1]["force"]


def rows(file: str, start: str) -> list[list[str]]:
    """Cells of all lines of tables that start so."""
    lines = (DOCS / file).read_text().splitlines()
    return [line.strip("| ").split(" | ") for line in lines if line.startswith(start)]


@pytest.mark.parametrize("n", list(RUNS))
def test_the_table_of_speeds_has_each_mesh(n: int) -> None:
    run = RUNS[n]
    cells = " x ".join(map(str, run["cells"]))
    (row,) = rows("verification.md", f"| {cells} Q1/P0 (n = {n})")
    assert row[1] == f"{run['n_unknowns']:,}" and float(row[3]) == run["thesis_seconds"]
    assert float(row[2]) == pytest.approx(run["seconds"], rel=0.01)
    above = [float(value) for value in row[5].split(", ")]
    for found, force, finest in zip(above, run["force"], FINEST, strict=True):
        assert found == pytest.approx(100.0 * (force / finest - 1.0), abs=0.06)


@pytest.mark.parametrize("n", [n for n in RUNS if n >= 10])
def test_the_document_of_the_thesis_has_its_force_and_growth(n: int) -> None:
    force = RUNS[n]["force"]
    (row,) = rows("the-thesis-revisited.md", f"| first order, n = {n} |")
    for found, own, finest in zip(row[2].split(", "), force, FINEST, strict=True):
        assert float(found) == pytest.approx(100.0 * (own / finest - 1.0), abs=0.06)
    growth = [float(value) for value in row[3].split(" : ")]
    assert growth == pytest.approx([own / force[0] for own in force], abs=6e-4)
