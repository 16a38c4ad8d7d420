"""From photographs to a posterior, and how often it holds the truth.

    python -m benchmarks.end_to_end [20] [runs/end_to_end] [--contact friction]

Each seed has a truth of its own (kappa, r, s drawn from the prior), solved on a finer mesh than
that of the emulator, photographed by two virtual cameras, correlated, triangulated, read by the
readers and the quality control, and compared with one emulator that all seeds share.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.data import Dataset
from calib.data.dataset_file import load_dataset, save_dataset
from calib.data.qc import analyse
from calib.dic.settings import CorrelationSettings
from calib.dic.stereo import StereoSettings
from calib.inference.forward import EmulatorForward
from calib.inference.likelihood import build_likelihood
from calib.inference.noise import NoiseSettings
from calib.inference.posterior import Posterior
from calib.inference.prior import Marginal, Prior
from calib.inference.quadrature import integrate
from calib.study.mesh_error import MeshError
from calib.study.usual_meshes import ROUGH_ORDER, SMOOTH_ORDER
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
from calib.virtual.front_response import FrontResponse, load_front, save_front, solve_front
from calib.virtual.photographs import Studio, photograph
from calib.virtual.sensor import Sensor
from calib.virtual.speckle import SpeckleSettings
from fe.response import Array
from fe.specimens.block_pin import BlockPin, BlockPinModel, Contact
from surrogate import Emulator, ScaledEmulator, TrainingSet

N_TRAINING = 48
SAMPLES = 4
"""n, at p = 2 increments: the mean force misses its truth as a Student-t of n - p degrees with the
scale (n - 1) / (n - p) / n times the covariance between the samples (Hotelling)"""
TRAVEL = (0.1, 0.3, 0.6, 0.7)
USED = (1, 2)
PRIOR = Prior(
    Marginal("uniform", 0.005, 0.02), Marginal("uniform", 0.0, 1.0), Marginal("uniform", 0.0, 0.5)
)
SAFE = 0.15
"""share of the prior's range at each end from which no truth is drawn: a posterior that the bound
cuts off covers its truth by chance of where the bound is"""
N_NODES = 32
"""for each parameter: tails of a Student-t are long, and with 18 its peak falls between nodes"""
LEVEL = 0.95


@dataclass(frozen=True)
class Case:
    """A contact, and three different meshes of the block."""

    name: str
    contact: Contact
    coarse: tuple[int, int, int]
    """cells of the emulator's runs"""
    check: tuple[int, int, int]
    """of the measure of their error"""
    truth: tuple[int, int, int]
    """of the truths"""
    field_order: float
    """at which errors of the field are taken to fall, as studies do"""


SLIDING = Case(
    "sliding", Contact("slide", "slide"), (12, 4, 2), (16, 6, 3), (18, 7, 3), SMOOTH_ORDER
)
"""a run takes seconds"""
FRICTION = Case("friction", Contact(0.15, 0.15), (12, 3, 3), (16, 5, 4), (20, 6, 5), ROUGH_ORDER)
"""the coefficient of `calib laboratory`"""
CASES = {case.name: case for case in (SLIDING, FRICTION)}


@dataclass(frozen=True)
class Outcome:
    """One seed: where the truth lies in the posterior."""

    truth: Array
    """(3,) kappa [MPa], r, s"""
    z: Array
    """(3,) posterior mean less truth in posterior SDs of (ln kappa, r, s)"""
    sd: Array
    """(3,) posterior SDs"""
    mass: float
    """posterior probability of what is more probable than the truth"""

    @property
    def is_covered(self) -> bool:
        """Whether the truth lies in the region of highest density that holds 95 %."""
        return self.mass <= LEVEL


def studio() -> Studio:
    """Cameras of 560 x 224 px, a noise of 1 % of full scale, subsets of 21 px."""
    return Studio(
        cameras=CameraPair(columns=560, rows=224, pixel_mm=0.008, target=(0.4, 0.1, 2.0)),
        sensor=Sensor(read_noise=0.01),
        speckle=SpeckleSettings(0.1, 0.14),
        stereo=StereoSettings(
            CorrelationSettings(subset=21, order=2, min_zncc=0.85, max_sigma=0.5), max_epipolar=1.0
        ),
        static_frames=3,
    )


def settings() -> LaboratorySettings:
    """Four samples, two increments of 0.3 mm."""
    return LaboratorySettings(
        samples=SAMPLES,
        machine_format="softcal",
        cameras=Cameras(format="softcal", grid=(30, 8)),
        placing=Placing(misplaced=0, camera_roll_deg=0.0),
        protocol=Protocol(increment_mm=0.3, increments=2, preconditioning_travel_mm=0.6),
        use=USED,
    )


def solved(case: Case, cells: tuple[int, int, int], ratios: Array, folder: Path) -> FrontResponse:
    """One run, kept in `folder`."""
    name = "-".join(map(str, (case.name, *cells, *np.round(ratios, 6))))
    path = folder / f"{name}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        model = BlockPinModel(BlockPin(), case.contact, cells, TRAVEL, sensitivities=())
        save_front(path, solve_front(model, ratios))
    return load_front(path)


def design() -> Array:
    """(n, 2) ratios (r, s) of the emulator's runs: Sobol points with the corners."""
    from scipy.stats import qmc

    inner = qmc.Sobol(2, rng=np.random.default_rng(1)).random(64)[: N_TRAINING - 4]
    corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]], dtype=np.float64)
    return np.vstack([corners, inner]) * np.array([1.0, 0.5])


def training(
    case: Case, runs: Path, points: Array, travel: Array, n_training: int = N_TRAINING
) -> tuple[TrainingSet, MeshError]:
    """The emulator's runs and the error of their mesh at points (n, 2) mm and travels, mm."""
    ratios = design()[:n_training]
    coarse = [solved(case, case.coarse, one, runs) for one in ratios]
    checks = np.array([[0.3, 0.1], [0.7, 0.35]])
    both = (case.coarse, case.check)
    pairs = [tuple(solved(case, cells, one, runs) for cells in both) for one in checks]
    refinement = float((np.prod(case.check) / np.prod(case.coarse)) ** (1.0 / 3.0))
    mesh = MeshError(
        refinement,
        checks,
        np.array([a.force_at(travel) / b.force_at(travel) - 1.0 for a, b in pairs]),
        np.array([a.field_at(points, travel) - b.field_at(points, travel) for a, b in pairs]),
        points=points,
        field_order=case.field_order,
    )
    return TrainingSet(
        ratios,
        np.array([run.force_at(travel) for run in coarse]),
        np.array([run.field_at(points, travel) for run in coarse]),
    ), mesh


def draw_truth(seed: int) -> Array:
    """(3,) kappa, r, s within the inner part of the prior's box."""
    low, high = np.array([0.005, 0.0, 0.0]), np.array([0.02, 1.0, 0.5])
    share = SAFE + (1.0 - 2.0 * SAFE) * np.random.default_rng(seed).random(3)
    found: Array = low + share * (high - low)
    return found


def truth_response(case: Case, theta: Array, runs: Path) -> TruthResponse:
    """The block of theta = (kappa [MPa], r, s) on the truths' mesh; solved once, kept in `runs`."""
    kappa, r, s = theta
    truth = BlockTruth(
        kappa * (1.0 - r), kappa * r, kappa * s, contact=case.contact, cells=case.truth,
        shift_cells=None, travel=TRAVEL, fine_travel=TRAVEL[-1], stiffening=1.0,
    )  # fmt: skip
    return TruthResponse(truth, solved(case, case.truth, theta[1:], runs))


def dataset_of(case: Case, seed: int, runs: Path) -> tuple[Array, Dataset]:
    """The truth of a seed, and what photographs and the test machine's files make of it."""
    theta = draw_truth(seed)
    kept = runs / f"photographs-{case.name}-{SAMPLES}-{seed}.npz"
    if kept.exists():
        return theta, load_dataset(kept)[0]
    response = truth_response(case, theta, runs)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "laboratory"
        samples = make_laboratory(folder, response, settings(), seed)
        photograph(folder, response, samples, studio(), seed)
        found = analyse(folder)
    if found.dataset is None:
        raise ValueError(f"seed {seed}: expected a data set, found {found.rejections}")
    save_dataset(kept, found.dataset)
    return theta, found.dataset


def at_points(dataset: Dataset, points: Array) -> Dataset:
    """The data set at some of its points (n, 2) mm, which every data set has."""
    field = dataset.field
    assert field is not None
    here = {tuple(np.round(place, 6)): i for i, place in enumerate(field.points)}
    index = np.array([here[tuple(np.round(place, 6))] for place in points])
    patterns = None if field.patterns is None else field.patterns[..., index, :]
    thinned = replace(
        field, points=points, displacement=field.displacement[:, index], patterns=patterns
    )
    return replace(dataset, field=thinned, samples=None)


def common_points(datasets: list[Dataset]) -> Array:
    """(n, 2) points of the face that all data sets have, mm."""
    shared = set.intersection(
        *({tuple(np.round(p, 6)) for p in one.field.points} for one in datasets if one.field)
    )
    return np.array(sorted(shared))


def outcome(theta: Array, dataset: Dataset, emulator: Emulator, mesh: MeshError) -> Outcome:
    """Where a truth lies in the posterior of its data set."""
    forward = EmulatorForward(ScaledEmulator(emulator), with_field=True, correction=mesh.correction)
    noise = NoiseSettings(force_freedom=dataset.n_samples - dataset.travel.size)
    likelihood = build_likelihood(
        dataset, forward, noise, force_discretisation=mesh.force,
        field_floor=mesh.field_floor, field_patterns=mesh.field_patterns(dataset, noise, forward),
    )  # fmt: skip
    posterior = Posterior(PRIOR, likelihood)
    found = integrate(posterior, N_NODES)
    x = np.array([np.log(theta[0]), *theta[1:]])
    density = np.append(posterior.log_prob(found.x), posterior.log_prob(x[None]))
    mass = float(found.weights[density[:-1] > density[-1]].sum())
    return Outcome(theta, (found.mean - x) / found.sd, found.sd, mass)


def over_seeds(case: Case, seeds: range, runs: Path) -> list[Outcome]:
    """Photograph every seed first, then infer with one emulator at the points all have."""
    made = []
    for seed in seeds:
        made.append(dataset_of(case, seed, runs))
        print(f"seed {seed}: truth {np.round(made[-1][0], 4)} photographed", flush=True)
    points = common_points([dataset for _, dataset in made])
    train, mesh = training(case, runs, points, made[0][1].travel)
    emulator = Emulator.fit(train, 1)
    found = []
    for seed, (theta, dataset) in zip(seeds, made, strict=True):
        found.append(outcome(theta, at_points(dataset, points), emulator, mesh))
        one = found[-1]
        print(f"seed {seed}: z {np.round(one.z, 2)}, SD {one.sd.round(4)}, mass {one.mass:.3f}")
    return found


def main() -> None:
    """Print every seed and how many are covered."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("n", nargs="?", type=int, default=20, help="seeds, from 0 on")
    parser.add_argument(
        "runs", nargs="?", type=Path, default=Path("runs/end_to_end"), help="where runs are kept"
    )
    parser.add_argument("--contact", choices=CASES, default=SLIDING.name)
    args = parser.parse_args()
    found = over_seeds(CASES[args.contact], range(args.n), args.runs)
    z = np.array([one.z for one in found])
    print(f"covered: {sum(one.is_covered for one in found)} of {args.n}")
    print(f"z of ln kappa, r, s: mean {z.mean(axis=0).round(2)}, scatter {z.std(axis=0).round(2)}")


if __name__ == "__main__":
    main()
