"""A disk that was full while HDF5 wrote."""

from __future__ import annotations


class DiskFullError(OSError):
    """After it HDF5 may crash the process as that ends, so that one leaves it by `os._exit`."""
