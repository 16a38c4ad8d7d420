"""Shape functions away from the centre of their subset."""

from __future__ import annotations

from calib.dic.interpolation import Array


def carried(parameters: Array, offset: Array) -> Array:
    """Parameters (m, 12) of shape functions, taken to points at offset (m, 2) px."""
    a, b = offset[:, 0], offset[:, 1]
    out = parameters.copy()
    for k in range(2):
        first = parameters[:, 2 + 2 * k : 4 + 2 * k].T
        second = parameters[:, 6 + 3 * k : 9 + 3 * k].T
        out[:, k] += first[0] * a + first[1] * b
        out[:, k] += 0.5 * second[0] * a**2 + second[1] * a * b + 0.5 * second[2] * b**2
        out[:, 2 + 2 * k] += second[0] * a + second[1] * b
        out[:, 3 + 2 * k] += second[1] * a + second[2] * b
    return out
