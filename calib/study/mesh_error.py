"""Error of the sampling mesh: its difference from a finer one, measured and kept on disk."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.study.artifacts import read_json, write_json, write_npz
from calib.study.config import Study
from calib.study.sections import Hypothesis
from fe.campaign import Campaign, CampaignFailed, is_reached
from fe.response import Array


@dataclass(frozen=True)
class MeshError:
    """How far the mesh of the emulator's runs is from the finer mesh, for one hypothesis."""

    ratios: Array
    """(n_check, 2) ratios (r, s) at which both meshes were solved"""
    force: Array
    """(n_step,) relative error of the force: over the checks the root mean square of coarse over
    fine force minus one, and never less than its root mean square over all increments, for a
    difference that changes sign between two increments is no sign of accuracy there"""
    signed_force: Array
    """(n_check, n_step) coarse over fine force minus one"""
    field: Array
    """(n_check, n_step, n_point, 3) coarse minus fine displacement, mm"""


def mesh_error(fine: Campaign, coarse: Campaign, name: str) -> MeshError:
    """Difference between two meshes solved at the same ratios.

    Raises CampaignFailed when one of them did not reach the last increment everywhere.
    """
    for mesh, campaign in (("finer", fine), ("sampling", coarse)):
        for response in campaign.responses:
            if not is_reached(response):
                raise CampaignFailed(
                    f"{name}: the {mesh} mesh stopped at {response.reached:.3g} mm "
                    f"({response.message}), so its discretisation error is unknown; change "
                    "mesh.check or lower the last increment",
                    n_failed=1,
                    n_done=len(campaign.responses),
                    n_total=len(campaign.responses),
                )
    signed = coarse.force / fine.force - 1.0
    overall = np.sqrt(np.mean(signed**2))
    return MeshError(
        ratios=fine.ratios,
        force=np.maximum(np.sqrt(np.mean(signed**2, axis=0)), overall),
        signed_force=signed,
        field=coarse.displacement - fine.displacement,
    )


def load_mesh_error(out: Path, hypothesis: Hypothesis) -> MeshError:
    """Read what the check stage kept for one hypothesis."""
    facts = read_json(check_folder(out, hypothesis) / "mesh_error.json")
    with np.load(check_folder(out, hypothesis) / "mesh_error.npz", allow_pickle=False) as stored:
        field = stored["field"]
    return MeshError(
        ratios=np.asarray(facts["ratios"], dtype=float),
        force=np.asarray(facts["force"], dtype=float),
        signed_force=np.asarray(facts["signed_force"], dtype=float),
        field=field,
    )


def save_mesh_error(
    out: Path, hypothesis: Hypothesis, study: Study, error: MeshError
) -> list[Path]:
    """Keep the error of one hypothesis' mesh as json and npz; returns the files."""
    folder = check_folder(out, hypothesis)
    facts = {
        "coarse_cells": study.mesh.sampling,
        "fine_cells": study.mesh.check,
        "travel": study.increments,
        "ratios": error.ratios,
        "force": error.force,
        "signed_force": error.signed_force,
        "field_rms": np.sqrt(np.mean(error.field**2, axis=(0, 2, 3))),
        "units": {"force": "relative", "field_rms": "mm", "travel": "mm"},
    }
    write_json(folder / "mesh_error.json", facts)
    write_npz(folder / "mesh_error.npz", {"field": error.field})
    return [folder / "mesh_error.json", folder / "mesh_error.npz"]


def check_folder(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the finer mesh's runs of a hypothesis are kept."""
    return out / "check" / hypothesis.name
