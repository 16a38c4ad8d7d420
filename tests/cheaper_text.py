"""Texts of studies and notebooks with smaller meshes and fewer runs, for their tests."""

from __future__ import annotations

from collections.abc import Mapping


def in_place_of(text: str, cheaper: Mapping[str, str]) -> str:
    """A text with its costly passages, all of which it must have, replaced by cheaper ones."""
    for costly, cheap in cheaper.items():
        assert costly in text, costly
        text = text.replace(costly, cheap)
    return text
