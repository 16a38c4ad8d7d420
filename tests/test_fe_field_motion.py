"""What field points see of nodal values, against scikit-fem and against other places."""

from __future__ import annotations

import numpy as np
import pytest
from skfem import Basis, ElementHex2, ElementQuad2, MeshHex, MeshQuad

from fe.field_motion import field_probe, passing


def blocks() -> list[Basis]:
    """A distorted block of hexahedra and a distorted sheet."""
    solid = MeshHex.init_tensor(*[np.linspace(0.0, size, 4) for size in (1.0, 2.0, 3.0)])
    sheet = MeshQuad.init_tensor(np.linspace(0.0, 1.0, 4), np.linspace(0.0, 2.0, 5))
    bases = []
    for mesh, element in ((solid, ElementHex2()), (sheet, ElementQuad2())):
        moved = mesh.p * (1.0 + 0.05 * mesh.p[::-1])  # lines that are no longer parallel
        bases.append(Basis(type(mesh)(moved, mesh.t), element, intorder=2))
    return bases


def inner_points(basis: Basis, n: int = 40) -> np.ndarray:
    rng = np.random.default_rng(4)
    low, high = basis.mesh.p.min(axis=1), basis.mesh.p.max(axis=1)
    shares = rng.uniform(0.15, 0.85, (n, len(low)))
    return low + shares * (high - low)


@pytest.mark.parametrize("basis", blocks(), ids=["block", "sheet"])
def test_values_are_those_of_scikit_fem(basis: Basis) -> None:
    at = inner_points(basis)
    probe = field_probe(basis, at)
    assert abs(probe.values - basis.probes(at.T)).max() < 1e-12


@pytest.mark.parametrize("basis", blocks(), ids=["block", "sheet"])
def test_slopes_are_those_of_a_linear_field_and_of_differences(basis: Basis) -> None:
    at = inner_points(basis)
    rates = np.arange(1.0, 1.0 + at.shape[1])
    probe = field_probe(basis, at)
    linear = rates @ basis.doflocs
    for slope, rate in zip(probe.slopes, rates, strict=True):
        assert slope @ linear == pytest.approx(np.full(len(at), rate), abs=1e-10)
    nodal = np.random.default_rng(5).standard_normal(basis.N)
    for axis, slope in enumerate(probe.slopes):
        step = 1e-6 * np.eye(at.shape[1])[axis]
        sides = [field_probe(basis, at + sign * step).values @ nodal for sign in (1.0, -1.0)]
        found = (sides[0] - sides[1]) / 2e-6
        close = np.isclose(found, slope @ nodal, rtol=1e-5, atol=1e-5)
        assert close.mean() > 0.95  # but where the two places are in different elements


def test_hidden_nodes_are_not_seen_and_points_that_stay_see_no_slope() -> None:
    basis = blocks()[1]
    at = inner_points(basis)
    probe = field_probe(basis, at, n_hidden=3)
    assert probe.values.shape == (len(at), basis.N + 3)
    assert probe.values[:, basis.N :].nnz == 0
    still = passing(np.full((len(at), 2, 1), 1e-10), probe)
    assert still.slopes == () and not still.passed.any()
    moving = passing(np.full((len(at), 2, 1), 0.1), probe)
    u = np.random.default_rng(6).standard_normal((basis.N + 3, 3))
    expected = 0.1 * sum(slope @ u for slope in probe.slopes)
    assert moving.seen(u)[..., 0] == pytest.approx(expected)
    assert np.array_equal(still.seen(u), np.zeros((len(at), 3, 1)))


def test_a_point_outside_the_mesh_is_refused() -> None:
    basis = blocks()[0]
    with pytest.raises(ValueError):
        field_probe(basis, np.array([[5.0, 5.0, 5.0]]))
