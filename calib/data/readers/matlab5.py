"""Numbers, texts, cells and structs of a MATLAB 5 file, decoded without trusting its sizes.

SciPy's `loadmat` ends the process with a bus error on damaged files (found by damaging them, SciPy
1.17) and allocates what dimensions claim; the tests compare this decoder with what SciPy writes.
Layout: "MAT-File Format", MathWorks, level 5, tables 1-1 to 1-3.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

MAX_DEPTH = 12
_NAME_BYTES = 4096
COMPRESSED, MATRIX = 15, 14
_CELL, _STRUCT, _OBJECT, _CHAR = 1, 2, 3, 4
_NUMERIC = range(6, 16)
_COMPLEX = 0x0800
_NUMBERS = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
_TEXTS = {16: "utf-8", 17: "utf-16", 18: "utf-32"}

Value = Any
"""dict (struct), list (cell, or several structs), numpy array, str, or None for other classes"""


class _Element(NamedTuple):
    kind: int
    data: memoryview
    after: int
    """where the next element begins"""


def variables(data: bytes) -> Iterator[tuple[str, int]]:
    """Name of each variable, and where its element begins.

    Raises ValueError or struct.error for a damaged file.
    """
    order = byte_order(data)
    position = 128
    while position + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, position)
        if kind not in (COMPRESSED, MATRIX) or position + 8 + size > len(data):
            raise ValueError(f"a damaged variable at byte {position}")
        yield _name(data[position : position + 8 + size], order), position
        position += 8 + size


def byte_order(data: bytes) -> str:
    """Order of bytes for `struct`, from the mark in the head."""
    return "<" if data[126:128] == b"IM" else ">"


def decode(variable: bytes, order: str, fields: set[str]) -> Value:
    """Value of one uncompressed variable; of structs only these fields.

    Raises ValueError or struct.error where sizes do not fit the bytes there are.
    """
    element = _element(memoryview(variable), 0, order)
    return _value(element, order, fields, 0)


def _name(element: bytes, order: str) -> str:
    """Name of a variable, of which a compressed one is inflated only so far."""
    if struct.unpack_from(f"{order}I", element)[0] == COMPRESSED:
        element = zlib.decompressobj().decompress(element[8:], _NAME_BYTES)
    view = memoryview(element)
    position = 8
    for _ in range(2):  # flags and dimensions
        position = _element(view, position, order).after
    return bytes(_element(view, position, order).data).decode("ascii")


def _element(view: memoryview, position: int, order: str) -> _Element:
    """One element; small ones have size, type and data in eight bytes."""
    kind, size = struct.unpack_from(f"{order}II", view, position)
    start = position + 8
    if kind >> 16:
        start, size, kind = position + 4, kind >> 16, kind & 0xFFFF
        if size > 4:
            raise ValueError(f"a small element of {size} bytes")
    if start + size > len(view):
        raise ValueError(f"an element of {size} bytes where {len(view) - start} are left")
    after = -(-(start + size) // 8) * 8
    return _Element(kind, view[start : start + size], after)


def _value(element: _Element, order: str, fields: set[str], depth: int) -> Value:
    if element.kind != MATRIX or depth > MAX_DEPTH:
        raise ValueError("a matrix was expected")
    view = element.data
    if len(view) == 0:
        return np.zeros((0, 0))  # an empty array is a bare tag
    flags = _element(view, 0, order)
    (word,) = struct.unpack_from(f"{order}I", flags.data)
    array_class = word & 0xFF
    if array_class not in (_CELL, _STRUCT, _OBJECT, _CHAR, *_NUMERIC):
        return None  # sparse arrays, functions and objects of classes are none of ours
    dimensions = _element(view, flags.after, order)
    shape = struct.unpack(f"{order}{len(dimensions.data) // 4}i", dimensions.data)
    if not 2 <= len(shape) <= 32 or min(shape) < 0 or math.prod(shape) > len(view):
        raise ValueError(f"an array of {shape} in {len(view)} bytes")
    position = _element(view, dimensions.after, order).after  # behind the name
    if array_class == _CELL:
        return list(_items(view, position, math.prod(shape), order, fields, depth))
    if array_class in (_STRUCT, _OBJECT):
        if array_class == _OBJECT:
            position = _element(view, position, order).after  # name of the class
        return _structs(view, position, math.prod(shape), order, fields, depth)
    part = _element(view, position, order)
    if array_class == _CHAR:
        return _text(part, order)
    if word & _COMPLEX or part.kind not in _NUMBERS:
        raise ValueError("real numbers were expected")
    numbers = np.frombuffer(part.data, np.dtype(f"{order}{_NUMBERS[part.kind]}"))
    return numbers.reshape(shape, order="F").astype(np.float64)


def _items(
    view: memoryview, position: int, n: int, order: str, fields: set[str], depth: int
) -> Iterator[Value]:
    for _ in range(n):
        item = _element(view, position, order)
        yield _value(item, order, fields, depth + 1)
        position = item.after


def _structs(
    view: memoryview, position: int, n: int, order: str, fields: set[str], depth: int
) -> Value:
    """One dict, or a list of n."""
    width = _element(view, position, order)
    (length,) = struct.unpack_from(f"{order}i", width.data)
    table = _element(view, width.after, order)
    if length < 1:
        raise ValueError(f"names of {length} characters")
    text = bytes(table.data)
    names = [
        text[start : start + length].split(b"\0")[0].decode("ascii")
        for start in range(0, len(text), length)
    ]
    position = table.after
    found: list[dict[str, Value]] = []
    if not names:
        return {} if n == 1 else found
    for _ in range(n):
        values: dict[str, Value] = {}
        for name in names:
            item = _element(view, position, order)
            if name in fields:
                values[name] = _value(item, order, fields, depth + 1)
            position = item.after
        found.append(values)
    return found[0] if n == 1 else found


def _text(part: _Element, order: str) -> str:
    if part.kind in _TEXTS:
        return bytes(part.data).decode(_TEXTS[part.kind])
    if part.kind not in _NUMBERS or _NUMBERS[part.kind][0] != "u":
        raise ValueError("characters were expected")
    codes = np.frombuffer(part.data, np.dtype(f"{order}{_NUMBERS[part.kind]}"))
    return "".join(map(chr, codes.tolist()))
