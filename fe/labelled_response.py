"""A response with named dimensions, coordinates and units, as xarray keeps them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fe.response import Response

if TYPE_CHECKING:
    import xarray as xr


def labelled(response: Response) -> xr.Dataset:
    """The response as a Dataset: select by travel, place or parameter, plot, write as netCDF.

    Dimensions are `travel` (mm; steps that were not reached hold NaN), `point`, `component` and
    `parameter`; positions of the points, mm, are coordinates, named after the first two of the
    response's components. Every variable has its unit as an attribute, the Dataset what became of
    the run. At asked forces the travels found are the coordinate.
    """
    import xarray as xr  # here: it takes as long to import as all of fe

    seen: dict[str, Any] = {"travel": ("travel", response.travel, {"units": "mm"})}
    if len(response.points) == response.displacement.shape[1]:
        for axis, position in zip(response.components, response.points.T, strict=False):
            seen[axis] = ("point", position, {"units": "mm"})
    field = ("travel", "point", "component")
    variables: dict[str, Any] = {
        "force": ("travel", response.force, {"units": "N"}),
        "displacement": (field, response.displacement, {"units": "mm"}),
        "negative_pivots": ("travel", response.negative_pivots, {"units": "1"}),
        "force_gradient": (
            ("travel", "parameter"),
            response.force_gradient,
            {"units": "N per unit of the parameter"},
        ),
        "displacement_gradient": (
            (*field, "parameter"),
            response.displacement_gradient,
            {"units": "mm per unit of the parameter"},
        ),
    }
    if response.travel_gradient.size:
        variables["travel_gradient"] = (
            ("travel", "parameter"),
            response.travel_gradient,
            {"units": "mm per unit of the parameter"},
        )
    return xr.Dataset(
        variables,
        coords=seen
        | {"component": list(response.components), "parameter": list(response.parameters)},
        attrs={
            "status": str(response.status),
            "message": response.message,
            "reached_mm": response.reached,
            "n_steps": response.n_steps,
            "n_iterations": response.n_iterations,
            "n_factorisations": response.n_factorisations,
            "seconds": response.seconds,
            "solver": response.solver,
        },
    )
