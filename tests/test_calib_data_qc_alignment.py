"""Samples that stand differently are brought together before their mean is taken."""

from __future__ import annotations

import numpy as np
import pytest
from virtual_blocks import analytic_truth

from calib.data.qc import analyse
from calib.data.qc.alignment import Aligned, unresolved
from calib.data.qc.averaging import Placing as PlacingErrors
from calib.data.qc.averaging import mean_field
from calib.data.qc.mapping import map_coarsely, map_field
from calib.inference.field_noise import field_covariance
from calib.virtual import Cameras, LaboratorySettings, Placing, make_laboratory


def lattice(function, n=12, h=0.1):
    """(1, n, n, 3) values of a function of x and y on a lattice."""
    x, y = np.meshgrid(h * np.arange(n), h * np.arange(n))
    return np.repeat(function(x, y)[None, ..., None], 3, axis=3)


AT = np.array([[5.3, 4.8], [6.5, 3.2], [4.9, 6.1]])


def test_the_parabola_of_incomplete_neighbours_is_exact_for_a_parabola():
    def bent(x, y):
        return 1 + x - 2 * y + 3 * x * x - x * y + 0.5 * y * y

    values = lattice(bent)
    values[0, 5, 6] = values[0, 3, 6] = values[0, 6, 4] = np.nan
    expected = bent(*(0.1 * AT.T))
    for found in (map_field(values, AT, "shape"), map_coarsely(values, AT)):
        np.testing.assert_allclose(found[0], np.repeat(expected[:, None], 3, axis=1), atol=1e-6)


def test_an_edge_of_the_field_shows_in_the_coarser_mapping_and_a_smooth_field_does_not():
    edge = lattice(lambda x, _: np.abs(x - 0.53))
    smooth = lattice(lambda x, y: np.sin(x + 0.5 * y))
    off = [np.abs(map_coarsely(v, AT) - map_field(v, AT, "shape"))[0, 0, 0] for v in (edge, smooth)]
    assert off[0] > 0.01 and off[1] < 1e-3


@pytest.mark.parametrize("dx", [0.2, 0.28, 0.14])
def test_an_edge_that_is_not_resolved_runs_on_over_points_beside_it(dx):
    """Changes of 1.2 SDs count where they join a larger one, those below 1 and lone ones do not.

    Along either axis, however far apart its points are.
    """
    x, y = np.meshgrid(dx * np.arange(6), 0.2 * np.arange(5), indexing="ij")
    points, noise = np.stack([x.ravel(), y.ravel()], axis=1), np.array([1e-3, 1e-3, 2e-3])
    coarse = np.zeros((2, 6, 5, 3))
    coarse[1, 1, :4, 0] = [-1.2e-3, 1.6e-3, 1.2e-3, 0.9e-3]
    coarse[0, 2, 2, 2] = 2.4e-3  # beside a weak one
    coarse[0, 4, 4, 1] = 1.4e-3  # alone
    coarse[0, 5, 0, 1] = np.nan
    nothing = np.zeros_like(coarse.reshape(2, 30, 3))
    placing = PlacingErrors(nothing, nothing, np.zeros((1, 3)))
    found = Aligned(nothing[None], placing, coarse.reshape(2, 30, 3), nothing)
    edge = [[1, 0], [1, 1], [1, 2], [2, 2], [5, 0]]
    # noise alone changes by 0, 0.45 and 0.5 SDs: the last makes 1.6 SDs by chance
    for scatter, expected in ((0.0, edge), (0.45, edge), (0.5, [[5, 0]])):
        noisy = found._replace(coarse_sd=nothing + scatter * noise)
        lost = np.argwhere(unresolved(noisy, noise, points).reshape(6, 5))
        assert lost.tolist() == expected


def test_where_no_scatter_is_known_noise_alone_tells_what_is_not_resolved():
    points = np.array([[0.0, 0.0], [0.2, 0.0], [0.4, 0.0], [0.0, 0.2], [0.2, 0.2], [0.4, 0.2]])
    coarse = np.zeros((1, 6, 3))
    coarse[0, 2, 1] = 1.6e-3
    nothing = np.zeros_like(coarse)
    placing = PlacingErrors(nothing, nothing, np.zeros((1, 3)))
    found = Aligned(nothing[None], placing, coarse, np.full_like(coarse, np.nan))
    assert np.flatnonzero(unresolved(found, np.full(3, 1e-3), points)).tolist() == [2]


@pytest.mark.lasting
def test_the_mean_field_of_a_virtual_laboratory_is_the_truth_within_its_stated_errors(tmp_path):
    """False alarm below 1e-3: 2,900 numbers and their stated noise scatter by 3 % each; 3.5 SD.

    A common error of the contact is not in the scatter of the samples: a study has the SD of the
    travel's zero for it, as here.
    """
    settings = LaboratorySettings(
        samples=10, cameras=Cameras(grid=(80, 21)), placing=Placing(misplaced=0)
    )
    truth = analytic_truth()
    make_laboratory(tmp_path / "lab", truth, settings, 0)
    data = analyse(tmp_path / "lab").dataset
    places, travel = data.field.points, data.travel
    off = (data.field.displacement - truth.field_at(places, travel))[None]
    slope = (truth.field_at(places, travel + 0.01) - truth.field_at(places, travel - 0.01)) / 0.02
    covariance = field_covariance(data.field, patterns=0.03 * slope[None])
    assert off.size > 2500
    assert covariance.inner(off, off).item() / off.size == pytest.approx(1.0, abs=0.15)


@pytest.mark.lasting
def test_what_samples_are_moved_by_is_an_error_of_their_mean_still(tmp_path):
    settings = LaboratorySettings(
        samples=6, cameras=Cameras(grid=(60, 16)), placing=Placing(misplaced=0)
    )
    make_laboratory(tmp_path / "lab", analytic_truth(), settings, 5)
    result = analyse(tmp_path / "lab")
    assert result.mean is not None
    # sixty points along 10.4 mm: a base is found to some 0.05 mm, and aligned to micrometres
    assert np.abs(result.mean.place_errors[:, 1]).max() < 0.01
    plain = mean_field(result.fields, result.points, result.dataset.travel, 0.9, None)
    size = [np.sqrt(np.mean(m.patterns**2)) for m in (result.mean, plain)]
    assert size[0] > 2 * size[1]
