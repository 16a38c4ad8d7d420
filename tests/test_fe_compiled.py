"""Compiled kernels are made anew when what they call in other files has changed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
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
    return _below(x)

@kernel()
def _below(x):
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


@njit(cache=False)
def _one(x: float) -> float:
    return x + 1.0


@njit(cache=False)
def _two(x: float) -> float:
    return x + 2.0


class _Fields(NamedTuple):
    a: float
    b: float


class _Exchanged(NamedTuple):
    b: float
    a: float


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (_one, _two),
        (3.0, 4.0),
        (np.int64(3), np.int64(4)),
        (np.uint64(3), np.int64(3)),
        (np.arange(3), np.arange(4)),
        (_Fields, _Exchanged),
    ],
)
def test_a_digest_is_that_of_what_a_module_has(one: object, other: object) -> None:
    def of(value: object) -> str:
        space: dict[str, Any] = {"value": value, "__name__": "module"}
        exec("def f(x):\n    return x", space)
        return digest(space["f"], {"inline": "always"})

    assert of(one) == of(one) != of(other)


def test_a_digest_is_that_of_defaults_and_options() -> None:
    def f(x: float, by: float = 1.0) -> float:
        return x * by

    def g(x: float, by: float = 2.0) -> float:
        return x * by

    g.__name__ = "f"
    assert digest(f, {}) != digest(g, {})
    sets = [{"fastmath": {"nsz", "contract"}}, {"fastmath": {"contract", "nsz"}}]
    assert digest(f, sets[0]) == digest(f, sets[1])
    assert digest(f, {}) != digest(f, {"error_model": "numpy"})
