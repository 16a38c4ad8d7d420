"""Compiled kernels are made anew when what they call in other files has changed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba import njit

from fe.compiled import digest

CONSTANTS = "RATE = 2.0\n"
INNER = """
from constants import RATE
from fe.compiled import kernel

@kernel({options})
def inner(x):
    return RATE * x
"""
OUTER = """
from fe.compiled import kernel
from inner import inner

@kernel()
def outer(x):
    return inner(x) + 1.0

if __name__ == "__main__":
    value = outer(3.0)
    print(value, sum(outer.stats.cache_hits.values()))
"""


def run(folder: Path) -> tuple[float, int]:
    """What the program in a folder prints: a value and how many kernels came from the disk."""
    root = Path(__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{root}"}
    for name in ("PYTHONDONTWRITEBYTECODE", "NUMBA_CACHE_DIR"):
        environment.pop(name, None)
    result = subprocess.run(
        [sys.executable, str(folder / "outer.py")],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env=environment,
    )
    assert result.returncode == 0, result.stderr
    value, hits = result.stdout.split()
    return float(value), int(hits)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "constants.py").write_text(CONSTANTS)
    (tmp_path / "inner.py").write_text(INNER.format(options=""))
    (tmp_path / "outer.py").write_text(OUTER)
    return tmp_path


@pytest.mark.lasting
def test_a_kernel_follows_the_code_and_the_constants_of_other_files(folder: Path) -> None:
    assert run(folder) == (7.0, 0)
    assert run(folder) == (7.0, 1), "kept from the run before"
    inner = folder / "inner.py"
    inner.write_text(inner.read_text().replace("* x", "* x * x"))
    assert run(folder) == (19.0, 0)
    (folder / "constants.py").write_text("RATE = 10.0\n")
    assert run(folder) == (91.0, 0)
    (folder / "constants.py").write_text(CONSTANTS)
    assert run(folder) == (19.0, 1)


def test_a_digest_is_that_of_all_that_is_called_and_of_its_options() -> None:
    @njit(cache=False)
    def one(x: float) -> float:
        return x + 1.0

    @njit(cache=False)
    def two(x: float) -> float:
        return x + 2.0

    def of(called: object) -> str:
        space: dict[str, object] = {"called": called}
        exec("def f(x):\n    return called(x)", space)
        return digest(space["f"], {"inline": "always"})  # type: ignore[arg-type]

    assert of(one) == of(one) != of(two)
    assert of(3.0) != of(4.0)

    def f(x: float) -> float:
        return x

    assert digest(f, {"fastmath": {"nsz", "contract"}}) == digest(
        f, {"fastmath": {"contract", "nsz"}}
    )
    assert digest(f, {}) != digest(f, {"error_model": "numpy"})
