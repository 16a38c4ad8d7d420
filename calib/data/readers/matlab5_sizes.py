"""Whether the arrays of a MATLAB 5 variable claim no more items than they have bytes.

SciPy allocates what the dimensions claim before it reads; a damaged file of a few bytes could
claim any amount.  Layout: "MAT-File Format", MathWorks, level 5, tables 1-1 to 1-3.
"""

from __future__ import annotations

import math
import struct

_MATRIX = 14
_CELL, _STRUCT, _OBJECT, _SPARSE, _LARGEST_CLASS = 1, 2, 3, 5, 15
MAX_DEPTH = 12


def is_credible(element: bytes, order: str, depth: int = 0) -> bool:
    """Check one miMATRIX element and all within it; `order` is "<" or ">".

    Raises struct.error where the element is cut short.
    """
    kind, start, end = _tag(element, 0, order)
    if kind != _MATRIX or depth > MAX_DEPTH or end > len(element):
        return False
    if end == start:
        return True  # an empty array is a bare tag
    _, flags, position = _tag(element, start, order)
    array_class = struct.unpack_from(f"{order}I", element, flags)[0] & 0xFF
    if array_class > _LARGEST_CLASS:
        # functions and objects of classes, as Ncorr's regions of interest: texts and matrices
        return _children(element[:end], _padded(position), order, depth)
    if array_class == _SPARSE:
        return False  # in none of our files
    _, dimensions, after = _tag(element, _padded(position), order)
    count = (after - dimensions) // 4
    shape = struct.unpack_from(f"{order}{count}i", element, dimensions)
    if count > 32 or min(shape, default=0) < 0 or math.prod(shape) > end - start:
        return False
    if array_class not in (_CELL, _STRUCT, _OBJECT):
        return True
    _, _, position = _tag(element, _padded(after), order)  # name
    if array_class != _CELL:
        for _ in range(3 if array_class == _OBJECT else 2):  # class name, name length, names
            _, _, position = _tag(element, _padded(position), order)
    return _children(element[:end], _padded(position), order, depth)


def _children(element: bytes, position: int, order: str, depth: int) -> bool:
    """Whether all matrices from `position` on are credible."""
    while position + 8 <= len(element):
        kind, _, end = _tag(element, position, order)
        if kind == _MATRIX and not is_credible(element[position:end], order, depth + 1):
            return False
        position = _padded(end)
    return True


def _tag(element: bytes, position: int, order: str) -> tuple[int, int, int]:
    """Type of an element, and where its data begin and end."""
    kind, size = struct.unpack_from(f"{order}II", element, position)
    if kind >> 16:  # small elements have size, type and data in eight bytes
        return kind & 0xFFFF, position + 4, position + 4 + (kind >> 16)
    return kind, position + 8, position + 8 + size


def _padded(position: int) -> int:
    """Elements begin at multiples of eight bytes."""
    return -(-position // 8) * 8
