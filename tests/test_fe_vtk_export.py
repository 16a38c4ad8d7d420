"""The file read back by meshio and, where it is installed, by VTK itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fe
from fe.materials import material

meshio = pytest.importorskip("meshio")

YEOH = material("yeoh", (0.02, 0.004, 0.001), 6.0)
MODEL = fe.BlockPinModel(
    fe.BlockPin(pin="round"), fe.Contact("stick", "stick"), (2, 1, 2), (0.1, 0.2)
)


@pytest.fixture(scope="module")
def solved():
    states, _, _ = MODEL.solve_for(YEOH)
    return MODEL.discretise().elements, states[-1]


@pytest.fixture(scope="module", params=["vtu", "vtk"])
def stored(request, solved, tmp_path_factory):
    path = tmp_path_factory.mktemp("vtk") / f"block.{request.param}"
    fe.export_vtk(path, solved[0], solved[1].u, YEOH)
    return path


def test_displacement_and_force_come_back(solved, stored):
    elements, state = solved
    mesh = meshio.read(stored)
    np.testing.assert_array_equal(mesh.points, elements.positions)
    np.testing.assert_array_equal(mesh.point_data["displacement_mm"], state.u)
    force = mesh.point_data["force_N"]
    top = mesh.points[:, 1] > MODEL.specimen.height - 1e-9
    # the pin presses down what the base presses up
    assert -force[top, 1].sum() == pytest.approx(state.pin_force, rel=1e-4)
    assert force[~top, 1].sum() == pytest.approx(state.pin_force, rel=1e-4)


def test_every_element_is_a_triquadratic_hexahedron(solved, stored):
    (block,) = meshio.read(stored).cells
    assert block.type == "hexahedron27"
    assert block.data.shape == (4, 27)
    np.testing.assert_array_equal(np.sort(block.data), np.sort(solved[0].nodes))
    X = solved[0].positions[block.data]
    sides = np.stack([X[:, i] - X[:, 0] for i in (1, 3, 4)], axis=1)
    assert (np.linalg.det(sides) > 0.0).all()
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5)]
    for node, (a, b) in enumerate([*edges, (2, 6), (3, 7)], start=8):
        np.testing.assert_allclose(X[:, node], (X[:, a] + X[:, b]) / 2.0, atol=1e-12)


def test_vtk_itself_finds_every_node_where_its_own_shape_functions_put_it(stored):
    pytest.importorskip("vtkmodules")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOLegacy import vtkUnstructuredGridReader
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    reader = (
        vtkXMLUnstructuredGridReader() if stored.suffix == ".vtu" else vtkUnstructuredGridReader()
    )
    reader.SetFileName(str(stored))
    reader.Update()
    grid = reader.GetOutput()
    assert grid.GetNumberOfCells() == 4
    points = vtk_to_numpy(grid.GetPoints().GetData())
    for c in range(4):
        cell = grid.GetCell(c)
        assert cell.GetClassName() == "vtkTriQuadraticHexahedron"
        nodes = [cell.GetPointId(k) for k in range(27)]
        own = np.array(cell.GetParametricCoords()[:81]).reshape(27, 3)
        corner, size = points[nodes[0]], points[nodes[6]] - points[nodes[0]]
        axes = [np.flatnonzero(np.abs(points[nodes[k]] - corner) > 1e-9)[0] for k in (1, 3, 4)]
        expected = np.tile(corner, (27, 1))
        expected[:, axes] += own * size[axes]
        np.testing.assert_allclose(points[nodes], expected, atol=1e-6)


SPECIMENS = {
    "uniaxial": (fe.UniaxialModel(fe.Bar(2.0, 3.0, 1.5), (0.3,)), "hexahedron", 8),
    "tensile": (
        fe.TensileModel(fe.NotchedPlate(), (2, 3, 1), (2.0,), field_grid=(2, 3)),
        "hexahedron27",
        27,
    ),
    "cylinder": (fe.CylinderModel(fe.Cylinder(), (3, 2), (1.0,), "bonded"), "quad9", 9),
    "cylinder that rubs": (
        fe.CylinderModel(fe.Cylinder(), (3, 2), (1.0,), friction=0.2),
        "quad9",
        9,
    ),
    "block in plane strain": (
        replace(MODEL, specimen=fe.BlockPin(), cells=(2, 1, 1), plane_strain=True),
        "hexahedron27",
        27,
    ),
}


@pytest.mark.parametrize("suffix", ["vtu", "vtk"])
@pytest.mark.parametrize("name", SPECIMENS)
def test_every_specimen_is_read_back_with_its_mesh_motion_and_force(name, suffix, tmp_path):
    model, kind, n_local = SPECIMENS[name]
    told = []
    states, outcome, n_factorisations = model.solve_for(YEOH, progress=told.append)
    assert told[-1].travel == states[-1].travel == outcome.reached == model.travel[-1]
    assert n_factorisations > 0
    discrete, state = model.discretise(), states[-1]
    fe.export_vtk(tmp_path / f"a.{suffix}", discrete.elements, state.u, YEOH)
    mesh = meshio.read(tmp_path / f"a.{suffix}")
    (block,) = mesh.cells
    assert block.type == kind
    assert block.data.shape == (len(discrete.elements.nodes), n_local)
    n_dim = 2 if kind == "quad9" else 3
    corner = mesh.points[block.data[:, 0]]
    nearest = [1, 3, 4][:n_dim]
    sides = np.stack([mesh.points[block.data[:, i]] - corner for i in nearest], axis=1)
    assert (np.linalg.det(sides[..., :n_dim]) > 0.0).all()
    middle = mesh.points[block.data].mean(axis=1)
    corners = mesh.points[block.data[:, : 2**n_dim]].mean(axis=1)
    np.testing.assert_allclose(middle, corners, atol=1e-12)
    moved, force = mesh.point_data["displacement_mm"], mesh.point_data["force_N"]
    np.testing.assert_array_equal(moved, state.u[: len(mesh.points)])
    far = mesh.points[:, 1] > mesh.points[:, 1].max() - 1e-9
    # plates and clamps move their end by half the travel, a bar by all of it
    pressed_by_pin = name == "block in plane strain"
    share = 1.0 if pressed_by_pin else np.abs(moved[far, 1]).max() / model.travel[-1]
    along = np.sign(moved[far, 1].sum()) * force[far, 1].sum()
    assert share * along == pytest.approx(state.pin_force, rel=1e-4)
    if name.startswith("cylinder"):  # along the radius too, hoop stresses balance the others inside
        inside = (mesh.points[:, :2] > 1e-9).all(axis=1)
        inside &= (mesh.points[:, :2] < mesh.points[:, :2].max(axis=0) - 1e-9).all(axis=1)
        assert inside.any()
        assert np.abs(force[inside]).max() < 1e-5 * np.abs(force).max()


def test_what_does_not_fit_is_refused(solved, tmp_path):
    elements, state = solved
    with pytest.raises(ValueError, match="u: expected shape"):
        fe.export_vtk(tmp_path / "a.vtu", elements, state.u[1:], YEOH)
    five = elements._replace(nodes=elements.nodes[:, :5])
    with pytest.raises(ValueError, match=r"elements: expected hexahedra of 27 or 8 .* found 5"):
        fe.export_vtk(tmp_path / "a.vtu", five, state.u, YEOH)


def test_solving_for_a_material_is_what_the_response_is_made_of(solved):
    response = replace(MODEL, field_grid=(3, 2)).respond(YEOH)
    assert response.force[-1] == pytest.approx(4.0 * solved[1].pin_force, rel=1e-12)


def test_another_suffix_is_refused(solved, tmp_path):
    with pytest.raises(ValueError, match=r"path: expected a name that ends in \.vtu or \.vtk"):
        fe.export_vtk(tmp_path / "block.foo", solved[0], solved[1].u, YEOH)
