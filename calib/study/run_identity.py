"""What the runs of a study are known by: model and code of the finite elements."""

from __future__ import annotations

from calib.code_hash import syntax_hash
from fe.fingerprint import fingerprint


def run_identity(simulate: object) -> dict[str, object]:
    """Fields of a model and the hash of the package `fe`, as JSON values.

    The version of softcal alone, which is in every run's key, is the same over many changes of the
    code. Raises TypeError for a model that is no dataclass or has fields that JSON cannot hold.
    """
    return fingerprint(simulate) | {"code": syntax_hash("fe")[:16]}
