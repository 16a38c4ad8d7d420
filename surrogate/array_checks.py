"""The check of the arrays that a fitted part is made of."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


def check_arrays(fitted: object, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Raise ValueError for an attribute of another shape than given for its name, or not finite."""
    for name, shape in shapes.items():
        found = getattr(fitted, name)
        if found.shape != shape:
            raise ValueError(f"{name}: expected shape {shape}, got {found.shape}")
        if not np.isfinite(found).all():
            raise ValueError(f"{name}: expected finite numbers, found others")
