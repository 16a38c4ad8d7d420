"""Error of the sampling mesh and of its pin: the difference from finer ones, and what is left."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calib.data import Dataset
from calib.inference.field_floor import FieldFloor, local_profile
from calib.inference.field_noise import field_covariance
from calib.inference.forward import EmulatorForward
from calib.inference.mesh_correction import CorrectionSlopes, MeshCorrection
from calib.inference.noise import NoiseSettings, field_nuisances
from calib.inference.tangent_errors import (
    Mistaken,
    apart,
    mistaken,
    patterns_at,
    tangents_at,
    with_nuisances,
)
from calib.study.mesh_parts import (
    FINER,
    SAMPLING,
    AtCheck,
    MeshSlopes,
    PinError,
    slopes_of,
    unknown_error,
)
from calib.study.training_runs import rows
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import named_gradient

SAFETY = 3.0
"""of the grid convergence index from two grids (Roache 1994)"""
FORCE_BEYOND = 0.5
"""SD of what a correction to a rigid pin leaves of the forces, as a share of its step beyond the
finer mesh's pin: pins 4 and 8 times as stiff foretell rigid ones that are up to 0.08 % apart, by
steps of 0.1 to 2.1 % (docs/verification.md). Fields of stuck blocks follow less well, and of fields
the whole step is taken."""
N_CHECKED = 2
"""places, posterior means, by which the error of a mesh is told"""
REACH = 0.2
"""share of the box of the ratios over which derivatives of the meshes' difference are followed: in
stuck blocks they leave a fifth to two fifths of what a constant does within 0.1 of it (a distance
of r and 2 s), as much beyond 0.4"""


def left_share(refinement: float, order: float = 2.0) -> float:
    """SD of the mesh error that is left after the correction, as a share of the difference.

    Half the grid convergence index of the finer mesh, whose elements are `refinement` times
    smaller, read as a 95 % band: at second order 1.2 for elements 1.5 times smaller.
    """
    index: float = SAFETY / (refinement**order - 1.0)
    return 0.5 * index


class Shares(NamedTuple):
    """One of relative forces, one of fields."""

    force: float
    field: float


ALL = Shares(1.0, 1.0)


@dataclass(frozen=True)
class MeshError:
    """How far the mesh of the emulator's runs is from the finer mesh, for one hypothesis."""

    refinement: float
    """edge of the coarse mesh's elements over that of the fine one's"""
    ratios: Array
    """(n_check, d) ratios and further unknowns at which both meshes were solved"""
    signed_force: Array
    """(n_check, n_step) coarse over fine force minus one"""
    field: Array
    """(n_check, n_step, n_point, 3) coarse minus fine displacement, mm"""
    slopes: MeshSlopes | None = None
    """None where derivatives of one of the runs are not known"""
    extent: Array | None = None
    """(d,) of the box of the ratios, for data with a field"""
    pin: PinError | None = None
    """what of it is the pin's; None where that is the same for both meshes"""
    at_check: AtCheck | None = None
    """None where the slopes are"""
    points: Array | None = None
    """(n_point, 2) of the field, mm; None where they are not known (files before 2026-11-27): what
    is left is then taken to be of one size everywhere"""
    field_order: float = 2.0
    """of the field's error in the size of the elements (`calib.study.usual_meshes`)"""
    shown: Shares = ALL
    """shares of what is left that are stated: less than all for a truth that shows less"""

    @property
    def left(self) -> Shares:
        """SD of what is left of the mesh after the correction, as shares of the difference."""
        return Shares(
            self.shown.force * left_share(self.refinement),
            self.shown.field * left_share(self.refinement, self.field_order),
        )

    @property
    def _parts(self) -> list[tuple[Array, Array]]:
        """What is left as an SD, of relative forces and of fields [mm]: of mesh, then of pin."""
        left, pin = self.left, self.pin
        if pin is None:
            return [(left.force * self.signed_force, left.field * self.field)]
        of_mesh = (1.0 + self.signed_force) / (1.0 + pin.signed_force) - 1.0
        return [
            (left.force * of_mesh, left.field * (self.field - pin.field)),
            (FORCE_BEYOND * pin.beyond * pin.signed_force, pin.beyond * pin.field),
        ]

    @property
    def _to_rigid(self) -> tuple[Array, Array]:
        """Signed relative forces and fields [mm] as `signed_force` and `field`, to a rigid pin."""
        if (pin := self.pin) is None:
            return self.signed_force, self.field
        force = (1.0 + self.signed_force) * (1.0 + pin.beyond * pin.signed_force) - 1.0
        return force, self.field + pin.beyond * pin.field

    @property
    def correction(self) -> MeshCorrection:
        """Takes predictions of the coarse mesh to the fine one under a rigid pin.

        With slopes it is that of the last check, the field's carried on by them: checks are made
        where the posterior is, the last by all that was known. Without, it is the mean.
        """
        force, field = self._to_rigid
        if self.slopes is None:
            return MeshCorrection(force=1.0 / (1.0 + force.mean(axis=0)), field=-field.mean(axis=0))
        return MeshCorrection(
            force=1.0 / (1.0 + force[-1]),
            field=-field[-1],
            slopes=CorrectionSlopes(self.ratios[-1], self.slopes.reach, -self.slopes.field[-1]),
        )

    @property
    def _carried(self) -> Array:
        """(n_check, n_step, n_point, 3) differences as they would be at the last check, mm."""
        _, field = self._to_rigid
        if self.slopes is None:
            return field
        away, _ = self.correction.away(self.ratios)
        found: Array = field - np.einsum("cipkd,cd->cipk", self.slopes.field, away)
        return found

    @property
    def force(self) -> Array:
        """(n_step,) relative SD of the force's error after the correction.

        Of the shares that are left, of mesh and pin, and of the spread over the checks. A
        difference at one increment never counts less than its root mean square over all: where it
        changes sign between two increments, a small one is no sign of accuracy.
        """
        variance = _variance_over_checks(self._to_rigid[0])
        for force, _ in self._parts:
            variance += np.maximum(np.mean(force**2, axis=0), np.mean(force**2))
        sd: Array = np.sqrt(variance)
        return sd

    @property
    def field_floor(self) -> FieldFloor:
        """SD of the field's error after the correction; as for the force.

        Where on the face it is large is told by the difference of the meshes under one pin.
        """
        variance: Array = _variance_over_checks(self._carried).mean(axis=1)
        for _, field in self._parts:
            variance += np.mean(field**2, axis=(0, 2))
        if self.points is None:
            return FieldFloor(np.sqrt(variance))
        of_mesh = self.field if self.pin is None else self.field - self.pin.field
        return FieldFloor(np.sqrt(variance), local_profile(self.points, of_mesh))

    def field_patterns(
        self, dataset: Dataset, noise: NoiseSettings, forward: EmulatorForward
    ) -> Array | None:
        """(n, n_step, n_point, 3) errors of the field in known shapes, mm.

        Mesh errors look like other ratios: as rows of nodes pass the pin's edge, the front face
        moves as it does with r and s, and a floor that is spread over all shapes would put almost
        nothing into those. So the share that is left is taken of the changes of the ratios, and of
        further unknowns, for which the difference of the meshes would be mistaken; and of those of
        the q nuisances that move the field: one that errs by 5 um along the zero of the travel,
        which the forces share, takes kappa along by 1 %. With how the shapes of the ratios turn
        over such a change. None for data without a field.
        """
        if dataset.field is None:
            return None
        found, nuisances = self.mistaken(dataset, noise, forward), field_nuisances(dataset, noise)
        return patterns_at(found, forward, self._theta(forward), nuisances)

    def mistaken(
        self, dataset: Dataset, noise: NoiseSettings, forward: EmulatorForward
    ) -> Mistaken:
        """Errors of ratios and nuisances behind `field_patterns`; zero without a field.

        All checks together count as one. As likely as values even over the box of the ratios and
        as the nuisances are, so that constants which the field hardly tells apart stay within it.
        By the changes of the FE model itself where they are known: an emulator of the prior's box
        whose changes are off by 4 %, in shapes that noise has not, makes constants look apart that
        are not, and sizes six times too small.
        """
        d = self.ratios.shape[1]
        if dataset.field is None:
            return Mistaken(np.zeros(d), (), np.zeros((0, 0)), forward.bounds)
        nuisances = field_nuisances(dataset, noise)
        if (known := self.at_check) is None:
            tangents = tangents_at(forward, self._theta(forward), nuisances)
        else:
            tangents = with_nuisances(known.tangents, known.field, nuisances)
        of_ratios = np.full(d, np.inf) if self.extent is None else self.extent / np.sqrt(12.0)
        held = np.append(of_ratios, [error.sd for error in nuisances])
        found = np.zeros((held.size, held.size))
        # Not by the directions in which samples differ: not every likelihood has these.
        errors = field_covariance(replace(dataset.field, patterns=None), floor=self.field_floor)
        for _, field in self._parts:
            of_part = mistaken(errors, dataset.travel, tangents, field, held)
            found += of_part / len(self.ratios)
        return apart(found, tuple(error.name for error in nuisances), forward.bounds)

    def _theta(self, forward: EmulatorForward) -> Array:
        """Of the last check, or next to it: an emulator knows its own box alone."""
        return np.append(1.0, np.clip(self.ratios[-1], *forward.bounds.T))


def _variance_over_checks(differences: Array) -> Array:
    """Variance over the checks (the first axis); zero with a single check."""
    if len(differences) < 2:
        return np.zeros(differences.shape[1:])
    variance: Array = differences.var(axis=0, ddof=1)
    return variance


def mesh_error(
    fine: Campaign,
    coarse: Campaign,
    refinement: float,
    name: str,
    extent: Array | None = None,
    stiffer: tuple[Campaign, float] | None = None,
    field_order: float = 2.0,
) -> MeshError:
    """Difference between two meshes solved at the same ratios, at the last that all got through.

    `refinement` is how many times smaller the fine one's elements are, `field_order` the order at
    which errors of the field fall with their size. Where its pin gives way
    less, `stiffer` are runs of the coarse mesh under such a pin, and how many times less. With the
    `extent` (d,) of the box of the ratios the difference of the fields goes with them: for data
    with a field, whose posterior is narrow. That of forces alone spreads far beyond where
    derivatives hold.

    Raises CampaignFailed when there is no such point.
    """
    runs = {FINER: fine, SAMPLING: coarse}
    if stiffer is not None:
        runs[f"{SAMPLING} under a stiffer pin"] = stiffer[0]
    every = np.all([own.reached for own in runs.values()], axis=0)
    if not every.any():
        raise unknown_error(name, runs)
    last = np.flatnonzero(every)[-N_CHECKED:]
    fine, coarse = rows(fine, last), rows(coarse, last)
    under = None if stiffer is None else (rows(stiffer[0], last), stiffer[1])
    points = fine.responses[-1].points
    found = MeshError(
        refinement=refinement,
        ratios=fine.theta,
        signed_force=coarse.force / fine.force - 1.0,
        field=coarse.displacement - fine.displacement,
        slopes=None if extent is None else slopes_of(fine, coarse, REACH * extent, under),
        extent=extent,
        pin=None if under is None else _pin_error(coarse, *under),
        points=points if len(points) else None,
        field_order=field_order,
    )
    return replace(found, at_check=_at_check(found.correction, fine, coarse))


def _at_check(correction: MeshCorrection, fine: Campaign, coarse: Campaign) -> AtCheck | None:
    """The last of the coarse runs, corrected; None without slopes, where its own may not do."""
    if correction.slopes is None:
        return None
    names = [parameter.name for parameter in fine.parameters]
    own = named_gradient(coarse.displacement_gradient[-1], coarse.gradient_parameters, names)
    tangents = np.moveaxis(own, -1, 0) + correction.field_slopes
    return AtCheck(tangents, coarse.displacement[-1] + correction.field)


def _pin_error(coarse: Campaign, stiffer: Campaign, stiffening: float) -> PinError:
    return PinError(
        stiffening,
        coarse.force / stiffer.force - 1.0,
        coarse.displacement - stiffer.displacement,
    )
