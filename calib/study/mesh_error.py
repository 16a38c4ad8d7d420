"""Error of the sampling mesh: its difference from a finer one, measured and kept on disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.data import Dataset
from calib.inference.forward import EmulatorForward
from calib.inference.mesh_correction import CorrectionSlopes, MeshCorrection
from calib.inference.noise import NoiseSettings, field_nuisances
from calib.inference.tangent_errors import Mistaken, apart, mistaken, patterns_at, tangents_at
from calib.study.artifacts import read_json, read_npz, write_json, write_npz
from calib.study.config import Study
from calib.study.sections import Hypothesis
from calib.study.training_runs import rows
from fe.campaign import CampaignFailed
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import named_gradient

SAFETY = 3.0
"""of the grid convergence index from two grids (Roache 1994)"""
N_CHECKED = 2
"""places, posterior means, by which the error of a mesh is told"""
REACH = 0.2
"""share of the box of the ratios over which derivatives of the meshes' difference are followed: in
stuck blocks they leave a fifth to two fifths of what a constant does within 0.1 of it (a distance
of r and 2 s), as much beyond 0.4"""


def left_share(refinement: float, stiffening: float = 1.0) -> float:
    """SD of the error that is left after the correction, as a share of the measured difference.

    Half the grid convergence index of the finer mesh, whose elements are `refinement` times
    smaller, at second order and read as a 95 % band: 1.2 for elements 1.5 times smaller. Where its
    pin gives way `stiffening` times less, at least what a difference of that alone would leave of
    a rigid pin, as forces follow the penetration: a third for 4.
    """
    of_mesh = 0.5 * SAFETY / (refinement**2 - 1.0)
    return of_mesh if stiffening == 1.0 else max(of_mesh, 1.0 / (stiffening - 1.0))


@dataclass(frozen=True)
class MeshSlopes:
    """Derivatives of the field's difference between two meshes by the ratios, at each check."""

    field: Array
    """(n_check, n_step, n_point, 3, d) of coarse minus fine displacement, mm"""
    reach: Array
    """(d,) how far from a check they are followed"""


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
    stiffening: float = 1.0
    """how many times less the pin of the finer mesh's runs gives way"""

    @property
    def left(self) -> float:
        """SD of what the correction leaves, as a share of the difference."""
        return left_share(self.refinement, self.stiffening)

    @property
    def correction(self) -> MeshCorrection:
        """Takes predictions of the coarse mesh to the fine one.

        With slopes it is that of the last check, the field's carried on by them: checks are made
        where the posterior is, the last by all that was known. Without, it is the mean.
        """
        if self.slopes is None:
            return MeshCorrection(
                force=1.0 / (1.0 + self.signed_force.mean(axis=0)), field=-self.field.mean(axis=0)
            )
        return MeshCorrection(
            force=1.0 / (1.0 + self.signed_force[-1]),
            field=-self.field[-1],
            slopes=CorrectionSlopes(self.ratios[-1], self.slopes.reach, -self.slopes.field[-1]),
        )

    @property
    def _carried(self) -> Array:
        """(n_check, n_step, n_point, 3) differences as they would be at the last check, mm."""
        if self.slopes is None:
            return self.field
        away, _ = self.correction.away(self.ratios)
        found: Array = self.field - np.einsum("cipkd,cd->cipk", self.slopes.field, away)
        return found

    @property
    def force(self) -> Array:
        """(n_step,) relative SD of the force's error after the correction.

        Of the share that is left, and of the spread over the checks. The difference at one
        increment never counts less than its root mean square over all: where it changes sign
        between two increments, a small one is no sign of accuracy.
        """
        size = np.sqrt(np.mean(self.signed_force**2, axis=0))
        overall = np.sqrt(np.mean(self.signed_force**2))
        spread = _variance_over_checks(self.signed_force)
        share = self.left
        sd: Array = np.sqrt((share * np.maximum(size, overall)) ** 2 + spread)
        return sd

    @property
    def field_floor(self) -> Array:
        """(n_step, 3) SD of the field's error after the correction, mm; as for the force."""
        size = np.mean(self.field**2, axis=(0, 2))
        spread = _variance_over_checks(self._carried).mean(axis=1)
        floor: Array = np.sqrt(self.left**2 * size + spread)
        return floor

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
        """
        d = self.ratios.shape[1]
        if dataset.field is None:
            return Mistaken(np.zeros(d), (), np.zeros((0, 0)), forward.bounds)
        nuisances = field_nuisances(dataset, noise)
        tangents = tangents_at(forward, self._theta(forward), nuisances)
        of_ratios = np.full(d, np.inf) if self.extent is None else self.extent / np.sqrt(12.0)
        held = np.append(of_ratios, [error.sd for error in nuisances])
        share = self.left**2 / len(self.ratios)
        found = share * mistaken(dataset.field, dataset.travel, tangents, self.field, held)
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
    stiffening: float = 1.0,
) -> MeshError:
    """Difference between two meshes solved at the same ratios, at the last that both got through.

    `refinement` is how many times smaller the fine one's elements are, `stiffening` how many times
    less its pin gives way. With the `extent` (d,) of
    the box of the ratios the difference of the fields goes with them: for data with a field, whose
    posterior is narrow. That of forces alone spreads far beyond where derivatives hold.

    Raises CampaignFailed when there is no such point.
    """
    both = fine.reached & coarse.reached
    if not both.any():
        worst = min((*fine.responses, *coarse.responses), key=lambda found: found.reached)
        mesh = "finer" if not fine.reached.any() else "sampling"
        raise CampaignFailed(
            f"{name}: the {mesh} mesh stopped at {worst.reached:.3g} mm ({worst.message}), so the "
            "discretisation error is unknown; change mesh.check, lower mesh.check_stiffening or "
            "lower the last increment",
            n_failed=len(both),
            n_done=len(both),
            n_total=len(both),
        )
    last = np.flatnonzero(both)[-N_CHECKED:]
    fine, coarse = rows(fine, last), rows(coarse, last)
    return MeshError(
        refinement=refinement,
        ratios=fine.theta,
        signed_force=coarse.force / fine.force - 1.0,
        field=coarse.displacement - fine.displacement,
        slopes=None if extent is None else _slopes(fine, coarse, REACH * extent),
        extent=extent,
        stiffening=stiffening,
    )


def _slopes(fine: Campaign, coarse: Campaign, reach: Array) -> MeshSlopes | None:
    """Derivatives of the difference; None unless all equilibria are stable and theirs are known.

    Those of an unstable equilibrium need not be those along the ratios.
    """
    if not (fine.stable.all() and coarse.stable.all()):
        return None
    names = [parameter.name for parameter in fine.parameters]
    by_fine, by_coarse = (
        named_gradient(each.displacement_gradient, each.gradient_parameters, names)
        for each in (fine, coarse)
    )
    found = MeshSlopes(by_coarse - by_fine, reach)
    return found if np.isfinite(found.field).all() else None


def load_mesh_error(out: Path, hypothesis: Hypothesis) -> MeshError:
    """Read what the check stage kept; raises ValueError naming a missing or damaged file."""
    facts = read_json(check_folder(out, hypothesis) / "mesh_error.json")
    stored = read_npz(check_folder(out, hypothesis) / "mesh_error.npz", ("field",))
    known = "field_slope" in stored
    slopes = MeshSlopes(stored["field_slope"], stored["reach"]) if known else None
    extent = stored.get("extent")
    if extent is None and slopes is not None:
        extent = slopes.reach / REACH  # as files before it have it
    return MeshError(
        refinement=float(facts["refinement"]),
        ratios=np.asarray(facts["ratios"], dtype=float),
        signed_force=np.asarray(facts["signed_force"], dtype=float),
        field=stored["field"],
        slopes=slopes,
        extent=extent,
        stiffening=float(facts.get("stiffening", 1.0)),  # files before it have none
    )


def save_mesh_error(
    out: Path, hypothesis: Hypothesis, study: Study, error: MeshError, names: Sequence[str]
) -> list[Path]:
    """Keep the error of one hypothesis' mesh as json and npz; returns the files.

    `names` are those of the ratios' columns.
    """
    folder = check_folder(out, hypothesis)
    facts = {
        "coarse_cells": study.sampling_cells(hypothesis),
        "fine_cells": study.check_cells(hypothesis),
        "travel": study.increments,
        "refinement": error.refinement,
        "stiffening": error.stiffening,
        "left_share": error.left,
        "ratios": error.ratios,
        "names": names,
        "with_derivatives": error.slopes is not None,
        "force": error.force,
        "signed_force": error.signed_force,
        "field_rms": np.sqrt(np.mean(error.field**2, axis=(2, 3))),
        "field_floor": error.field_floor,
        "units": {"force": "relative", "field_rms": "mm", "field_floor": "mm", "travel": "mm"},
    }
    write_json(folder / "mesh_error.json", facts)
    arrays = {"field": error.field}
    if error.slopes is not None:
        arrays |= {"field_slope": error.slopes.field, "reach": error.slopes.reach}
    if error.extent is not None:
        arrays |= {"extent": error.extent}
    write_npz(folder / "mesh_error.npz", arrays)
    return [folder / "mesh_error.json", folder / "mesh_error.npz"]


def check_folder(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the finer mesh's runs of a hypothesis are kept."""
    return out / "check" / hypothesis.name
