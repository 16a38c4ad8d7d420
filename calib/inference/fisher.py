"""Fisher information of forces and field about x, and the combinations of x that they determine.

For normal errors of known covariance the information is J^T Sigma^-1 J (the part through the
covariance's own dependence on x is left out: it is small wherever data say anything). The errors
that force and field share, the zero of the travel above all, are integrated out of both together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.inference.coordinates import theta_of
from calib.inference.data_parts import Part, log_likelihood
from calib.inference.field_likelihood import FieldLikelihood
from calib.inference.forward import Jacobian, Prediction
from calib.inference.likelihood import Likelihood
from calib.inference.posterior import Posterior
from calib.inference.student_force import information_share
from fe.response import Array

CURVATURE_STEP = 0.2
"""posterior SDs between the points of second differences: emulator means carry rounding"""
HALVINGS = 8
"""of these steps, where they leave what the prior allows"""
FLAT = 1e-3
"""least curvature along a direction, per posterior SD squared, for a maximum to be one"""


@dataclass(frozen=True)
class Information:
    """What one part of the data adds about x, and how the shared errors take some of it away."""

    own: Array
    """(d, d) information were the shared errors known"""
    pull: Array
    """(d, q) information that x and the shared errors have in common"""
    shared: Array
    """(q, q) information about the shared errors, in units of their SDs"""


@dataclass(frozen=True)
class Spectrum:
    """Combinations of x from best to least known, in units of the prior's SDs."""

    information: Array
    """(d,) eigenvalues: above 1 the data say more than the prior"""
    directions: Array
    """(d, d) rows are unit vectors in x / prior SD"""

    @property
    def sd_ratio(self) -> Array:
        """(d,) SD along each combination over the prior's, by the information alone."""
        ratio: Array = 1.0 / np.sqrt(1.0 + np.maximum(self.information, 0.0))
        return ratio


def fisher_information(likelihood: Likelihood, x: Array, part: Part = "both") -> Array:
    """(d, d) information about x = (ln kappa, ...) at the point x (d,).

    Raises ValueError for a part that the data do not have, and for a field under a forward model
    without modes (the direct model's).
    """
    theta = theta_of(x[None])
    prediction = likelihood.predict(theta)
    slope = likelihood.forward.jacobian(theta)
    found = []
    if part in ("force", "both"):
        found.append(_of_force(likelihood, prediction, slope))
    if part == "field" or (part == "both" and likelihood.field is not None):
        if likelihood.field is None:
            raise ValueError("part: found 'field', expected 'force': the data hold no field")
        field = likelihood.field
        basis = likelihood.forward.field_basis
        if basis is not None and basis is not field.basis:
            field = field.with_basis(basis)
        found.append(_of_field(field, prediction, slope))
    own = np.sum([entry.own for entry in found], axis=0)
    pull = np.sum([entry.pull for entry in found], axis=0)
    shared = np.sum([entry.shared for entry in found], axis=0)
    information: Array = own - pull @ np.linalg.solve(np.eye(len(shared)) + shared, pull.T)
    return 0.5 * (information + information.T)


def observed_information(posterior: Posterior, x: Array, sd: Array) -> Array:
    """(d, d) curvature of minus the ln likelihood at x (d,), by second differences over `sd` (d,).

    For any coordinates and any likelihood; negative eigenvalues, which a point off the maximum may
    have, are set to zero. Next to a bound of the prior the differences are taken inside of it.
    Raises ValueError where the likelihood is not finite about x.
    """
    hessian = _second_differences(lambda at: log_likelihood(posterior, at), posterior, x, sd)
    if not np.isfinite(hessian).all():
        raise ValueError(f"x: expected a point inside of the prior's support, found {x}")
    values, vectors = np.linalg.eigh(hessian)
    information: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return information


def laplace_covariance(posterior: Posterior, x: Array, sd: Array) -> Array | None:
    """(d, d) covariance of the normal density with the posterior's curvature at its maximum x (d,).

    By second differences as in `observed_information`. None where the density does not fall in all
    directions, as at a maximum on a bound of the prior.
    """
    hessian = _second_differences(posterior.log_prob, posterior, x, sd)
    # In units of the SDs: x may have components of any size.
    scaled = hessian * np.outer(sd, sd)
    if not np.isfinite(scaled).all() or np.linalg.eigvalsh(scaled)[0] <= FLAT:
        return None
    covariance: Array = np.linalg.inv(scaled) * np.outer(sd, sd)
    return covariance


def _second_differences(
    function: Callable[[Array], Array], posterior: Posterior, x: Array, sd: Array
) -> Array:
    """(d, d) second derivatives of minus a function of x, over `CURVATURE_STEP` SDs.

    Over less where that leaves what the prior allows within its bounds, as priors of the constants
    do; NaN where no step stays there.
    """
    low, high = posterior.prior.bounds.T
    step = np.minimum(CURVATURE_STEP * sd, 0.2 * (high - low))
    for _ in range(HALVINGS):
        hessian = _over_step(function, np.clip(x, low + 1.01 * step, high - 1.01 * step), step)
        if np.isfinite(hessian).all():
            break
        step = 0.5 * step
    return hessian


def _over_step(function: Callable[[Array], Array], centre: Array, step: Array) -> Array:
    """(d, d) second differences of minus a function over `step` (d,) about `centre` (d,)."""
    d = centre.size
    signs = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])
    hessian = np.empty((d, d))
    for i in range(d):
        for j in range(i + 1):
            points = np.tile(centre, (4, 1))
            points[:, i] += 0.5 * signs[:, 0] * step[i]
            points[:, j] += 0.5 * signs[:, 1] * step[j]
            with np.errstate(invalid="ignore"):  # -inf less -inf where the prior is zero
                mixed = float(function(points) @ np.array([1.0, -1.0, -1.0, 1.0]))
            hessian[i, j] = hessian[j, i] = -mixed / (step[i] * step[j])
    return hessian


def spectrum(information: Array, prior_sd: Array) -> Spectrum:
    """Eigenvalues and combinations of an information (d, d) in units of the prior's SDs (d,)."""
    scaled = information * prior_sd[:, None] * prior_sd[None, :]
    values, vectors = np.linalg.eigh(scaled)
    order = np.argsort(-values)
    directions = vectors[:, order].T
    # The largest part of each combination counts as positive.
    largest = np.take_along_axis(directions, np.abs(directions).argmax(axis=1)[:, None], axis=1)
    return Spectrum(values[order], directions * np.sign(largest))


def _of_force(likelihood: Likelihood, prediction: Prediction, slope: Jacobian) -> Information:
    force = np.ascontiguousarray(prediction.force.T)
    covariance = likelihood.errors.to_first_order(force, prediction.force_covariance)[:, :, 0]
    covariance = covariance / information_share(likelihood.errors.freedom, len(force))
    shifts = likelihood.errors.shifts(force)[:, :, 0].T
    jacobian = slope.force[0]
    solved = np.linalg.solve(covariance, shifts)
    return Information(
        own=jacobian.T @ np.linalg.solve(covariance, jacobian),
        pull=jacobian.T @ solved,
        shared=shifts.T @ solved,
    )


def _of_field(field: FieldLikelihood, prediction: Prediction, slope: Jacobian) -> Information:
    weights, jacobian = prediction.weights, slope.weights
    assert weights is not None and jacobian is not None  # a model with a field has both
    projected = field.projected
    by_mode = np.concatenate([[1.0], weights[0]])
    moved = np.einsum("j,qjk->kq", by_mode, projected.shared_modes)
    shared = np.einsum("i,abij,j->ab", by_mode, projected.shared_precision, by_mode)
    precision = projected.precision
    if prediction.weight_variance is not None:
        root = np.sqrt(prediction.weight_variance[0])
        inner = np.eye(root.size) + root[:, None] * precision * root
        gain = root[:, None] * np.column_stack([precision, moved])
        taken, k = gain.T @ np.linalg.solve(inner, gain), root.size
        precision = precision - taken[:k, :k]
        shared = shared - taken[k:, k:]
        moved = moved - taken[:k, k:]
    by_x = jacobian[0]
    return Information(own=by_x.T @ precision @ by_x, pull=by_x.T @ moved, shared=shared)
