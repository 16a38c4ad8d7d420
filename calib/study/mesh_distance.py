"""How far a posterior lies from where the error of its mesh was measured.

The correction of the mesh is carried on from the last check by derivatives of the meshes'
difference: far from there it is a guess.
"""

from __future__ import annotations

import numpy as np

from fe.response import Array

FAR = 3.0
"""posterior SDs of the mean from the last check, beyond which the mesh is checked again"""
NEAR = 0.1
"""share of the design's box, likewise"""


def distance(off: Array, sd: Array, extent: Array) -> Array:
    """(d,) how far the mean lies from a check, as shares of what is near: above 1 is too far.

    `off` (d,) is mean minus place, `sd` (d,) the posterior's, `extent` (d,) that of the design's
    box.
    """
    found: Array = np.abs(off) / np.minimum(FAR * sd, NEAR * extent)
    return found


def distance_sentence(
    place: Array, mean: Array, sd: Array, extent: Array, names: tuple[str, ...]
) -> str:
    """What the reader is told where the mean (d,) is too far from the last check at `place`.

    Empty where it is near. `names` (d,) are those of the ratios and further unknowns.
    """
    shares = distance(mean - place, sd, extent)
    worst = int(np.argmax(shares))
    if not shares[worst] > 1.0:
        return ""
    off, name = abs(mean[worst] - place[worst]), names[worst]
    by_sd = FAR * sd[worst] < NEAR * extent[worst]
    limit = f"{FAR:g} posterior SDs" if by_sd else f"{NEAR:.0%} of the prior's range"
    return (
        f"Its mesh was last checked at {name} = {place[worst]:.3g}, {off:.2g} from the posterior "
        f"mean: more than {limit}, so that the correction of the mesh is a guess there and {name} "
        "may be off by about as much. A finer sampling mesh needs less of a correction."
    )
