"""The scanner finds every key of a valid TOML document, and on its own line."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator

from hypothesis import given
from hypothesis import strategies as st

from calib.toml_file.lines import key_lines, nearest_line

DOCUMENT = '''\
name = "x"  # comment = [not, a, key]
"quoted key" = 1
a.b.c = 2
text = """
fake = 1
[fake]
"""
numbers = [
  1.5,  # one
  [2, 3],
]
inline = { x = 1, y = { z = "},=" } }
when = 1979-05-27 07:32:00

[table]
key = 'C:\\\\[x]'

[table.below]
key = 1

[[many]]
name = "a"

[[many]]
name = "b"
[many.part]
deep = 1
'''


def paths(value: object, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Paths of everything in parsed TOML."""
    items = value.items() if isinstance(value, dict) else ()
    items = enumerate(value) if isinstance(value, list) else items
    for key, item in items:
        yield (*path, key)
        yield from paths(item, (*path, key))


def test_every_value_has_a_line_and_nothing_else_has():
    assert set(key_lines(DOCUMENT)) == set(paths(tomllib.loads(DOCUMENT)))


def test_lines_are_those_an_editor_shows():
    lines = key_lines(DOCUMENT)
    rows = DOCUMENT.splitlines()
    assert rows[lines["numbers", 1, 0] - 1] == "  [2, 3],"
    assert rows[lines["inline", "y", "z"] - 1].startswith("inline")
    assert rows[lines["table", "below", "key"] - 2] == "[table.below]"
    assert rows[lines["many", 1, "name"] - 1] == 'name = "b"'
    assert rows[lines["many", 1, "part", "deep"] - 1] == "deep = 1"
    assert lines["a", "b", "c"] == 3


def test_what_is_absent_is_placed_at_the_table_around_it():
    lines = key_lines(DOCUMENT)
    assert nearest_line(lines, ("many", 1, "absent")) == lines["many", 1]
    assert nearest_line(lines, ("absent",)) == 1


_TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\x7f"), max_size=6)
_VALUES = st.recursive(
    st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False) | _TEXTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_TEXTS, inner, max_size=3),
    max_leaves=8,
)
_TABLES = st.dictionaries(_TEXTS, _VALUES, max_size=4)


def written(value: object) -> str:
    """A value in TOML, arrays over several lines with comments that try to mislead."""
    if isinstance(value, dict):
        pairs = (f"{written(key)} = {written(item)}" for key, item in value.items())
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, list):
        return "[" + "".join(f" # ]\n{written(item)}," for item in value) + "\n]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False)


def assignments(table: dict[str, object]) -> str:
    return "".join(f"{written(key)} = {written(value)}\n" for key, value in table.items())


@given(_TABLES, _TABLES)
def test_every_value_of_any_document_is_found(top, row):
    top.pop("rows", None)
    text = f"{assignments(top)}[[rows]]\n{assignments(row)}[[rows]]\n{assignments(row)}"
    assert set(key_lines(text)) == set(paths(tomllib.loads(text)))
