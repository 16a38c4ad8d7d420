"""What a stored benchmark run depends on, in a few letters for the name of its file."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from calib.code_hash import hash_of_syntax, syntax_hash
from fe import run_campaign
from fe.campaign import CampaignPlan, Simulate, load_campaign
from fe.campaign_result import Campaign
from fe.fingerprint import canonical_json, fingerprint
from fe.response import Array


def run_key(model: object, source: Path | None = None) -> str:
    """Letters that change with the model's fields and with any code of the package `fe`.

    `source` is the package's folder.  Comments, docstrings and layout do not count, so that words
    can be mended without running everything again.
    """
    digest = hashlib.sha256(canonical_json(fingerprint(model)).encode())
    digest.update((hash_of_syntax(source) if source else syntax_hash("fe")).encode())
    return digest.hexdigest()[:12]


def kept_campaign(simulate: Simulate, theta: Array, store: Path, **options: Any) -> Campaign:
    """`fe.run_campaign` on a store that tells runs of other code of the package `fe` apart."""
    return run_campaign(simulate, theta, store, fingerprint=_own(simulate), **options)


def is_kept(simulate: Simulate, theta: Array, store: Path) -> bool:
    """Whether `kept_campaign` would find all of these runs in the store."""
    try:
        load_campaign(CampaignPlan(simulate, theta, store, fingerprint=_own(simulate)))
    except ValueError:
        return False
    return True


def _own(simulate: Simulate) -> dict[str, object]:
    return fingerprint(simulate) | {"code": syntax_hash("fe")[:12]}
