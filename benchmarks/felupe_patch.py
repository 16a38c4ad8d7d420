"""`StuckPatch` solved by FElupe (https://felupe.readthedocs.io), an independent Python code.

Two elements: the same as softcal's (triquadratic displacement; discontinuous linear pressure and
volume ratio, Hu-Washizu), and its cheapest (trilinear displacement, one pressure an element,
condensed).  FElupe's own Newton iteration, with the solver that its documentation recommends.
"""

from __future__ import annotations

import time
from typing import Any, Literal

import felupe as fem
import numpy as np
import numpy.typing as npt
from pypardiso import PyPardisoSolver

from benchmarks.dirichlet import TOLERANCE
from benchmarks.stuck_patch import SYMMETRY_FACTOR, PatchRun, StuckPatch

Array = npt.NDArray[np.float64]
ElementName = Literal["Q2/P1", "Q1/P0"]

_VTK_FROM_SKFEM = [0, 3, 6, 2, 1, 5, 7, 4]
"""vertices of a hexahedron in the order of VTK, which FElupe uses"""
_GENERAL = 11
"""Pardiso's real unsymmetric matrices: what FElupe's own partition hands to a solver"""


def hexahedra(case: StuckPatch) -> fem.Mesh:
    """The case's mesh of eight-node hexahedra."""
    mesh = case.mesh()
    return fem.Mesh(mesh.p.T.copy(), mesh.t.T[:, _VTK_FROM_SKFEM].copy(), "hexahedron")


def material(case: StuckPatch) -> Any:
    """Isochoric law: FElupe's closed form where it has one, its automatic derivatives elsewhere."""
    c10, c01, c11 = case.constants
    if c01 == 0.0 and c11 == 0.0:
        return fem.NeoHooke(mu=2.0 * c10)
    import felupe.constitution.tensortrax as autodiff

    law = autodiff.models.hyperelastic.third_order_deformation
    return autodiff.Hyperelastic(law, C10=c10, C01=c01, C11=c11, C20=0.0, C30=0.0)


def solid_body(case: StuckPatch, element: ElementName) -> tuple[Any, Any]:
    """(body, fields) of the case."""
    if element == "Q1/P0":
        region = fem.RegionHexahedron(hexahedra(case))
        fields = fem.FieldContainer([fem.Field(region, dim=3)])
        return fem.SolidBodyNearlyIncompressible(material(case), fields, bulk=case.bulk), fields
    mesh = hexahedra(case).add_midpoints_edges().add_midpoints_faces().add_midpoints_volumes()
    region = fem.RegionTriQuadraticHexahedron(mesh)
    # discontinuous linear functions of the reference coordinates, as in softcal: those of a
    # tetrahedron span them, at the hexahedron's quadrature points
    dual = fem.Region(
        mesh.dual(points_per_cell=4, disconnect=True),
        fem.Tetra(),
        region.quadrature,
        grad=False,
    )
    fields = fem.FieldContainer(
        [fem.Field(region, dim=3), fem.Field(dual, values=0.0), fem.Field(dual, values=1.0)]
    )
    law = fem.NearlyIncompressible(material(case), bulk=case.bulk)
    return fem.SolidBody(law, fields), fields


def press(case: StuckPatch, element: ElementName = "Q2/P1") -> PatchRun:
    """Solve with FElupe; raises its `ValueError` when an increment does not converge."""
    started = time.perf_counter()
    body, fields = solid_body(case, element)
    positions = fields[0].region.mesh.points
    fixed, pressed = case.fixed(positions)
    boundaries = {
        f"component {i}": fem.Boundary(
            fields[0], mask=fixed[:, i], skip=tuple(k != i for k in range(3))
        )
        for i in range(3)
    }
    dof0, dof1 = fem.dof.partition(fields, boundaries)
    solver = _CountingSolver()
    forces = []
    for travel in case.travel:
        ext0 = case.prescribed(positions, travel).ravel()[dof0[dof0 < positions.size]]
        result = fem.newtonraphson(
            items=[body],
            dof0=dof0,
            dof1=dof1,
            ext0=ext0,
            solver=solver,
            tol=TOLERANCE,
            maxiter=25,
            verbose=0,
        )
        reaction = np.asarray(result.fun)[: positions.size].reshape(-1, 3)
        forces.append(-SYMMETRY_FACTOR * reaction[pressed, 1].sum())
    return PatchRun(
        code=f"FElupe {fem.__version__} {element}",
        n_unknowns=int(positions.size - fixed.sum()),
        force=np.array(forces),
        seconds=time.perf_counter() - started,
        n_iterations=solver.n_calls,
    )


class _CountingSolver:
    """MKL Pardiso for FElupe's unsymmetric matrices; counts its calls."""

    def __init__(self) -> None:
        self.n_calls = 0
        self._pardiso = PyPardisoSolver(mtype=_GENERAL)

    def __call__(self, matrix: Any, right: Array) -> Array:
        self.n_calls += 1
        solution: Array = self._pardiso.solve(matrix.tocsr(), right)
        return solution
