"""A bar in uniaxial tension or compression between frictionless ends: one element, the oracle.

The bar (width x, length y, depth z) stands on the planes x = 0, y = 0 and z = 0 and its end y =
length moves.  The element is trilinear with one pressure, and the nodes of a free side share the
motion of that side: two unknowns, so that the deformation is homogeneous also where a larger mesh
would leave it by an instability.  The force is that of fe.closed_forms.uniaxial, up to where the
bar would rather stretch less in width than in depth (C01 below 0): the status says so.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt
from skfem import Basis, ElementHex1, MeshHex

from fe import driven_response
from fe.campaign_parameters import RATIOS, Parameter
from fe.discretisation import VOLUME_ORDER, first_order_elements
from fe.driven import DrivenProblem, unknowns
from fe.driven_parameters import Shape, free_shape
from fe.driven_response import DrivenSpecimen, Schedule
from fe.field_motion import field_probe
from fe.force_control import keep_targets
from fe.newton import NewtonOptions
from fe.parameters import keep_asked
from fe.specimens.checks import (
    check_bulk_ratio,
    check_kinds,
    check_lengths,
    check_travel,
    keep_counts,
)
from fe.steps import StepOptions

Array = npt.NDArray[np.float64]

ALIKE = 1e-6
"""difference of the stretches of width and depth beyond which they are not one"""


@dataclass(frozen=True)
class Bar:
    """Dimensions of the bar, mm; raises ValueError unless above 0."""

    width: float = 1.0
    length: float = 1.0
    depth: float = 1.0

    def __post_init__(self) -> None:
        check_lengths(self)


@dataclass(frozen=True)
class UniaxialModel:
    """Simulation of the bar as a function of (r, s) or of any material; picklable, one thread.

    `travel` are the changes of length (mm, increasing, above 0) at which the response is asked,
    `direction` what they do; or `force` the forces (N, increasing). Forces are positive along the
    travel. `bulk_ratio` is the bulk modulus over mu = 2 kappa for calls with ratios.
    `sensitivities` names the parameters of the response's gradients (`parameter_names` lists all
    there are), by default those that it is a function of. Field points keep their fractions of
    width and length.
    """

    specimen: Bar
    travel: tuple[float, ...] = ()
    direction: Literal["tension", "compression"] = "tension"
    bulk_ratio: float = 200.0
    field_grid: tuple[int, int] = (2, 2)
    steps: StepOptions = field(default_factory=lambda: StepOptions(0.1, 0.5, 1e-4))
    newton: NewtonOptions = field(default_factory=lambda: NewtonOptions(1e-10, max_move=1.0))
    force: tuple[float, ...] = ()
    sensitivities: tuple[str, ...] | None = None
    columns: ClassVar[tuple[Parameter, ...]] = RATIOS
    """of a row of a campaign's design"""

    def __post_init__(self) -> None:
        check_kinds(self, specimen=Bar, steps=StepOptions, newton=NewtonOptions)
        keep_counts(self, "field_grid", (1, 1))
        keep_targets(self)
        keep_asked(self)
        check_bulk_ratio(self.bulk_ratio)
        if self.direction not in ("tension", "compression"):
            raise ValueError(
                f"direction: expected 'tension' or 'compression', found {self.direction!r}"
            )
        if self.direction == "compression":
            check_travel(self.travel, self.specimen.length, "length")

    def points(self) -> Array:
        """(n_point, 2) reference x, y of the field points on the face z = depth, mm."""
        nx, ny = self.field_grid
        x = (np.arange(nx) + 0.5) * self.specimen.width / nx
        y = (np.arange(ny) + 0.5) * self.specimen.length / ny
        return np.stack([c.ravel() for c in np.meshgrid(x, y, indexing="ij")], axis=1)

    parameter_names = driven_response.parameter_names
    __call__ = driven_response.respond_to_ratios
    respond = driven_response.respond
    objective_gradients = driven_response.objective_gradients
    solve_for = driven_response.solve_for

    def discretise(self) -> DrivenSpecimen:
        """Tables of the one element."""
        basis = self._basis()
        table = first_order_elements(basis)
        far = table.positions > 1e-9 * table.positions.max(axis=0)
        equation = np.full(table.positions.shape, -1, dtype=np.int64)
        equation[far[:, 0], 0] = 0
        equation[far[:, 2], 2] = 1
        motion = np.zeros(table.positions.shape)
        motion[far[:, 1], 1] = 1.0 if self.direction == "tension" else -1.0
        return DrivenSpecimen(
            problem=DrivenProblem(
                elements=table,
                pattern=unknowns(table.nodes, equation.ravel()),
                motion=motion,
                on_branch=self._stretches_alike,
            ),
            points=self.points(),
            probe=field_probe(basis, self._on_face()),
            symmetry=1.0,
        )

    def _stretches_alike(self, u: Array) -> bool:
        """Whether width and depth have one stretch, as the closed form has it."""
        x, z = np.ptp(u[:, 0]) / self.specimen.width, np.ptp(u[:, 2]) / self.specimen.depth
        return bool(abs(x - z) <= ALIKE)

    def shape(self, specimen: Bar) -> Shape:
        """What moves with the dimensions, at those of `specimen`."""
        model = replace(self, specimen=specimen)
        return free_shape(model._basis().doflocs.T, model._on_face())

    def _basis(self) -> Basis:
        size = (self.specimen.width, self.specimen.length, self.specimen.depth)
        mesh = MeshHex.init_tensor(*([0.0, s] for s in size))
        return Basis(mesh, ElementHex1(), intorder=VOLUME_ORDER)

    def _on_face(self) -> Array:
        """(n_point, 3) field points, mm."""
        points = self.points()
        return np.column_stack([points, np.full(len(points), self.specimen.depth)])

    @property
    def schedule(self) -> Schedule:
        """What is asked, and how the solver gets there."""
        return Schedule(self.travel, self.steps, self.newton, self.force)
