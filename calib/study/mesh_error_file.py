"""The error of a sampling mesh on disk: json to be read, npz of its fields."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.study.artifacts import read_json, read_npz, write_json, write_npz
from calib.study.config import Study
from calib.study.mesh_error import FORCE_BEYOND, REACH, MeshError
from calib.study.mesh_parts import AtCheck, MeshSlopes, PinError
from calib.study.sections import Hypothesis
from calib.study.usual_meshes import field_order


def mesh_error_files(out: Path, hypothesis: Hypothesis) -> list[Path]:
    """Where the error of a hypothesis' mesh is kept: json and npz."""
    folder = check_folder(out, hypothesis)
    return [folder / "mesh_error.json", folder / "mesh_error.npz"]


def load_mesh_error(out: Path, hypothesis: Hypothesis) -> MeshError:
    """Read what the check stage kept; raises ValueError naming a missing or damaged file."""
    of_facts, of_fields = mesh_error_files(out, hypothesis)
    facts, stored = read_json(of_facts), read_npz(of_fields, ("field",))
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
        points=stored.get("points"),  # not in files before 2026-11-27
        pin=None
        if facts.get("pin") is None  # files before 2026-11-26 have none
        else PinError(
            float(facts["pin"]["stiffening"]),
            np.asarray(facts["pin"]["signed_force"], dtype=float),
            stored["pin_field"],
        ),
        at_check=AtCheck(stored["tangents"], stored["field_at_check"])
        if "tangents" in stored  # not in files before 2026-11-26
        else None,
        field_order=field_order(hypothesis),
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
        "left_share": error.left.force,
        "field_left_share": error.left.field,
        "ratios": error.ratios,
        "names": names,
        "with_derivatives": error.slopes is not None,
        "force": error.force,
        "signed_force": error.signed_force,
        "field_rms": np.sqrt(np.mean(error.field**2, axis=(2, 3))),
        "field_floor": error.field_floor.sd,
        "pin": None if error.pin is None else _pin_facts(error.pin),
        "units": {"force": "relative", "field_rms": "mm", "field_floor": "mm", "travel": "mm"},
    }
    write_json(folder / "mesh_error.json", facts)
    arrays = {"field": error.field}
    if error.points is not None:
        arrays |= {"points": error.points}
    if error.slopes is not None:
        arrays |= {"field_slope": error.slopes.field, "reach": error.slopes.reach}
    if error.extent is not None:
        arrays |= {"extent": error.extent}
    if error.pin is not None:
        arrays |= {"pin_field": error.pin.field}
    if error.at_check is not None:
        arrays |= {"tangents": error.at_check.tangents, "field_at_check": error.at_check.field}
    write_npz(folder / "mesh_error.npz", arrays)
    return [folder / "mesh_error.json", folder / "mesh_error.npz"]


def _pin_facts(pin: PinError) -> dict[str, object]:
    return {
        "stiffening": pin.stiffening,
        "beyond": pin.beyond,
        "left_share": FORCE_BEYOND * pin.beyond,
        "signed_force": pin.signed_force,
        "field_rms": np.sqrt(np.mean(pin.field**2, axis=(2, 3))),
    }


def check_folder(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the finer mesh's runs of a hypothesis are kept."""
    return out / "check" / hypothesis.name


def pin_folder(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the runs of the sampling mesh under the finer mesh's pin are kept."""
    return check_folder(out, hypothesis) / "pin"
