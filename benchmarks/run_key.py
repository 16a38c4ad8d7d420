"""What a stored benchmark run depends on, in a few letters for the name of its file."""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from pathlib import Path
from typing import Any

import fe
from fe import run_campaign
from fe.campaign import Simulate
from fe.campaign_result import Campaign
from fe.fingerprint import canonical_json, fingerprint
from fe.response import Array


def run_key(model: object, source: Path | None = None) -> str:
    """Letters that change with the model's fields and with any code of the package `fe`.

    `source` is the package's folder.  Comments, docstrings and layout do not count, so that words
    can be mended without running everything again.
    """
    digest = hashlib.sha256(canonical_json(fingerprint(model)).encode())
    digest.update(_code(source or Path(fe.__file__).parent).encode())
    return digest.hexdigest()[:12]


def kept_campaign(simulate: Simulate, theta: Array, store: Path, **options: Any) -> Campaign:
    """`fe.run_campaign` on a store that tells runs of other code of the package `fe` apart.

    Those of studies are told apart by version, which does not change with every commit.
    """
    code = hashlib.sha256(_code(Path(fe.__file__).parent).encode()).hexdigest()[:12]
    return run_campaign(
        simulate, theta, store, fingerprint=fingerprint(simulate) | {"code": code}, **options
    )


class _Undocumented(ast.NodeTransformer):
    """Removes texts that stand alone: docstrings, also those below constants and fields."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        found = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if found else node


@cache
def _code(folder: Path) -> str:
    """The syntax trees of all modules in a folder."""
    trees = []
    for path in sorted(folder.rglob("*.py")):
        tree = _Undocumented().visit(ast.parse(path.read_text()))
        trees.append(f"{path.relative_to(folder).as_posix()}: {ast.dump(tree)}")
    return "\n".join(trees)
