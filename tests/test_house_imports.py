"""The packages import one another in one direction, and labelled tables stay at the edge."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("calib", "fe", "surrogate")
FORBIDDEN = {"fe": {"calib", "surrogate"}, "surrogate": {"calib", "fe"}, "calib": set[str]()}
LABELLED = {
    "calib/inference/convergence.py",
    "calib/inference/inference_data.py",
    "calib/inference/population_data.py",
}
EDGE_FILES = {
    "pandas": {"calib/study/summary_files.py"},
    "xarray": LABELLED | {"fe/labelled_response.py"},
    "arviz": LABELLED,
}
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def imported(tree: ast.Module) -> Iterator[str]:
    """Full names of all modules imported anywhere in a file, inside functions too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide the direction"
            yield node.module or ""


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@cache
def names_in(path: Path) -> tuple[str, ...]:
    return tuple(imported(parsed(path)))


def top_level(path: Path) -> set[str]:
    return {name.partition(".")[0] for name in names_in(path)}


def test_the_packages_are_where_this_test_looks():
    assert {path.relative_to(ROOT).parts[0] for path in FILES} == set(PACKAGES)


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_go_from_calib_to_surrogate_and_fe_only(package):
    wrong = {
        str(path.relative_to(ROOT)): found
        for path in (ROOT / package).rglob("*.py")
        if (found := top_level(path) & FORBIDDEN[package])
    }
    assert wrong == {}


@pytest.mark.parametrize("library", EDGE_FILES)
def test_labelled_tables_are_the_business_of_few_files(library):
    users = {str(path.relative_to(ROOT)) for path in FILES if library in top_level(path)}
    assert users == EDGE_FILES[library]


def test_studies_are_seen_by_the_command_only():
    seen_by = {
        str(path.relative_to(ROOT))
        for path in FILES
        for name in names_in(path)
        if name.startswith("calib.study") and (ROOT / "calib/study") not in path.parents
    }
    assert seen_by <= {"calib/asking_verbs.py", "calib/verbs.py"}


def test_lens_design_is_seen_by_the_command_and_virtual_cameras_only():
    seen_by = {
        str(path.relative_to(ROOT))
        for path in FILES
        for name in names_in(path)
        if name.startswith("calib.optics") and (ROOT / "calib/optics") not in path.parents
    }
    assert seen_by == {"calib/verbs.py", "calib/virtual/cameras.py"}


def unpickles(tree: ast.Module) -> bool:
    """Whether a file can read a pickle from disk: code of others would run on loading it."""
    libraries = {name.partition(".")[0] for name in imported(tree)}
    if libraries & {"joblib", "dill", "cloudpickle", "shelve", "marshal"}:
        return True
    return any(_unpickles(node) for node in ast.walk(tree))


def _unpickles(node: ast.AST) -> bool:
    match node:
        case ast.keyword(arg="allow_pickle", value=value):
            return not (isinstance(value, ast.Constant) and value.value is False)
        case ast.Attribute(value=ast.Name(id="pickle"), attr="load" | "Unpickler"):
            return True
        case ast.Attribute(attr="read_pickle"):
            return True
        case ast.ImportFrom(module="pickle"):
            return True
    return False


def test_nothing_pickled_is_loaded_from_disk():
    assert [str(p.relative_to(ROOT)) for p in FILES if unpickles(parsed(p))] == []


def test_pickled_bytes_are_only_read_between_processes():
    users = [str(p.relative_to(ROOT)) for p in FILES if "pickle.loads" in p.read_text()]
    assert users == ["fe/executors.py"]


@pytest.mark.parametrize(
    "code",
    [
        "import joblib",
        "import pickle\npickle.load(f)",
        "np.load(p, allow_pickle=True)",
        "pd.read_pickle(p)",
    ],
)
def test_the_pickle_rule_sees_what_it_forbids(code):
    assert unpickles(ast.parse(code))
