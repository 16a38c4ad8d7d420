"""Where every key of a TOML document stands, so that a refusal can name the line.

`tomllib` gives values without positions. This scanner reads a document that `tomllib` has already
accepted and therefore checks nothing: it only follows headers, keys, arrays and inline tables.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import NamedTuple

Path = tuple[str | int, ...]
"""where a value stands: keys, and indices into arrays, from the top of the document"""

_TOKEN = re.compile(
    r'''
      (?P<string> """(?:\\.|[^\\])*?"""(?:"{0,2}) | \'\'\'.*?\'\'\'(?:\'{0,2})
                | "(?:\\.|[^"\\\n])*" | '[^'\n]*' )
    | (?P<comment> \#[^\n]* )
    | (?P<newline> \n )
    | (?P<space> [ \t\r]+ )
    | (?P<mark> [\[\]{}=,.] )
    | (?P<bare> [^\s\[\]{}=,.\#"']+ )
    ''',
    re.VERBOSE | re.DOTALL,
)


class _Token(NamedTuple):
    kind: str
    text: str
    line: int


def key_lines(text: str) -> dict[Path, int]:
    """Line, from 1, on which each key, table and array element of a valid TOML `text` begins."""
    return _Scanner(text).document()


def nearest_line(lines: Mapping[Path, int], path: Path) -> int:
    """Line of `path`, or of the closest table around it that is in the document, or 1."""
    for length in range(len(path), 0, -1):
        if path[:length] in lines:
            return lines[path[:length]]
    return 1


def _tokens(text: str) -> Iterator[_Token]:
    line = 1
    for match in _TOKEN.finditer(text):
        kind = match.lastgroup or ""
        if kind not in {"space", "comment"}:
            yield _Token(kind, match.group(), line)
        line += match.group().count("\n")
    yield _Token("end", "", line)


class _Scanner:
    """Reads tokens from left to right and notes the line of every path it meets."""

    def __init__(self, text: str) -> None:
        self.tokens = list(_tokens(text))
        self.position = 0
        self.lines: dict[Path, int] = {}
        self.n_tables: dict[Path, int] = {}

    def document(self) -> dict[Path, int]:
        table: Path = ()
        while self.next.kind != "end":
            if self.next.kind == "newline":
                self.advance()
            elif self.next.text == "[":
                table = self.header()
            else:
                self.assignment(table)
        return self.lines

    @property
    def next(self) -> _Token:
        return self.tokens[self.position]

    def advance(self) -> _Token:
        token = self.next
        self.position += 1
        return token

    def header(self) -> Path:
        """`[a.b]` or `[[a.b]]`: the table that the following keys belong to."""
        line = self.advance().line
        is_array = self.next.text == "["
        if is_array:
            self.advance()
        keys = self.keys(until="]")
        if is_array:
            self.advance()
        table: Path = ()
        for key in keys[:-1]:
            table = self.latest((*table, key))
            self.lines.setdefault(table, line)
        table = (*table, keys[-1])
        if not is_array:
            table = self.latest(table)
            self.lines[table] = line
            return table
        index = self.n_tables.get(table, 0)
        self.n_tables[table] = index + 1
        self.lines.setdefault(table, line)
        self.lines[*table, index] = line
        return (*table, index)

    def latest(self, table: Path) -> Path:
        """A header below an array of tables means the array's latest table."""
        return (*table, self.n_tables[table] - 1) if table in self.n_tables else table

    def assignment(self, table: Path) -> None:
        line = self.next.line
        path = table
        for key in self.keys(until="="):
            path = (*path, key)
            self.lines.setdefault(path, line)
        self.value(path)

    def keys(self, until: str) -> list[str]:
        """Dotted key up to and with the closing mark."""
        keys = []
        while (token := self.advance()).text != until:
            if token.kind == "string":
                keys.append(str(tomllib.loads(f"key = {token.text}")["key"]))
            elif token.kind == "bare":
                keys.append(token.text)
        return keys

    def value(self, path: Path) -> None:
        if self.next.text == "[":
            self.array(path)
        elif self.next.text == "{":
            self.inline_table(path)
        else:
            while self.next.kind in {"string", "bare"} or self.next.text == ".":
                self.advance()

    def array(self, path: Path) -> None:
        self.advance()
        index = 0
        while self.next.text != "]":
            if self.next.kind == "newline" or self.next.text == ",":
                self.advance()
                continue
            self.lines[*path, index] = self.next.line
            self.value((*path, index))
            index += 1
        self.advance()

    def inline_table(self, path: Path) -> None:
        self.advance()
        while self.next.text != "}":
            if self.next.kind == "newline" or self.next.text == ",":
                self.advance()
            else:
                self.assignment(path)
        self.advance()
