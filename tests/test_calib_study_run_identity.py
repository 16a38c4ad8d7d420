"""Runs of studies are known by the code of the finite elements, too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.code_hash import hash_of_syntax
from calib.study import run_identity as module
from calib.study.run_identity import run_identity
from calib.study.simulations import StoredSimulate
from fe.fingerprint import fingerprint
from fe.run_files import run_files
from tests.toy_simulation import Toy

ROW = np.array([0.4, 0.1])


def test_runs_of_other_code_are_made_anew_and_those_of_this_code_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = StoredSimulate(Toy(), tmp_path)
    stored(ROW)
    stored(ROW)
    assert len(run_files(tmp_path)) == 1
    monkeypatch.setattr(module, "syntax_hash", lambda package: "0" * 64)
    stored(ROW)
    assert len(run_files(tmp_path)) == 2


def test_the_identity_holds_the_fields_of_the_model() -> None:
    assert fingerprint(Toy(factor=2.0)).items() <= run_identity(Toy(factor=2.0)).items()


def test_words_leave_the_hash_of_the_syntax_and_formulas_change_it(tmp_path: Path) -> None:
    code = tmp_path / "law.py"
    code.write_text("def f(x):\n    return 2 * x\n")
    first = hash_of_syntax(tmp_path)
    code.write_text('def f(x):\n    """Twice."""\n    return 2 * x  # why\n')
    assert hash_of_syntax(tmp_path) == first
    code.write_text("def f(x):\n    return 3 * x\n")
    assert hash_of_syntax(tmp_path) != first
