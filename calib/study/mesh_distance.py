"""How far a posterior lies from where the error of its mesh was measured.

The correction of the mesh is carried on from the last check by derivatives of the meshes'
difference: far from there it is a guess.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.response import Array

FAR = 3.0
"""posterior SDs of the mean from the last check, beyond which the mesh is checked again"""
NEAR = 0.1
"""share of the design's box, likewise"""


def too_far(off: Array, sd: Array, extent: Array) -> npt.NDArray[np.bool_]:
    """(d,) whether the mean lies too far from a check: `off` (d,), posterior `sd` (d,).

    `extent` (d,) is that of the design's box.
    """
    found: npt.NDArray[np.bool_] = np.abs(off) > np.minimum(FAR * sd, NEAR * extent)
    return found


def unsettled(place: Array, mean: Array, sd: Array, extent: Array, names: tuple[str, ...]) -> str:
    """A sentence for the reader where the mean (d,) is too far from the last check at `place`.

    Empty where it is near. `names` (d,) are those of the ratios and further unknowns.
    """
    off = mean - place
    if not too_far(off, sd, extent).any():
        return ""
    worst = int(np.argmax(np.abs(off) / np.minimum(FAR * sd, NEAR * extent)))
    return (
        f"mesh: its error was last measured at {names[worst]} = {place[worst]:.3g}, "
        f"{abs(off[worst]) / sd[worst]:.1f} SD from the posterior mean {mean[worst]:.3g}, and may "
        "be another one there; a finer mesh.sampling needs less of a correction"
    )
