"""The whole way in small: a known field, photographs, DIC, quality control and inference."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from virtual_blocks import field_of

from calib.data.qc import analyse
from calib.dic import CorrelationSettings
from calib.dic.stereo import StereoSettings
from calib.inference.forward import FieldBasis, Jacobian, Prediction
from calib.inference.likelihood import build_likelihood
from calib.inference.noise import NoiseSettings
from calib.inference.posterior import Posterior
from calib.inference.prior import Marginal, Prior
from calib.inference.quadrature import integrate
from calib.virtual import (
    BlockTruth,
    Cameras,
    LaboratorySettings,
    Placing,
    Protocol,
    TruthResponse,
    make_laboratory,
)
from calib.virtual.cameras import CameraPair
from calib.virtual.front_response import FrontResponse
from calib.virtual.photographs import Studio, photograph
from calib.virtual.sensor import Sensor
from calib.virtual.speckle import SpeckleSettings

KAPPA, R, S = 0.01, 0.4, 0.2
TRAVEL = np.array([0.05, 0.1, 0.2, 0.3, 0.4, 0.5])
PRIOR = Prior(
    Marginal("uniform", 0.005, 0.02), Marginal("uniform", 0.0, 1.0), Marginal("uniform", 0.0, 0.5)
)


def scale(r, s):
    """What the constants do to the components of the field."""
    return np.array([1.0 + 0.2 * (r - 0.4), 1.0 - 0.1 * (s - 0.2), 1.0 + 0.3 * (s - 0.2)])


def force(travel, kappa, r):
    """N, straight at contact."""
    return 100.0 * kappa * (1.0 + 0.3 * r) * (1.5 * travel + 0.8 * travel**3)


class ClosedForm:
    """A forward model of the same closed form, at given points and travels."""

    def __init__(self, points, travel):
        self.travel = travel
        base = np.stack([field_of(points[:, 0], points[:, 1], depth) for depth in travel])
        each = np.moveaxis(base[..., None] * np.eye(3), -1, 0)  # one mode a component
        self.field_basis = FieldBasis(np.zeros(base.shape), each, np.zeros((0, *base.shape)))

    def predict(self, theta) -> Prediction:
        kappa, r, s = theta.T
        return Prediction(force(self.travel, kappa[:, None], r[:, None]), None, scale(r, s).T)

    def jacobian(self, theta) -> Jacobian:
        raise AssertionError("a quadrature asks for no derivatives")


def laboratory(tmp_path, seed):
    x, y = np.linspace(0, 5, 33), np.linspace(0, 2.5, 17)
    fields = [field_of(x[:, None], y[None], depth) * scale(R, S) for depth in TRAVEL]
    block = BlockTruth(KAPPA * (1 - R), KAPPA * R, KAPPA * S)
    response = FrontResponse(x, y, TRAVEL, force(TRAVEL, 1.0, R), np.stack(fields))
    truth = TruthResponse(block, response)
    settings = LaboratorySettings(
        samples=4,
        machine_format="softcal",
        cameras=Cameras(format="softcal", grid=(12, 5)),
        placing=Placing(misplaced=0, camera_roll_deg=0.0),
        protocol=Protocol(increments=2, preconditioning_travel_mm=0.3),
        use=(1, 2),
    )
    studio = Studio(
        cameras=CameraPair(columns=330, rows=120, pixel_mm=0.0135, target=(0.4, 0.1, 2.0)),
        sensor=Sensor(read_noise=0.01),
        speckle=SpeckleSettings(0.16, 0.22),
        stereo=StereoSettings(CorrelationSettings(subset=21, order=2, max_sigma=0.5)),
        spacing_mm=0.3,
        edge_mm=0.4,
        static_frames=3,
        material_step_mm=0.1,
    )
    samples = make_laboratory(tmp_path / "lab", truth, settings, seed)
    photograph(tmp_path / "lab", truth, samples, studio, seed)
    told = json.loads((tmp_path / "lab" / "truth.json").read_text())
    assert told["photographs"]["studio"]["spacing_mm"] == 0.3
    assert set(told["settings"]["cameras"]) == {"clock_s", "trigger_s", "trigger_sd_s"}
    return truth, analyse(tmp_path / "lab")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return laboratory(tmp_path_factory.mktemp("photographs"), 1)


@pytest.mark.lasting
def test_the_field_of_the_data_set_is_that_of_the_truth(made):
    truth, result = made
    assert not result.rejections
    field = result.dataset.field
    off = field.displacement - truth.field_at(field.points, result.dataset.travel)
    # the zero of the travel is common to all points: 5 um of SD over four samples, and a fold
    # that moves by 0.9 mm a mm
    assert np.sqrt((off**2).mean(axis=(0, 1))).max() < 0.006
    assert np.all(field.noise_std < 0.002)


@pytest.mark.lasting
def test_the_posterior_of_photographs_holds_the_truth(made):
    _, result = made
    dataset = replace(result.dataset, samples=None)
    forward = ClosedForm(dataset.field.points, dataset.travel)
    likelihood = build_likelihood(
        dataset, forward, NoiseSettings(travel_zero_sd=0.01), field_floor=5e-4
    )
    found = integrate(Posterior(PRIOR, likelihood), 8)
    z = (found.mean - (np.log(KAPPA), R, S)) / found.sd
    assert np.abs(z).max() < 3.0
    # and photographs say far more of r and s than the prior
    assert np.all(found.sd[1:] < np.array([1.0, 0.5]) / np.sqrt(12) / 3.0)
