"""The first recipe of docs/campaigns.md runs as it is written, on fewer elements."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

RECIPE = re.compile(r"```python\n(.*?)```", re.DOTALL)
PAGE = Path(__file__).parent.parent / "docs" / "campaigns.md"


def test_the_recipe_runs_a_bar_and_a_round_pin_and_shows_the_time_left(tmp_path: Path) -> None:
    found = RECIPE.search(PAGE.read_text())
    assert found is not None
    recipe = found.group(1)
    for written, small in (("(12, 6, 2)", "(3, 2, 3)"), ("(0.6, 1.0, 1.4)", "(0.05, 0.1)")):
        assert recipe.count(written) == 1
        recipe = recipe.replace(written, small)
    (tmp_path / "recipe.py").write_text(recipe)
    ran = subprocess.run(
        [sys.executable, "recipe.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.count("True") == 4  # two travels of each pin are good
    assert re.search(r"2/2 \[.*<00:00", ran.stderr)
    assert len(list((tmp_path / "runs" / "blocks").glob("run_*.npz"))) == 2
