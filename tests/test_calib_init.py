"""The public face of `calib`: every name is there, and none is imported before it is asked for."""

from __future__ import annotations

import subprocess
import sys

import calib


def test_every_public_name_can_be_had() -> None:
    assert sorted(calib.__all__) == calib.__all__
    for name in calib.__all__:
        assert getattr(calib, name) is not None


def test_importing_the_package_imports_none_of_its_parts() -> None:
    program = "import sys, calib; print([m for m in sys.modules if m.startswith('calib.')])"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert found.stdout.strip() == "[]"
