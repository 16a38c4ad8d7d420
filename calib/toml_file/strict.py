"""What a dataclass of a file takes: its own types only, no keys beside its own, no NaN."""

from pydantic import ConfigDict

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True)
"""text under a field is also what a refusal says it expects"""
