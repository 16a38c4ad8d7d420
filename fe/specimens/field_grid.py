"""Field points of a face: how many of them, or where they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fe.positive_numbers import as_numbers
from fe.specimens.checks import check_counts, keep_counts

Array = npt.NDArray[np.float64]

FieldGrid = tuple[int, int] | tuple[tuple[float, float], ...]
"""numbers of field points along x and y of the modelled part of the front face (of half of it,
where more is modelled of a block), or their own x, y in mm"""


def own_points(grid: FieldGrid) -> Array | None:
    """(n_point, 2) x, y of the points where the grid is these, mm; None where it is two counts.

    Raises ValueError for what is neither.
    """
    found = as_numbers(grid)
    if found is not None and found.ndim == 1:
        check_counts("field_grid", grid, (1, 1))
        return None
    if found is None or found.ndim != 2 or found.shape[1] != 2 or not np.isfinite(found).all():
        what = repr(grid) if found is None else f"shape {found.shape}"
        raise ValueError(f"field_grid: expected points (x, y) in mm, or two counts, found {what}")
    return found


def keep_field_grid(model: Any) -> None:
    """Make a frozen model's `field_grid` a tuple of ints or of points, which does not change.

    Raises ValueError as `own_points` does.
    """
    found = own_points(model.field_grid)
    if found is None:
        keep_counts(model, "field_grid", (1, 1))
    else:
        object.__setattr__(model, "field_grid", tuple((x, y) for x, y in found.tolist()))
