"""A planned experiment in few numbers: forces, and a field reduced to what tells of the parameters.

A field y = offset + w(x) M + noise with the noise S enters only by the weights that fit it best,
which are normal about w(x) with the precision G = M S^-1 M^T: nothing is lost by keeping these.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from calib.inference.coordinates import theta_of
from calib.inference.field_likelihood import FieldLikelihood, project
from calib.inference.forward import FieldBasis, Jacobian, Prediction
from calib.inference.likelihood import Likelihood
from calib.inference.student_force import information_share
from fe.response import Array

NEGLIGIBLE = 1e-12
"""eigenvalues of G below this share of the largest tell nothing"""

IntArray = npt.NDArray[np.intp]


class Reduced(NamedTuple):
    """Observations of a planned experiment at m parameter vectors."""

    mean: Array
    """(m, n) forces in N and weights of the field in units of their noise"""
    jacobian: Array
    """(m, n, 3) by x = (ln kappa, r, s)"""
    covariance: Array
    """(n, n), at the mean of the m vectors; the zero of the travel is in it"""


@dataclass(frozen=True)
class FirstOrderForward:
    """One run of the direct model with its derivatives, as a forward model around it.

    ln force and field are linear in the ratios, the force is proportional to kappa.
    """

    ratios: Array
    """(n_ratio,) of the run"""
    force: Array
    """(n_step,) at kappa = 1 MPa, N"""
    force_gradient: Array
    """(n_step, n_ratio) N"""
    displacement: Array
    """(n_step, n_point, 3) mm"""
    displacement_gradient: Array
    """(n_step, n_point, 3, n_ratio) mm"""

    @property
    def field_basis(self) -> FieldBasis:
        """The run's field, and its slopes as modes."""
        modes = np.ascontiguousarray(np.moveaxis(self.displacement_gradient, -1, 0))
        nothing = np.zeros((0, *self.displacement.shape))
        return FieldBasis(self.displacement, modes, nothing)

    def predict(self, theta: Array) -> Prediction:
        """Prediction at theta (m, 1 + n_ratio)."""
        off = theta[:, 1:] - self.ratios
        slope = self.force_gradient / self.force[:, None]
        return Prediction(theta[:, :1] * self.force * np.exp(off @ slope.T), None, off)

    def jacobian(self, theta: Array) -> Jacobian:
        """Derivatives of the means by x."""
        force = self.predict(theta).force
        slope = self.force_gradient / self.force[:, None]
        by_x = np.concatenate([np.ones((len(slope), 1)), slope], axis=1)
        n = self.ratios.size
        weights = np.concatenate([np.zeros((n, 1)), np.eye(n)], axis=1)
        return Jacobian(force[:, :, None] * by_x, np.broadcast_to(weights, (len(theta), n, n + 1)))


def reduce_experiment(
    likelihood: Likelihood, x: Array, steps: IntArray | None = None, *, with_field: bool = True
) -> Reduced:
    """The experiment that a likelihood describes, at x (m, d), at some of its increments.

    Of the likelihood's data only the errors matter, not what was measured. The emulator's own error
    is left out: a planned experiment is assumed to be evaluated with one that is good enough.
    """
    theta, centre = theta_of(x), theta_of(x.mean(axis=0))[None]
    chosen = np.arange(likelihood.force.size) if steps is None else steps
    prediction, slope = likelihood.predict(theta), likelihood.forward.jacobian(theta)
    at_centre = likelihood.predict(centre)
    column = np.ascontiguousarray(at_centre.force.T)
    noise = likelihood.errors.to_first_order(column, None)[np.ix_(chosen, chosen)][:, :, 0]
    noise = noise / information_share(likelihood.errors.freedom, len(chosen))
    shifts = likelihood.errors.shifts(column)[:, chosen, 0]
    mean, jacobian = [prediction.force[:, chosen]], [slope.force[:, chosen]]
    known = np.eye(len(shifts))
    if with_field and likelihood.field is not None:
        root, moved, beside = _field(likelihood.field, at_centre, chosen)
        assert prediction.weights is not None and slope.weights is not None
        mean.append(prediction.weights @ root)
        jacobian.append(np.einsum("mkx,kq->mqx", slope.weights, root))
        noise = block_diag(noise, np.eye(root.shape[1]))
        shifts, known = np.concatenate([shifts, moved], axis=1), known + beside
    covariance = noise + shifts.T @ np.linalg.solve(known, shifts)
    return Reduced(np.concatenate(mean, axis=1), np.concatenate(jacobian, axis=1), covariance)


def _field(
    field: FieldLikelihood, at_centre: Prediction, steps: IntArray
) -> tuple[Array, Array, Array]:
    """Root (k, p) of the weights' precision, how one SD of each shared error moves what is seen.

    The latter is (q, p); and what the field tells of these errors beside, by what no weights could
    do, as a precision (q, q).
    """
    basis = field.basis
    assert basis.modes is not None and at_centre.weights is not None
    covariance = field.total
    for index in sorted(set(range(len(basis.offset))) - {int(s) for s in steps}, reverse=True):
        covariance = covariance.without_step(index)
    stacked = np.concatenate([basis.offset[None], basis.modes])
    shared = field.shared(stacked)[:, :, steps]
    off = (field.observed - basis.offset)[None, steps]
    [found] = project(off, covariance, basis.modes[:, steps], shared)
    values, vectors = np.linalg.eigh(found.precision)
    kept = values > NEGLIGIBLE * values.max()
    root = vectors[:, kept] * np.sqrt(values[kept])
    weights = np.concatenate([[1.0], at_centre.weights[0]])
    pulled = np.einsum("j,qjk->qk", weights, found.shared_modes)
    moved = pulled @ (vectors[:, kept] / np.sqrt(values[kept]))
    told = np.einsum("i,abij,j->ab", weights, found.shared_precision, weights)
    return root, moved, told - moved @ moved.T
