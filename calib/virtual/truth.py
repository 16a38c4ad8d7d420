"""The truth of a virtual laboratory: material, block, contact, and what the model says they do."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from calib.code_hash import code_hash
from calib.virtual.front_response import SAME, FrontResponse, load_front, save_front, solve_front
from calib.virtual.smooth_front import smoothed
from fe.contact import PenaltyLaw
from fe.fingerprint import canonical_json, fingerprint
from fe.response import Array
from fe.specimens.block_pin import BlockPin, BlockPinModel, Contact

EDGE = 2.5
"""mm from the pin's axis: within it the field goes with the pin, beyond it the block is stretched
or shortened to its sides"""


@dataclass(frozen=True)
class BlockTruth:
    """What is pressed, and on which meshes its response is computed.

    The field of a shifted pin is that of the fine quarter model plus the change that a coarser half
    model shows for a shift of `shift_solved`. Raises ValueError for impossible numbers, and for
    a pin that is no straight bar in the middle.
    """

    C10: float = 0.00518
    """MPa"""
    C01: float = 0.00345
    """MPa"""
    C11: float = 0.0
    """MPa"""
    specimen: BlockPin = field(default_factory=BlockPin)
    contact: Contact = field(default_factory=lambda: Contact(0.15, 0.15))
    cells: tuple[int, int, int] = (18, 6, 3)
    """Q2 elements of a quarter along x, y, z: finer than the meshes that are fitted"""
    stiffening: float = 8.0
    """how many times less the pin gives way than in models by default: a rigid one does not"""
    shift_cells: tuple[int, int, int] | None = (12, 4, 2)
    """of the half model with a shifted pin, or None: the field goes with the pin unchanged"""
    shift_solved: float = 0.4
    """mm"""
    travel: tuple[float, ...] = tuple(round(0.05 * n, 2) for n in range(1, 37))
    """at which the response is kept, mm: closer than the holds, so that no curve through a few of
    these travels is what a curve through the holds is held against"""
    fine_travel: float = 1.8
    """mm, beyond which the fine model is continued by the changes of the coarser one, where it does
    not reach all travels"""
    smooth: bool = True
    """whether fields are splines through the elements' (`smooth_front`): shape functions leave the
    marks of a mesh"""

    def __post_init__(self) -> None:
        if not (self.C10 + self.C01 > 0.0 and np.isfinite(self.C11)):
            raise ValueError(
                f"C10, C01, C11: expected C10 + C01 above 0 MPa and finite C11, "
                f"found {self.C10}, {self.C01}, {self.C11}"
            )
        block = self.specimen
        if block.pin != "bar" or any(block.pin_shift) or block.pin_rotation != 0.0:
            raise ValueError(
                "specimen: expected a straight bar in the middle, as shifts and angles of samples "
                f"are drawn by themselves, found a pin {block.pin} shifted by {block.pin_shift} mm "
                f"and turned by {block.pin_rotation} degrees"
            )
        room = block.width / 2.0 - EDGE
        if self.shift_cells is not None and not 0.0 < self.shift_solved < room:
            raise ValueError(
                f"shift_solved: expected a shift above 0 and below {room:g} mm, half the width of "
                f"{block.width:g} mm less {EDGE:g} mm, found {self.shift_solved} mm"
            )

    @property
    def kappa(self) -> float:
        """C10 + C01, MPa."""
        return self.C10 + self.C01

    @property
    def ratios(self) -> Array:
        """(r, s) = (C01, C11) / kappa."""
        return np.array([self.C01, self.C11]) / self.kappa

    def model(self) -> BlockPinModel:
        """The fine quarter model."""
        is_whole = self.shift_cells is None
        travel = tuple(d for d in self.travel if is_whole or d <= self.fine_travel)
        penalty = PenaltyLaw().stiffened(self.stiffening)
        return BlockPinModel(
            self.specimen, self.contact, self.cells, travel, penalty=penalty, sensitivities=()
        )

    def shift_models(self) -> tuple[BlockPinModel, ...]:
        """The coarser models without and with a shift; none where the field just goes along."""
        if self.shift_cells is None:
            return ()
        still = replace(self.model(), cells=self.shift_cells, travel=self.travel)
        shifted = replace(self.specimen, pin_shift=(self.shift_solved, 0.0))
        return still, replace(still, specimen=shifted)


@dataclass(frozen=True)
class ShiftedFields:
    """Responses of coarser models, for what a shift of the pin changes."""

    still: FrontResponse
    shifted: FrontResponse
    shift: float
    """mm"""


@dataclass(frozen=True)
class TruthResponse:
    """Force and front-face field of the truth at any point, travel, shift and stiffness."""

    truth: BlockTruth
    fine: FrontResponse
    """at kappa = 1 MPa"""
    shifts: ShiftedFields | None = None

    def force_at(self, travel: Array, stiffness: float = 1.0) -> Array:
        """Force at rest, N, of a sample that is `stiffness` times as stiff; travels in mm.

        A shift of the pin changes it by about one per cent at 0.4 mm, which is left out.
        """
        return stiffness * self.truth.kappa * self.fine.force_at(travel)

    def field_at(self, points: Array, travel: Array, shift: float = 0.0) -> Array:
        """(n_travel, n_point, 3) displacement at points (n_point, 2) of the face, mm.

        Points are counted from the block's centre; the pin stands at x = `shift`. The field goes
        with the pin, and what the nearness of a side changes is a parabola in the shift through
        the fields at -`shift_solved`, 0 and `shift_solved`. Raises ValueError for a shift that
        leaves no room beside the pin's edge.
        """
        half = self.truth.specimen.width / 2.0
        if abs(shift) >= half - EDGE:
            raise ValueError(
                f"shift: expected less than {half - EDGE:g} mm, half the width less {EDGE:g} mm, "
                f"found {shift:g} mm"
            )
        centred = points.copy()
        centred[:, 0] = pin_at_centre(points[:, 0], shift, half)
        found = self.fine.field_at(centred, travel)
        if self.shifts is None or shift == 0.0:
            return found
        to, back = self._change(centred, travel, half), self._mirrored(centred, travel, half)
        share = shift / self.shifts.shift
        return found + 0.5 * share * (share + 1.0) * to + 0.5 * share * (share - 1.0) * back

    def _change(self, centred: Array, travel: Array, half: float) -> Array:
        """What the solved shift changes at points given as for a pin at the centre."""
        assert self.shifts is not None
        moved = centred.copy()
        moved[:, 0] = pin_shifted(centred[:, 0], self.shifts.shift, half)
        shifted = self.shifts.shifted.field_at(moved, travel)
        return shifted - self.shifts.still.field_at(centred, travel)

    def _mirrored(self, centred: Array, travel: Array, half: float) -> Array:
        mirror = np.array([-1.0, 1.0, 1.0])
        back: Array = self._change(centred * mirror[:2], travel, half) * mirror
        return back


def pin_at_centre(x: Array, shift: float, half: float) -> Array:
    """Where x (mm) of a block whose pin stands at `shift` lies if the pin is at the centre.

    Unchanged by the pin's axis within `EDGE`, stretched to the sides at -half and half beyond.
    """
    from_places = np.array([-half, shift - EDGE, shift + EDGE, half])
    at_centre: Array = np.interp(x, from_places, [-half, -EDGE, EDGE, half])
    return at_centre


def pin_shifted(x: Array, shift: float, half: float) -> Array:
    """The inverse of `pin_at_centre`."""
    to_places = np.array([-half, shift - EDGE, shift + EDGE, half])
    shifted: Array = np.interp(x, [-half, -EDGE, EDGE, half], to_places)
    return shifted


def solve_truth(
    truth: BlockTruth, folder: Path | None = None, say: Callable[[str], None] | None = None
) -> TruthResponse:
    """Run the models of the truth, or take what an equal truth of this code has left in `folder`.

    `say` is told which one begins. Raises ValueError when a simulation does not reach every travel.
    """
    models = (truth.model(), *truth.shift_models())
    solved = []
    for number, model in enumerate(models, start=1):
        if say is not None:
            say(f"simulation {number} of {len(models)} of the truth")
        solved.append(_solved(model, truth.ratios, folder))
    fine, *others = (smoothed(found) if truth.smooth else found for found in solved)
    if not others:
        return TruthResponse(truth, fine)
    shifts = ShiftedFields(others[0], others[1], truth.shift_solved)
    return TruthResponse(truth, continued(fine, others[0]), shifts)


def continued(fine: FrontResponse, coarse: FrontResponse) -> FrontResponse:
    """`fine`, and beyond its last travel what `coarse` adds to its own response there."""
    last = fine.travel[-1:]
    beyond = coarse.travel[coarse.travel > last + SAME]
    if not beyond.size:
        return fine
    nodes = np.stack(np.meshgrid(fine.x, fine.y, indexing="ij"), axis=-1).reshape(-1, 2)
    added = coarse.field_at(nodes, beyond) - coarse.field_at(nodes, last)
    shape = (beyond.size, *fine.displacement.shape[1:])
    return replace(
        fine,
        travel=np.append(fine.travel, beyond),
        force=np.append(
            fine.force, fine.force[-1] + coarse.force_at(beyond) - coarse.force_at(last)
        ),
        displacement=np.concatenate(
            [fine.displacement, fine.displacement[-1] + added.reshape(shape)]
        ),
    )


def _solved(model: BlockPinModel, ratios: Array, folder: Path | None) -> FrontResponse:
    if folder is None:
        return solve_front(model, ratios)
    code = [code_hash(package) for package in ("fe", "calib.virtual")]
    depends = {"ratios": ratios.tolist(), "code": code, **fingerprint(model)}
    name = hashlib.sha256(canonical_json(depends).encode()).hexdigest()[:16]
    path = folder / f"front-{name}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        save_front(path, solve_front(model, ratios))
    return load_front(path)
