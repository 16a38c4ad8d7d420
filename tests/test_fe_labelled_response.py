"""A response with labels holds the same numbers, found by name, and survives a netCDF file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from fe import (
    BlockPin,
    BlockPinModel,
    Contact,
    Cylinder,
    CylinderModel,
    Disc,
    DiscPinModel,
    Response,
    labelled,
    load_response,
    save_response,
)


@pytest.fixture(scope="module")
def response() -> Response:
    model = BlockPinModel(BlockPin(), Contact("slide", "slide"), (3, 2, 1), (0.1, 0.2))
    return model(np.array([0.3, 0.1]))


def test_values_are_found_by_travel_component_and_parameter(response: Response) -> None:
    found = labelled(response)
    assert float(found.force.sel(travel=0.2)) == response.force[1]
    out = found.displacement.sel(travel=0.1, component="z")
    np.testing.assert_array_equal(out, response.displacement[0, :, 2])
    by_s = found.force_gradient.sel(parameter="s")
    np.testing.assert_array_equal(by_s, response.force_gradient[:, 1])


def test_points_are_coordinates_in_mm(response: Response) -> None:
    found = labelled(response)
    np.testing.assert_array_equal(found.x, response.points[:, 0])
    np.testing.assert_array_equal(found.y, response.points[:, 1])
    assert {found[name].attrs["units"] for name in ("x", "y", "travel", "displacement")} == {"mm"}
    assert found.force.attrs["units"] == "N" and found.attrs["status"] == "converged"


def test_a_response_without_kept_points_has_none(response: Response) -> None:
    from dataclasses import replace

    found = labelled(replace(response, points=np.zeros((0, 2))))
    assert "x" not in found.coords and found.sizes["point"] == response.displacement.shape[1]


def test_labels_survive_a_file(response: Response, tmp_path: Path) -> None:
    labelled(response).to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "run.nc", engine="h5netcdf") as again:
        xr.testing.assert_identical(again.load(), labelled(response))


def test_an_asked_force_brings_the_travels_found() -> None:
    model = BlockPinModel(
        BlockPin(), Contact("slide", "slide"), (2, 2, 1), travel=(), force=(2.0, 4.0)
    )
    response = model(np.array([0.3, 0.1]))
    found = labelled(response)
    np.testing.assert_array_equal(found.travel, response.travel)
    assert found.travel_gradient.dims == ("travel", "parameter")


def test_what_is_seen_of_a_body_of_revolution_is_named_by_radius_and_height(
    tmp_path: Path,
) -> None:
    models = (
        CylinderModel(Cylinder(), (3, 2), (1.0,), n_point=4),
        DiscPinModel(Disc(), Contact("slide", "slide"), (3, 2), (0.1,), n_point=4),
    )
    for model in models:
        response = model(np.array([0.3, 0.1]))
        found = labelled(response)
        assert list(found.component.values) == ["radius", "height", "none"]
        np.testing.assert_array_equal(found.radius, response.points[:, 0])
        save_response(tmp_path / "run.npz", response)
        assert load_response(tmp_path / "run.npz").components == response.components


def test_how_much_the_solver_did_is_told(response: Response) -> None:
    assert 2 <= response.n_steps <= response.n_iterations
    attributes = labelled(response).attrs
    assert attributes["n_steps"] == response.n_steps
    assert attributes["n_iterations"] == response.n_iterations
