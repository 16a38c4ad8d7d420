"""Variables of a MATLAB file, version 5 or 7.3 (HDF5), as plain dicts, lists and arrays.

Sizes are checked before anything is read: a small damaged file may claim a large array.
"""

from __future__ import annotations

import math
import struct
import zlib
from pathlib import Path

import h5py
import numpy as np

from calib.data.readers import matlab5
from calib.data.readers.matlab5 import Value
from calib.data.readers.source import MAX_CELLS, Source
from calib.data.readers.wrong_file import WrongFile, shown

MAX_FILE_BYTES = 512_000_000
MAX_VARIABLE_BYTES = 8 * MAX_CELLS
MAX_DEPTH = 6
MAX_ITEMS = 100_000
_HDF5 = b"\x89HDF\r\n\x1a\n"


def is_matlab(source: Source) -> bool:
    """Whether the file begins as a MATLAB 5 or HDF5 file does."""
    return source.head.startswith((b"MATLAB 5.0", _HDF5)) or _HDF5 in source.head[512:520]


def variable_names(source: Source) -> set[str]:
    """Names of the variables in the file; empty where it is no MATLAB file or a damaged one."""
    if not is_matlab(source):
        return set()
    try:
        if source.head.startswith(b"MATLAB 5.0"):
            _check_size(source.path)
            return {name for name, _ in matlab5.variables(source.path.read_bytes())}
        with h5py.File(source.path, "r") as file:
            # a damaged name comes as bytes
            return {name for name in file if isinstance(name, str)}
    except Exception:
        # h5py does not say which exceptions a damaged file may raise
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
        # h5py does not say which exceptions a damaged file may raise
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
    start = next((start for known, start in matlab5.variables(data) if known == name), None)
    if start is None:
        raise WrongFile(path, None, f"a variable {name}", "none")
    order = matlab5.byte_order(data)
    kind, size = struct.unpack_from(f"{order}II", data, start)
    if kind == matlab5.MATRIX:
        return matlab5.decode(data[start : start + 8 + size], order, fields)
    inflater = zlib.decompressobj()
    variable = inflater.decompress(data[start + 8 : start + 8 + size], MAX_VARIABLE_BYTES)
    if inflater.unconsumed_tail:
        # a small file may swell to any size
        raise WrongFile(path, None, f"at most {MAX_VARIABLE_BYTES:,} bytes in a variable", "more")
    return matlab5.decode(variable, order, fields)
