"""Virtual experiments drawn from the prior, and where their truths lie in their posteriors.

Forces are the mean of 23 samples with the SDs of Table 5.1, taken as known; the field of 840 points
has the noise of the study `virtual`. Both errors are correlated, and share the zero of the travel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.calibration_runs import prior, study
from calib.data import FieldData, thesis_forces
from calib.data.dataset import Dataset
from calib.inference import (
    EmulatorForward,
    ForwardModel,
    Likelihood,
    Marginal,
    NoiseSettings,
    Posterior,
    Prediction,
    Prior,
    build_likelihood,
    integrate,
    theta_of,
)
from calib.inference.forward import FieldBasis, Jacobian
from calib.inference.mesh_correction import MeshCorrection
from calib.inference.weighted_draws import draw_weighted
from calib.study.mesh_error import MeshError
from calib.study.posterior_setup import noise_of
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import ScaledEmulator

KAPPA = (0.003, 0.03)
"""MPa; that of Table 5.1 under sliding is 0.011: for a tenth or ten times of it, its SDs would not
be those of such forces"""
FIELD_NOISE = np.array([0.01, 0.01, 0.02])
"""mm"""
CORRELATION_LENGTH = 0.5
"""mm"""
REFERENCE_SHARE = 0.5
N_DRAWS = 4096
FEWEST_EFFECTIVE = 400.0
"""effective draws below which a posterior is sampled again with eight times as many"""


@dataclass(frozen=True)
class Experiments:
    """n experiments and their truths."""

    x: Array
    """(n, 3) (ln kappa, r, s)"""
    force: Array
    """(n, n_step) measured, N"""
    field: Array
    """(n, n_step, n_point, 3) measured, mm"""
    run: Array
    """(n,) number of the FE run behind each; of the experiment itself where there is none"""


@dataclass(frozen=True)
class Placed:
    """Where truths lie in their posteriors."""

    below: Array
    """(n, 3) posterior probability below the truth of each coordinate"""
    mean: Array
    """(n, 3)"""
    sd: Array
    """(n, 3)"""
    ess: Array
    """(n,) effective draws"""


class Certain:
    """A forward model that states no error of its own."""

    def __init__(self, model: ForwardModel) -> None:
        self._model = model
        basis = model.field_basis
        assert basis is not None
        self._basis = replace(basis, truncation=basis.truncation[:0])

    @property
    def field_basis(self) -> FieldBasis:
        """Modes that leave nothing out."""
        return self._basis

    def predict(self, theta: Array) -> Prediction:
        """Means alone."""
        stated = self._model.predict(theta)
        return replace(stated, force_covariance=None, weight_variance=None)

    def jacobian(self, theta: Array) -> Jacobian:
        """Derivatives of the means."""
        return self._model.jacobian(theta)


def sbc_prior() -> Prior:
    """The study's prior of r and s, and kappa within what Table 5.1 allows."""
    return replace(prior(), kappa=Marginal("log_uniform", *KAPPA))


def template(points: Array, *, independent: bool = False) -> tuple[Dataset, NoiseSettings]:
    """Data set without values, and noise settings; `independent` as if all errors were."""
    forces, settings = thesis_forces(), noise_of(study())
    field = FieldData(
        points=points,
        displacement=np.zeros((forces.travel.size, len(points), 3)),
        noise_std=FIELD_NOISE,
        # A thousandth of a mm: less than any two points are apart.
        correlation_length=1e-3 if independent else CORRELATION_LENGTH,
        reference_share=0.0 if independent else REFERENCE_SHARE,
    )
    if independent:
        settings = replace(settings, sample_correlation=0.0)
    return replace(forces, field=field), settings


def likelihood_of(
    emulator: ScaledEmulator,
    points: Array,
    *,
    mesh: MeshError | None = None,
    independent: bool = False,
    certain: bool = False,
    discrepancy: tuple[float, float] | None = None,
) -> Likelihood:
    """Likelihood of such experiments; `certain` leaves the emulator's error out.

    `discrepancy` is the share by which the model errs and that of the force over it; it is of the
    field that the emulator has in the middle.
    """
    correction: MeshCorrection | None = None if mesh is None else mesh.correction
    forward = EmulatorForward(emulator, with_field=True, correction=correction)
    dataset, settings = template(points, independent=independent)
    if discrepancy is not None:
        assert dataset.field is not None and forward.field_basis is not None
        typical = replace(dataset.field, displacement=forward.field_basis.offset)
        dataset = replace(dataset, field=typical)
        share, common = discrepancy
        settings = replace(settings, discrepancy=share, discrepancy_of_force=common)
    errors = (
        {}
        if mesh is None
        else {
            "force_discretisation": mesh.force,
            "field_floor": mesh.field_floor,
            "field_patterns": mesh.field_patterns(dataset, settings, forward),
        }
    )
    return build_likelihood(dataset, Certain(forward) if certain else forward, settings, **errors)


def by_emulator(likelihood: Likelihood, prior: Prior, n: int, seed: int) -> Experiments:
    """Experiments whose truth is a draw of the emulator's predictive distribution."""
    rng = np.random.default_rng(seed)
    x = prior.sample(rng, n)
    stated = likelihood.forward.predict(theta_of(x))
    field, basis = likelihood.field, likelihood.forward.field_basis
    assert field is not None and basis is not None and stated.weights is not None
    weights = stated.weights
    if stated.weight_variance is not None:
        weights = weights + np.sqrt(stated.weight_variance) * rng.standard_normal(weights.shape)
    # As in the likelihood, the zero of the travel moves the mean.
    return _measured(
        likelihood, x, stated, basis.fields(weights), basis.fields(stated.weights), rng
    )


def by_runs(likelihood: Likelihood, prior: Prior, runs: Campaign, n: int, seed: int) -> Experiments:
    """Experiments whose truth is an FE run, each serving n / len(runs) of them.

    kappa and all errors are drawn for each experiment, so that those of one run share its (r, s),
    the first two columns of its theta, and what emulator and mesh err there. Raises ValueError for
    runs that did not reach the end.
    """
    if not runs.reached.all():
        raise ValueError(f"runs: {np.count_nonzero(~runs.reached)} ended early")
    rng = np.random.default_rng(seed)
    which = np.arange(n) % len(runs.theta)
    x = prior.sample(rng, n)
    x[:, 1:] = runs.theta[which, :2]
    truth = np.exp(x[:, :1]) * runs.force[which]
    fields = runs.displacement[which]
    # Errors of measurement alone: those of emulator and mesh are in the run.
    field = likelihood.field
    assert field is not None
    bare = replace(
        likelihood, errors=replace(likelihood.errors, discretisation=np.zeros(truth.shape[1]))
    )
    own = replace(field.covariance, patterns=field.covariance.patterns[:0])
    own = replace(own, floor=np.zeros_like(own.floor))
    noise = replace(
        field, covariance=own, basis=replace(field.basis, truncation=_none(field.basis))
    )
    found = _measured(replace(bare, field=noise), x, Prediction(truth, None), fields, fields, rng)
    return replace(found, run=which)


def _none(basis: FieldBasis) -> Array:
    return basis.truncation[:0]


def _measured(
    likelihood: Likelihood,
    x: Array,
    stated: Prediction,
    fields: Array,
    moved: Array,
    rng: np.random.Generator,
) -> Experiments:
    """Add what the likelihood says of errors to forces and fields."""
    errors, field = likelihood.errors, likelihood.field
    assert field is not None
    force = np.ascontiguousarray(stated.force.T)
    covariance = errors.covariance(force, stated.force_covariance).transpose(2, 0, 1)
    own = rng.standard_normal((len(field.shifts), len(x)))
    factor = np.linalg.cholesky(covariance)
    drawn = stated.force + np.einsum("mij,mj->mi", factor, rng.standard_normal(stated.force.shape))
    return Experiments(
        x=x,
        force=drawn + np.einsum("qm,qim->mi", own, errors.shifts(force)),
        field=fields
        + np.einsum("qm,qmipc->mipc", own, field.shared(moved))
        + field.total.sample(rng, len(x)),
        run=np.arange(len(x)),
    )


def place(
    likelihood: Likelihood,
    prior: Prior,
    experiments: Experiments,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> Placed:
    """Posterior of each experiment under `likelihood`, and where its truth lies in it."""
    assert likelihood.field is not None
    fields = likelihood.field.of_fields(experiments.field)
    rows = []
    for index, (x, force, field) in enumerate(
        zip(experiments.x, experiments.force, fields, strict=True)
    ):
        posterior = Posterior(prior, replace(likelihood, force=force, field=field))
        rows.append(_place(posterior, x, np.random.default_rng([seed, index])))
        if progress is not None:
            progress(index + 1, len(fields))
    below, mean, sd, ess = (np.array(column) for column in zip(*rows, strict=True))
    return Placed(below, mean, sd, ess)


def _place(
    posterior: Posterior, truth: Array, rng: np.random.Generator
) -> tuple[Array, Array, Array, float]:
    try:
        draws = draw_weighted(posterior, rng, N_DRAWS)
        if draws.ess < FEWEST_EFFECTIVE:
            draws = draw_weighted(posterior, rng, 8 * N_DRAWS, n_round=4096)
    except ValueError:
        draws = None
    if draws is None or draws.ess < FEWEST_EFFECTIVE:
        exact = integrate(posterior, 24)
        return np.minimum(exact.expect(exact.x < truth), 1.0), exact.mean, exact.sd, np.inf
    return draws.below(truth), draws.mean, draws.sd, draws.ess
