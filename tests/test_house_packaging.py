"""What an installed softcal has beside its modules."""

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("package", ["calib", "fe", "surrogate"])
def test_type_checkers_of_users_see_the_types(package: str) -> None:
    """PEP 561: a marker in the package, and in what is installed of it."""
    assert (ROOT / package / "py.typed").is_file()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert "py.typed" in project["tool"]["setuptools"]["package-data"]["*"]
