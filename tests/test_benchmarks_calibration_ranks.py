"""The figure of calibration is of whole sets of posteriors, the newest of each arm."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks.calibration_ranks import below_of, main, ranks_figure


def keep(folder: Path, below: np.ndarray, seed: int, age: float = 0.0) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for first in range(0, len(below), 50):
        path = folder / f"{len(below)}_{seed}_{first}.npz"
        np.savez(path, below=below[first : first + 50])
        os.utime(path, (1e9 - age, 1e9 - age))


def test_the_newest_whole_set_of_an_arm_is_drawn(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    old, new = rng.random((100, 3)), rng.random((120, 3))
    folder = tmp_path / "placed" / "fe"
    keep(folder, old, 1, age=10.0)
    keep(folder, new, 2)
    assert np.array_equal(below_of(folder), new)
    out = tmp_path / "ranks.png"
    main(["fe", "--store", str(tmp_path), "--out", str(out)])
    assert out.stat().st_size > 10_000
    (folder / "120_2_50.npz").unlink()
    with pytest.raises(ValueError, match="found posteriors of 70 experiments, expected 120"):
        below_of(folder)


def test_the_curves_are_the_distribution_functions_less_the_uniform_one() -> None:
    """Half the truths below their posteriors' quarter: the curve is a quarter above there."""
    n = 1000
    even = (np.arange(n) + 0.5) / n
    squeezed = np.where(even < 0.5, even / 2.0, 0.25 + 0.75 * (even - 0.5) * 2.0)
    figure = ranks_figure({"fe": np.column_stack([even, squeezed, even])})
    lines = {line.get_label(): np.array(line.get_xydata()) for line in figure.axes[0].lines}
    flat = next(xy for name, xy in lines.items() if str(name).startswith("kappa 50 / 80 / 95"))
    assert np.abs(flat[:, 1]).max() < 1e-12
    bent = next(xy for name, xy in lines.items() if str(name).startswith("r "))
    assert bent[np.argmax(bent[:, 1])] == pytest.approx([0.25, 0.25], abs=2e-3)


def test_an_arm_that_is_not_there_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keep(tmp_path / "placed" / "fe", np.random.default_rng(0).random((100, 3)), 1)
    with pytest.raises(SystemExit):
        main(["sliding", "--store", str(tmp_path)])
    assert "found no arm sliding, expected some of fe" in capsys.readouterr().err
