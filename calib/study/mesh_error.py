"""Error of the sampling mesh: its difference from a finer one, measured and kept on disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.inference.forward import MeshCorrection
from calib.study.artifacts import read_json, write_json, write_npz
from calib.study.config import Study
from calib.study.sections import Hypothesis
from fe.campaign import CampaignFailed
from fe.campaign_result import Campaign
from fe.response import Array

SAFETY = 3.0
"""of the grid convergence index from two grids (Roache 1994)"""


def left_share(refinement: float) -> float:
    """SD of the error that is left after the correction, as a share of the measured difference.

    Half the grid convergence index of the finer mesh, whose elements are `refinement` times
    smaller, at second order and read as a 95 % band: 1.2 for elements 1.5 times smaller.
    """
    return 0.5 * SAFETY / (refinement**2 - 1.0)


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

    @property
    def correction(self) -> MeshCorrection:
        """Takes predictions of the coarse mesh to the fine one: the mean over the checks."""
        return MeshCorrection(
            force=1.0 / (1.0 + self.signed_force.mean(axis=0)), field=-self.field.mean(axis=0)
        )

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
        share = left_share(self.refinement)
        sd: Array = np.sqrt((share * np.maximum(size, overall)) ** 2 + spread)
        return sd

    @property
    def field_floor(self) -> Array:
        """(n_step, 3) SD of the field's error after the correction, mm; as for the force."""
        size = np.mean(self.field**2, axis=(0, 2))
        spread = _variance_over_checks(self.field).mean(axis=1)
        floor: Array = np.sqrt(left_share(self.refinement) ** 2 * size + spread)
        return floor

    @property
    def field_patterns(self) -> Array:
        """(n_check n_step, n_step, n_point, 3) errors of the field in known shapes, mm.

        What is left has the shapes of the differences at one increment, and a sign and size of its
        own there: all checks together that of one. Mesh errors look like other constants: as rows
        of nodes pass the pin's edge, the front face moves as it does with r and s. A floor that is
        spread over all shapes would put almost nothing into those.
        """
        n_check, n_step = self.field.shape[:2]
        single = np.eye(n_step)[:, None, :, None, None] * self.field
        share = left_share(self.refinement) / np.sqrt(n_check)
        patterns: Array = share * single.reshape(-1, *self.field.shape[1:])
        return patterns


def _variance_over_checks(differences: Array) -> Array:
    """Variance over the checks (the first axis); zero with a single check."""
    if len(differences) < 2:
        return np.zeros(differences.shape[1:])
    variance: Array = differences.var(axis=0, ddof=1)
    return variance


def mesh_error(fine: Campaign, coarse: Campaign, refinement: float, name: str) -> MeshError:
    """Difference between two meshes solved at the same ratios, where both reached the end.

    `refinement` is how many times smaller the fine one's elements are.

    Raises CampaignFailed when there is no such point.
    """
    both = fine.reached & coarse.reached
    if not both.any():
        worst = min((*fine.responses, *coarse.responses), key=lambda found: found.reached)
        mesh = "finer" if not fine.reached.any() else "sampling"
        raise CampaignFailed(
            f"{name}: the {mesh} mesh stopped at {worst.reached:.3g} mm ({worst.message}), so the "
            "discretisation error is unknown; change mesh.check or lower the last increment",
            n_failed=len(both),
            n_done=len(both),
            n_total=len(both),
        )
    return MeshError(
        refinement=refinement,
        ratios=fine.theta[both],
        signed_force=coarse.force[both] / fine.force[both] - 1.0,
        field=coarse.displacement[both] - fine.displacement[both],
    )


def load_mesh_error(out: Path, hypothesis: Hypothesis) -> MeshError:
    """Read what the check stage kept for one hypothesis."""
    facts = read_json(check_folder(out, hypothesis) / "mesh_error.json")
    with np.load(check_folder(out, hypothesis) / "mesh_error.npz", allow_pickle=False) as stored:
        field = stored["field"]
    return MeshError(
        refinement=float(facts["refinement"]),
        ratios=np.asarray(facts["ratios"], dtype=float),
        signed_force=np.asarray(facts["signed_force"], dtype=float),
        field=field,
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
        "left_share": left_share(error.refinement),
        "ratios": error.ratios,
        "names": names,
        "force": error.force,
        "signed_force": error.signed_force,
        "field_rms": np.sqrt(np.mean(error.field**2, axis=(2, 3))),
        "field_floor": error.field_floor,
        "units": {"force": "relative", "field_rms": "mm", "field_floor": "mm", "travel": "mm"},
    }
    write_json(folder / "mesh_error.json", facts)
    write_npz(folder / "mesh_error.npz", {"field": error.field})
    return [folder / "mesh_error.json", folder / "mesh_error.npz"]


def check_folder(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the finer mesh's runs of a hypothesis are kept."""
    return out / "check" / hypothesis.name
