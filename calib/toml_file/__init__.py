"""TOML files that people write: checked against a dataclass, refused in one sentence by line."""

from calib.toml_file.document import Document, FileRefused, read_document, read_file
from calib.toml_file.refusal import Contradiction, Refusal, sentence

__all__ = [
    "Contradiction",
    "Document",
    "FileRefused",
    "Refusal",
    "read_document",
    "read_file",
    "sentence",
]
