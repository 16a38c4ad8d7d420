"""The small displacement field that the sample files of the readers hold."""

from __future__ import annotations

import numpy as np

N_ROWS, N_COLUMNS = 4, 5
MM_PER_PX = 0.01


def grid() -> tuple[np.ndarray, np.ndarray]:
    """Positions (20, 3) and displacements (20, 3) of a small field, mm, row after row upwards."""
    y, x = np.indices((N_ROWS, N_COLUMNS)).reshape(2, -1) * 0.5
    position = np.column_stack([x + 0.25, y + 0.25, 0.125 * x])
    displacement = np.column_stack([0.01 * x + 0.001, -0.02 * y - 0.002, 0.003 + 0.001 * x * y])
    return position, displacement
