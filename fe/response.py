"""What one FE simulation returns: forces and front-face field at the travels, and how it went."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from fe.atomic_file import replacing

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class Status(StrEnum):
    """How a simulation ended."""

    CONVERGED = "converged"
    STOPPED = "stopped"


@dataclass(frozen=True)
class Response:
    """Solution of the specimen at kappa = C10 + C01 = 1 MPa.

    Steps beyond `reached` hold NaN. Forces are of the whole sample, positive in compression;
    gradients are with respect to the ratios (r, s) = (C01, C11) / kappa at kappa = 1 MPa.
    """

    travel: Array
    """(n_step,) pin travel, mm"""
    force: Array
    """(n_step,) force of the whole sample, N"""
    displacement: Array
    """(n_step, n_point, 3) displacement (x, y, z) of the front-face points, mm"""
    force_gradient: Array
    """(n_step, 2) dF/d(r, s), N"""
    displacement_gradient: Array
    """(n_step, n_point, 3, 2) du/d(r, s), mm"""
    reached: float
    """travel up to which the solution is good, mm"""
    status: Status
    message: str
    """one sentence on how the run ended"""
    negative_pivots: IntArray
    """(n_step,) negative pivots of the tangent: > 0 is an unstable equilibrium, -1 not reached"""
    n_factorisations: int
    seconds: float

    def __post_init__(self) -> None:
        n_step = self.travel.size
        for name in (
            "force",
            "displacement",
            "force_gradient",
            "displacement_gradient",
            "negative_pivots",
        ):
            found = getattr(self, name).shape[0]
            if found != n_step:
                raise ValueError(f"{name}: expected {n_step} steps as in travel, found {found}")


def save_response(path: Path, response: Response, **extra: npt.NDArray[np.generic]) -> None:
    """Write one self-contained npz file, atomically; `extra` arrays go beside the fields."""
    values = {f.name: np.asarray(getattr(response, f.name)) for f in fields(Response)}
    values["status"] = np.asarray(str(response.status))
    with replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **cast("dict[str, Any]", values | extra))


def load_response(path: Path) -> Response:
    """Read what `save_response` wrote.

    Raises ValueError naming the file when it is damaged or is not a response.
    """
    names = {f.name for f in fields(Response)}
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            values = {name: stored[name] for name in names}
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise ValueError(f"{path}: not a readable simulation result ({error})") from error
    except Exception as error:  # zipfile raises its own BadZipFile, zlib its own error
        if type(error).__module__ not in {"zipfile", "zlib"}:
            raise
        raise ValueError(f"{path}: damaged simulation result ({error})") from error
    return Response(
        travel=values["travel"],
        force=values["force"],
        displacement=values["displacement"],
        force_gradient=values["force_gradient"],
        displacement_gradient=values["displacement_gradient"],
        reached=float(values["reached"]),
        status=Status(str(values["status"])),
        message=str(values["message"]),
        negative_pivots=values["negative_pivots"],
        n_factorisations=int(values["n_factorisations"]),
        seconds=float(values["seconds"]),
    )
