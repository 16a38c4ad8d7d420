"""The FE benchmark runs as a module and as a script, and its figures are what it says."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("felupe")

from benchmarks.thesis_meshes import TABLE_3_7, BarRun, cost_exponent
from benchmarks.timing import median_seconds

ROOT = Path(__file__).parents[1]
KEYS = {
    "speedup_vs_thesis_n20",
    "cost_exponent",
    "speedup_vs_felupe",
    "speedup_vs_calculix",
    "sample_seconds",
    "kernel_speedup_vs_skfem",
    "peak_memory_gb_n20",
}


def test_the_script_writes_every_figure(tmp_path):
    """From another folder, as a script: its own folder must not hide the package `fe`."""
    out = tmp_path / "fe.json"
    done = subprocess.run(
        [sys.executable, str(ROOT / "benchmarks" / "fe.py"), "--quick", "--json", str(out)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    figures = json.loads(out.read_text())
    assert figures.keys() >= KEYS
    assert figures["quick"] is True
    assert figures["sample_seconds"] > 0.0
    assert figures["kernel_speedup_vs_skfem"] > 1.0
    assert 0.0 < figures["peak_memory_gb_n20"] < 4.0
    (first_order,) = figures["first_order_bars"]
    finest = figures["bars"][-1]["force"][-1]
    assert first_order["from_finest_percent"] == [
        pytest.approx(100.0 * (first_order["force"][-1] / finest - 1.0))
    ]


def test_the_cost_exponent_is_the_slope_of_a_power_law():
    runs = [BarRun((1, 1, 1), n, 3e-5 * n**1.4, 1, 1.4, [1.0]) for n in (100, 1000, 5000)]
    np.testing.assert_allclose(cost_exponent(runs), 1.4, rtol=1e-12)


def test_the_median_leaves_the_first_call_out():
    calls = []
    result, seconds = median_seconds(lambda: calls.append(1) or len(calls), 3)
    assert result == len(calls) == 4
    assert seconds < 1.0


def test_the_table_has_the_thesis_number_of_elements():
    """Table 3.7 lists 500, 4000, 13500, 32000 and 62500 elements: n x 2n x 2n."""
    assert [4 * n**3 for n in TABLE_3_7] == [500, 4000, 13500, 32000, 62500]
