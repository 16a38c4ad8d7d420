"""Samples that are not as stiff as the others: told, not rejected."""

from __future__ import annotations

import numpy as np
from scipy.stats import t

from calib.data.dataset import SampleData

RARE = 0.01
"""false alarm of a whole set of samples alike"""
FEWEST = 4
"""samples: of three, the two others hardly say how much samples differ"""


def odd_samples(samples: SampleData | None) -> list[str]:
    """A sentence for each sample whose forces are not the multiple that samples differ by.

    By its logarithm of the force, mean over the increments, against those of all others: Student's
    t of n - 2 degrees for one that takes no part in mean and SD (Barnett and Lewis 1994, chapter
    6), at a false alarm of `RARE` over all n samples.
    """
    if samples is None or len(samples.names) < FEWEST or not np.all(samples.force > 0.0):
        return []
    level = np.log(samples.force).mean(axis=1)
    n, said = len(level), []
    for i, name in enumerate(samples.names):
        others = np.delete(level, i)
        mean, sd = float(others.mean()), float(others.std(ddof=1))
        if sd == 0.0:
            continue
        p = 2.0 * float(t.sf(abs(level[i] - mean) / (sd * np.sqrt(1.0 + 1.0 / (n - 1))), n - 2))
        if p < RARE / n:
            said.append(
                f"sample {name} takes {np.exp(level[i] - mean):.2f} times the force of the others, "
                f"which differ by {sd:.0%} (p = {p:.2g}): of another material, size or unit?"
            )
    return said
