"""Which runs a look at the posterior asks for: at its mean, in its box, or where they tell most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.study.judgement import Noise
from calib.study.local_design import (
    MOST_BOXES,
    MOST_CUT,
    MOST_LOST,
    box_of,
    is_small,
    local_points,
    mass_beyond,
)
from calib.study.mesh_remarks import distance
from calib.study.refine_rounds import Loop, Round
from calib.study.refinement import Outlook
from fe.response import Array

MOST_CHECKS = 4
"""posterior means at which the mesh is checked before the last, for data with a field"""
SETTLED = 0.5
"""share of what is far from the last check by which the mean may be off it when the loop ends:
beyond, the last check would move the mean, and nothing would look at where to"""
BATCH = 2
"""runs of one round: each is chosen knowing where the others of its round are, not what they say"""


@dataclass(frozen=True)
class Choice:
    """What a study allows."""

    design: Array
    """(n, d) training runs over the whole box"""
    box: Array
    """(d, 2) of the design"""
    noise: Noise
    n_refine: int
    """most runs one by one, the last one at the mean included"""
    n_local: int
    """runs of a second design; 0: none is made"""
    seed: int
    most_checks: int = MOST_CHECKS
    """posterior means at which the mesh is checked before the last; 1: where there is one mesh"""

    def next_runs(self, loop: Loop, found: Outlook, rng: np.random.Generator) -> Loop:
        """The loop with the runs that `found` asks for.

        First one at the mean; again one at the mean while that is far from where the mesh was
        checked, which moves it; then a second design, where the posterior's box is small, and
        another one where that turns out to hold too little of the posterior, and none where the
        last one does; then where runs take most variance away until the mean rests or there are
        enough; at the end one at the mean, which is not the last one while the mean is some way off
        where the mesh was checked.
        """
        beyond = 0.0 if loop.box is None else mass_beyond(found.quadrature, loop.box, self.box)
        first, moved = not len(loop.ratios), box_of(found.quadrature, self.box)
        left = loop.n_boxes < MOST_BOXES
        if loop.box is None:
            moves = left and not first and self.n_local > 0 and is_small(moved, self.box)
        else:
            moves = left and beyond > MOST_CUT
        n = len(loop.ratios)
        if beyond > MOST_LOST and not left:
            added, after = found.mean[None], replace(loop, box=None)
        elif first or self._is_far(loop, found):
            added, after = found.mean[None], replace(loop, checked=(*loop.checked, n))
        elif moves:
            added = local_points(moved, self.n_local, self.seed + 1 + loop.n_boxes)
            places = tuple(range(n, n + len(added)))
            after = replace(loop, box=moved, n_boxes=loop.n_boxes + 1, local=(*loop.local, *places))
        else:
            added, last = self._one_by_one(loop, found, rng)
            checked = (*loop.checked, n) if last else loop.checked
            settled = last and not self._is_far(loop, found, SETTLED)
            after = replace(loop, done=settled, checked=checked)
        return replace(
            after,
            ratios=np.concatenate([loop.ratios, added]),
            rounds=(*loop.rounds, _facts(found, loop, len(added), beyond)),
            emulators=(*loop.emulators, found.emulator),
        )

    def _is_far(self, loop: Loop, found: Outlook, share: float = 1.0) -> bool:
        """Whether the mesh is to be checked at the mean before anything else.

        `share` of the distance counts as far.
        """
        if self.noise.field is None or len(loop.checked) >= self.most_checks:
            return False
        off = found.mean - loop.ratios[loop.checked[-1]]
        sd = found.quadrature.sd[1 : 1 + len(off)]
        return bool((distance(off, sd, np.ptp(self.box, axis=1)) > share).any())

    def _one_by_one(
        self, loop: Loop, found: Outlook, rng: np.random.Generator
    ) -> tuple[Array, bool]:
        """Runs where they tell most, or one at the mean; whether it is the last."""
        # The first run at the mean counts, those for further checks of the mesh do not; the last is
        # at the mean.
        n_own = len(loop.ratios) - len(loop.local) - (len(loop.checked) - 1)
        n_left = self.n_refine - n_own - 1
        if found.shift.is_small or n_left < 1:
            return found.mean[None], True
        # Of second designs that hold no posterior the emulator does not learn.
        known = np.delete(loop.ratios, loop.local, axis=0) if loop.box is None else loop.ratios
        runs = np.concatenate([self.design, known])
        proposed = found.proposals(min(BATCH, n_left), runs, self.noise, rng)
        return (proposed, False) if len(proposed) else (found.mean[None], True)


def _facts(found: Outlook, loop: Loop, n_added: int, beyond: float) -> Round:
    return Round(
        n_train=found.emulator.header.n_train,
        predicted_shift=found.shift.shift,
        n_added=n_added,
        x=("ln kappa", *found.quadrature.space.x_names[1:]),
        by_processes=found.foretold.shift,
        by_stated=found.seen.stated,
        by_runs=found.seen.seen,
        sd_ratio=found.seen.sd_ratio,
        box=loop.box,
        mass_beyond=beyond,
    )
