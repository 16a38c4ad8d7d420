"""Variables of a MATLAB file, version 5 (SciPy) or 7.3 (HDF5), as plain dicts, lists and arrays.

Sizes are checked before anything is read: a small damaged file may claim a large array.
"""

from __future__ import annotations

import io
import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np
import scipy.io

from calib.data.readers.matlab5_sizes import is_credible
from calib.data.readers.source import MAX_CELLS, Source
from calib.data.readers.wrong_file import WrongFile, shown

MAX_FILE_BYTES = 512_000_000
MAX_VARIABLE_BYTES = 8 * MAX_CELLS
MAX_DEPTH = 6
MAX_ITEMS = 100_000
_HDF5 = b"\x89HDF\r\n\x1a\n"
_COMPRESSED, _MATRIX = 15, 14
_NAME_BYTES = 4096

Value = Any
"""dict (struct), list (cell or array of structs), numpy array, or str"""


def is_matlab(source: Source) -> bool:
    """Whether the file begins as a MATLAB 5 or HDF5 file does."""
    return source.head.startswith((b"MATLAB 5.0", _HDF5)) or _HDF5 in source.head[512:520]


def variable_names(source: Source) -> set[str]:
    """Names of the variables in the file; empty where it is no MATLAB file or a damaged one."""
    if not is_matlab(source):
        return set()
    try:
        if source.head.startswith(b"MATLAB 5.0"):
            return {name for name, _ in _elements(source.path)}
        with h5py.File(source.path, "r") as file:
            return set(file.keys())
    except Exception:
        # neither library says which exceptions a damaged file may raise
        return set()


def read_variable(source: Source, name: str, fields: set[str]) -> Value:
    """One variable; of its structs only these fields.

    Raises WrongFile where the file is damaged, too large, or without that variable.
    """
    path = source.path
    try:
        _check_size(path)
        if source.head.startswith(b"MATLAB 5.0"):
            return _version_5(path, name, fields)
        with h5py.File(path, "r") as file:
            return _Hdf5Reader(path, file, fields).value(file[name], 0)
    except WrongFile:
        raise
    except (Exception, MemoryError) as error:
        # neither library says which exceptions a damaged file may raise
        reason = shown(str(error).splitlines()[0] if str(error) else type(error).__name__)
        raise WrongFile(path, None, f"an intact MATLAB file with {name}", reason) from error


class _Hdf5Reader:
    """Follows the references of one open file, counting the values it takes."""

    def __init__(self, path: Path, file: h5py.File, fields: set[str]) -> None:
        self.path = path
        self.file = file
        self.fields = fields
        self.n_values = 0
        self.n_items = 0

    def value(self, node: h5py.Group | h5py.Dataset, depth: int) -> Value:
        self.n_items += 1
        if depth > MAX_DEPTH or self.n_items > MAX_ITEMS:
            raise WrongFile(self.path, None, f"at most {MAX_DEPTH} nested structs", "more")
        if isinstance(node, h5py.Group):
            wanted = [name for name in node if name in self.fields]
            return {name: self.value(node[name], depth + 1) for name in wanted}
        is_reference = h5py.check_ref_dtype(node.dtype) is not None
        if node.dtype.kind not in "fiub" and not is_reference:
            raise WrongFile(self.path, None, "numbers, texts, cells or structs", f"{node.dtype}")
        self.n_values += max(int(node.size or 0), math.prod(node.chunks or ()))
        if self.n_values > MAX_CELLS:
            raise WrongFile(self.path, None, f"at most {MAX_CELLS:,} values", f"{self.n_values:,}")
        array = np.asarray(node[()])
        if is_reference:
            return [self.value(self.file[ref], depth + 1) for ref in array.T.ravel(order="F")]
        if node.attrs.get("MATLAB_class") == b"char":
            return "".join(chr(code) for code in array.T.ravel())
        if node.attrs.get("MATLAB_empty"):
            return np.zeros((0, 0))
        return array.T


def _check_size(path: Path) -> None:
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise WrongFile(path, None, f"at most {MAX_FILE_BYTES:,} bytes", f"{size:,}")


def _version_5(path: Path, name: str, fields: set[str]) -> Value:
    data = path.read_bytes()
    element = next((start for known, start in _elements(path) if known == name), None)
    if element is None:
        raise WrongFile(path, None, f"a variable {name}", "none")
    variable = _inflated(path, data, element)
    if not is_credible(variable, _order(data)):
        raise WrongFile(path, None, f"arrays as large as their bytes in {name}", "larger ones")
    plain = io.BytesIO(data[:128] + variable)
    found = scipy.io.loadmat(cast("Any", plain))
    if name not in found:
        raise WrongFile(path, None, f"a variable {name}", "none that can be read")
    return _plain(found[name], fields, 0)


def _elements(path: Path) -> Iterator[tuple[str, int]]:
    """Name and position of each variable ("MAT-File Format", MathWorks, level 5)."""
    _check_size(path)
    data = path.read_bytes()
    position = 128
    while position + 8 <= len(data):
        kind, size = struct.unpack_from(f"{_order(data)}II", data, position)
        if kind not in (_COMPRESSED, _MATRIX) or position + 8 + size > len(data):
            raise WrongFile(path, None, "whole MATLAB variables", f"a damaged one at {position}")
        start = data[position + 8 : position + 8 + min(size, _NAME_BYTES)]
        if kind == _COMPRESSED:
            start = zlib.decompressobj().decompress(start, _NAME_BYTES)[8:]
        yield _name(start, _order(data)), position
        position += 8 + size


def _name(start: bytes, order: str) -> str:
    """Array flags and dimensions come first, then the name, short ones within their tag."""
    n_dimension_bytes = struct.unpack_from(f"{order}I", start, 20)[0]
    tag = 24 + -(-n_dimension_bytes // 8) * 8
    kind = struct.unpack_from(f"{order}I", start, tag)[0]
    if kind >> 16:
        return start[tag + 4 : tag + 4 + (kind >> 16)].decode("ascii")
    size = struct.unpack_from(f"{order}I", start, tag + 4)[0]
    return start[tag + 8 : tag + 8 + size].decode("ascii")


def _inflated(path: Path, data: bytes, position: int) -> bytes:
    """One element without compression, within bounds, so that it is no bomb."""
    kind, size = struct.unpack_from(f"{_order(data)}II", data, position)
    if kind == _MATRIX:
        return data[position : position + 8 + size]
    inflater = zlib.decompressobj()
    element = inflater.decompress(data[position + 8 : position + 8 + size], MAX_VARIABLE_BYTES)
    if inflater.unconsumed_tail:
        raise WrongFile(path, None, f"at most {MAX_VARIABLE_BYTES:,} bytes in a variable", "more")
    return element


def _order(data: bytes) -> str:
    return "<" if data[126:128] == b"IM" else ">"


def _plain(value: Value, fields: set[str], depth: int) -> Value:
    """SciPy's object arrays as lists and dicts."""
    if depth > 2 * MAX_DEPTH or not isinstance(value, np.ndarray):
        return value
    if value.dtype.names is not None:
        wanted = [name for name in value.dtype.names if name in fields]
        structs = [
            {name: _plain(item[name], fields, depth + 1) for name in wanted}
            for item in value.ravel(order="F")
        ]
        return structs[0] if len(structs) == 1 else structs
    if value.dtype.kind == "O":
        return [_plain(item, fields, depth + 1) for item in value.ravel(order="F")]
    if value.dtype.kind in "US":
        return "".join(str(part) for part in value.ravel())
    return value
