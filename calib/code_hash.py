"""Hash of the code of a package: what is kept of its results is of that code."""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable


@cache
def code_hash(package: str) -> str:
    """Hash of the modules of an installed package, given by its dotted name.

    A version set by hand is forgotten when a formula changes; a comment that changes costs one more
    run.
    """
    return hash_of_modules(resources.files(package))


def hash_of_modules(package: Traversable) -> str:
    """SHA-256 of names and text of all Python files of a package and of those within it."""
    digest = hashlib.sha256()
    for name, module in _modules(package, ""):
        digest.update(name.encode() + b"\0" + hashlib.sha256(module.read_bytes()).digest())
    return digest.hexdigest()


@cache
def syntax_hash(package: str) -> str:
    """Hash of what the modules of an installed package do: comments and docstrings do not count.

    For results that are too dear to be made anew for a word; another version of Python may write
    the same syntax otherwise, which makes them anew as well.
    """
    return hash_of_syntax(resources.files(package))


def hash_of_syntax(package: Traversable) -> str:
    """SHA-256 of names and syntax trees of all Python files of a package and of those within it."""
    digest = hashlib.sha256()
    for name, module in _modules(package, ""):
        tree = _Undocumented().visit(ast.parse(module.read_bytes()))
        digest.update(name.encode() + b"\0" + hashlib.sha256(ast.dump(tree).encode()).digest())
    return digest.hexdigest()


class _Undocumented(ast.NodeTransformer):
    """Removes texts that stand alone: docstrings, also those below constants and fields."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        found = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if found else node


def _modules(package: Traversable, within: str) -> list[tuple[str, Traversable]]:
    """Python files of a package and those in it, in order of their names."""
    found: list[tuple[str, Traversable]] = []
    for part in sorted(package.iterdir(), key=lambda part: part.name):
        name = f"{within}/{part.name}"
        if part.is_dir():
            found += _modules(part, name)
        elif name.endswith(".py") and part.is_file():  # not the link that an editor locks with
            found.append((name, part))
    return found
