"""What the reader is told of the mesh beside a posterior: what it errs by, where it was checked.

The correction of the mesh is carried on from the last check by derivatives of the meshes'
difference: far from there it is a guess.
"""

from __future__ import annotations

import numpy as np

from calib.inference.tangent_errors import Mistaken
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


def errors_sentence(found: Mistaken, names: tuple[str, ...], units: tuple[str, ...]) -> str:
    """By how much the field's mesh error may move each constant, `names` (d,), and nuisance.

    `units` (q,) are those of the nuisances.
    """
    moved = [f"{name} by {sd:.2g}" for name, sd in zip(names, found.ratios, strict=True)]
    sd = np.sqrt(np.diag(found.nuisances))
    nuisances = zip(found.names, sd, units, strict=True)
    moved += [
        f"the {name} by {size:.2g} {unit}".removesuffix(" 1") for name, size, unit in nuisances
    ]
    return (
        "What is left of the mesh's error in the field is stated to move, as SDs that are part of "
        f"those above, {' and '.join(filter(None, (', '.join(moved[:-1]), moved[-1])))}."
    )
