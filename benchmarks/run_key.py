"""What a stored benchmark run depends on, in a few letters for the name of its file."""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from pathlib import Path

import fe
from fe.fingerprint import canonical_json, fingerprint

Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def run_key(model: object, source: Path | None = None) -> str:
    """Letters that change with the model's fields and with any code of the package `fe`.

    `source` is the package's folder.  Comments, docstrings and layout do not count, so that words
    can be mended without running everything again.
    """
    digest = hashlib.sha256(canonical_json(fingerprint(model)).encode())
    digest.update(_code(source or Path(fe.__file__).parent).encode())
    return digest.hexdigest()[:12]


@cache
def _code(folder: Path) -> str:
    """The syntax trees of all modules in a folder."""
    trees = []
    for path in sorted(folder.rglob("*.py")):
        tree = ast.parse(path.read_text())
        for node in ast.walk(tree):
            if isinstance(node, Documented) and ast.get_docstring(node) is not None:
                del node.body[0]
        trees.append(f"{path.relative_to(folder).as_posix()}: {ast.dump(tree)}")
    return "\n".join(trees)
