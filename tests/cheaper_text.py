"""Texts of studies and notebooks with smaller meshes and fewer runs, for their tests."""

from __future__ import annotations

from collections.abc import Mapping


def in_place_of(text: str, cheaper: Mapping[str, str]) -> str:
    """A text with cheaper passages in place of costly ones, each of which it must have once."""
    for costly, cheap in cheaper.items():
        assert text.count(costly) == 1, costly
        text = text.replace(costly, cheap)
    return text
