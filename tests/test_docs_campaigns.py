"""The recipes of docs/campaigns.md run as they are written, on fewer elements."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from fe.run_files import load_run

RECIPE = re.compile(r"```python\n(.*?)```", re.DOTALL)
PAGE = Path(__file__).parent.parent / "docs" / "campaigns.md"


def run(number: int, changes: dict[str, str], folder: Path) -> subprocess.CompletedProcess[str]:
    """A Python block of the page, some words of which are changed, as a script in a folder."""
    recipe = RECIPE.findall(PAGE.read_text())[number]
    for written, small in changes.items():
        assert recipe.count(written) == 1
        recipe = recipe.replace(written, small)
    (folder / "recipe.py").write_text(recipe)
    return subprocess.run(
        [sys.executable, "recipe.py"], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.mark.lasting
def test_a_bar_and_a_round_pin_run_and_show_the_time_left(tmp_path: Path) -> None:
    ran = run(0, {"(12, 6, 2)": "(3, 2, 3)", "(0.6, 1.0, 1.4)": "(0.05, 0.1)"}, tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.count("True") == 4  # two travels of each pin are good
    assert re.search(r"2/2 \[.*<00:00", ran.stderr)
    assert len(list((tmp_path / "runs" / "blocks").glob("run_*.npz"))) == 2


@pytest.mark.lasting
def test_a_design_over_pins_and_contacts_runs(tmp_path: Path) -> None:
    small = {"(12, 4, 2)": "(2, 1, 2)", "(0.6, 1.0, 1.4)": "(0.05,)", "map(0)": "map(1)"}
    ran = run(1, small, tmp_path)
    assert ran.returncode == 0, ran.stderr
    runs = [load_run(path) for path in (tmp_path / "runs" / "factors").glob("run_*.npz")]
    assert len(runs) == 8 and "nan" not in ran.stdout
    found = sorted((int(pin), int(contact)) for *_, pin, contact in (run.theta for run in runs))
    assert found == 2 * [(0, 0)] + 2 * [(0, 1)] + 2 * [(1, 0)] + 2 * [(1, 1)]
