"""What one FE simulation returns: forces and front-face field at the travels, and how it went."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from fe.atomic_file import replacing
from fe.npz_file import read_npz

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

XYZ = ("x", "y", "z")
OF_REVOLUTION = ("radius", "height", "none")
"""names of what is seen of a specimen, and of an axisymmetric one"""


class Status(StrEnum):
    """How a simulation ended."""

    CONVERGED = "converged"
    """every asked step was reached"""
    STOPPED = "stopped"
    """at `reached`, before the last asked step"""
    FORCE_FELL = "force fell"
    """every asked step was reached, but beyond `reached` the force falls: the solution may be on
    another branch of equilibria, real or of the mesh, or the material may soften.  Of specimens
    without a pin; under a pin, where the force may fall as material snaps past its edge, the
    message tells it"""
    JUMPED = "jumped"
    """every asked step was reached, but beyond `reached` the path turned unstable and the solution
    left it for another branch, told by a move further than the step.  As of `FORCE_FELL`, of
    specimens without a pin"""


@dataclass(frozen=True)
class Response:
    """Solution of a specimen: at kappa = C10 + C01 = 1 MPa for ratios, else of a material.

    Steps that were not reached hold NaN.  Forces are of the whole sample, positive along the
    travel: in compression for pin, plates and a bar that is compressed, in tension for one that is
    pulled.
    Gradients are with respect to `parameters`, by default the ratios (r, s) = (C01, C11) / kappa at
    that kappa.
    """

    travel: Array
    """(n_step,) travel of pin, plates or clamps, mm: as asked, or found at the asked forces"""
    force: Array
    """(n_step,) force of the whole sample, N: found, or as asked"""
    displacement: Array
    """(n_step, n_point, 3) displacement of the points seen on the surface, mm: (x, y, z), or
    (radial, axial, 0) of an axisymmetric specimen"""
    force_gradient: Array
    """(n_step, n_parameter) N per unit of the parameter; (r, s) have none; 0 at asked forces"""
    displacement_gradient: Array
    """(n_step, n_point, 3, n_parameter) mm per unit of the parameter, at the asked travel or the
    asked force"""
    reached: float
    """travel up to which the solution is good, mm"""
    status: Status
    message: str
    """one sentence on how the run ended"""
    negative_pivots: IntArray
    """(n_step,) negative pivots of the tangent at the asked steps: > 0 is an unstable equilibrium,
    -1 not reached"""
    n_factorisations: int
    seconds: float
    points: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(n_point, 2) reference position of the points on the surface, mm: (x, y), or (radius, height)
    of an axisymmetric specimen; none when not kept"""
    parameters: tuple[str, ...] = ("r", "s")
    """what the gradients are in: stress-like constants and the bulk modulus in MPa"""
    solver: str = ""
    """the library that factorised the tangents; empty when not known"""
    travel_gradient: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(n_step, n_parameter) mm per unit of the parameter, at asked forces; none at asked travels"""
    n_steps: int = 0
    """steps that the solver accepted, asked for or not; 0 when not kept"""
    n_iterations: int = 0
    """Newton iterations in them"""
    components: tuple[str, str, str] = XYZ
    """of the displacement, the first two those of the points, too"""

    def __post_init__(self) -> None:
        n_step = self.travel.size
        for name in (
            "force",
            "displacement",
            "force_gradient",
            "displacement_gradient",
            "negative_pivots",
        ):
            values = getattr(self, name)
            if values.dtype.kind not in "fiu":
                raise ValueError(f"{name}: expected real numbers, found {values.dtype}")
            found = values.shape[0]
            if found != n_step:
                raise ValueError(f"{name}: expected {n_step} steps as in travel, found {found}")
        for name in ("force_gradient", "displacement_gradient"):
            found = getattr(self, name).shape[-1]
            if found != len(self.parameters):
                raise ValueError(
                    f"{name}: expected derivatives in {len(self.parameters)} parameters "
                    f"({', '.join(self.parameters)}), found {found}"
                )
        if self.force.ndim != 1:
            raise ValueError(f"force: expected one number a step, found shape {self.force.shape}")


def save_response(path: Path, response: Response, **extra: npt.NDArray[np.generic]) -> None:
    """Write one self-contained npz file, atomically; `extra` arrays go beside the fields.

    Raises ValueError for an extra array with the name of a field, and for a field of neither
    numbers nor text, which would be stored as a pickle.
    """
    path = Path(path)
    if own := {f.name for f in fields(Response)} & extra.keys():
        raise ValueError(f"extra: expected names beside the fields', found {', '.join(own)}")
    values = {f.name: np.asarray(getattr(response, f.name)) for f in fields(Response)}
    values["status"] = np.asarray(str(response.status))
    if others := [name for name, value in values.items() if value.dtype.kind == "O"]:
        raise ValueError(f"{', '.join(others)}: expected numbers or text, found objects")
    with replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **cast("dict[str, Any]", values | extra))


def load_response(path: Path) -> Response:
    """Read what `save_response` wrote.

    Raises ValueError naming the file when it is damaged or is not a response, OSError when it
    cannot be opened or read.
    """
    path = Path(path)
    try:
        return response_of(read_npz(path))
    except ValueError as error:
        raise ValueError(f"{path}: not a readable simulation result ({error})") from error


def response_of(values: dict[str, npt.NDArray[Any]]) -> Response:
    """The response whose fields are stored under their names; others are left alone.

    Raises ValueError for a field that is missing or of another format.
    """
    try:
        return _response_of(values)
    except KeyError as error:
        raise ValueError(f"expected an array {error}, found none") from error
    except TypeError as error:  # one array of another format, or with another number of values
        raise ValueError(str(error)) from error


def _response_of(values: dict[str, npt.NDArray[Any]]) -> Response:
    labels: dict[str, Any] = {}
    for name in ("points", "travel_gradient"):
        if name in values:
            labels[name] = values[name]
    for name in ("n_steps", "n_iterations"):
        if name in values:
            labels[name] = int(values[name])
    if "parameters" in values:
        labels["parameters"] = tuple(str(name) for name in values["parameters"])
    if "components" in values:
        labels["components"] = tuple(str(name) for name in values["components"])
    if "solver" in values:
        labels["solver"] = str(values["solver"])
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
        **labels,
    )
