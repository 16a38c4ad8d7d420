"""Moments of a posterior by a rule over (r, s) at whose nodes FE runs are known.

A tensor Gauss-Legendre rule; ln kappa is integrated on a fine even grid, for which no further run
is needed. How far a mean hangs on what is rough in the FE model from node to node is told, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import logsumexp

from calib.inference import DirectForward, Likelihood, Posterior, theta_of
from calib.inference.gaussian import log_density_along
from calib.inference.shared_error import marginal
from fe.campaign_result import Campaign
from fe.response import Array

N_NODES = 9
"""in r and in s"""
WIDTH = 4.0
"""posterior SDs covered to each side"""
N_KAPPA = 61
DEGREE = 4
"""of the polynomial of the nodes' ln density that counts as smooth"""


def box_about(mean: Array, sd: Array, bounds: Array) -> Array:
    """(2, 2) range of (r, s) of so many SDs, cut off at the prior's bounds."""
    low, high = mean - WIDTH * sd, mean + WIDTH * sd
    return np.column_stack([np.maximum(low, bounds[:, 0]), np.minimum(high, bounds[:, 1])])


def nodes_of(box: Array, n: int = N_NODES) -> tuple[Array, Array]:
    """(n^2, 2) nodes and weights of a box."""
    unit, weight = np.polynomial.legendre.leggauss(n)
    r, s = (low + (high - low) * 0.5 * (unit + 1.0) for low, high in box)
    nodes = np.stack(np.meshgrid(r, s, indexing="ij"), axis=-1).reshape(-1, 2)
    return nodes, np.outer(weight, weight).ravel()


class Moments(NamedTuple):
    """Of x = (ln kappa, r, s), (3,) each."""

    mean: Array
    sd: Array
    error: Array
    """SD of the mean by this rule, where the model is rough from node to node"""


@dataclass(frozen=True)
class Rule:
    """Nodes at which FE runs are known."""

    nodes: Array
    weights: Array
    ln_kappa: Array
    exact: DirectForward

    def moments(self, posterior: Posterior) -> Moments:
        """Of x by the rule; a run that ended early has no weight."""
        n, m = len(self.nodes), len(self.ln_kappa)
        x = np.empty((n, m, 3))
        x[:, :, 0], x[:, :, 1:] = self.ln_kappa, self.nodes[:, None]
        log_density = np.array(
            [posterior.prior.log_prob(row) + log_likelihood(posterior.likelihood, row) for row in x]
        )
        total = log_density + np.log(self.weights)[:, None]
        probability = np.exp(total - logsumexp(total))
        mean = np.einsum("nk,nki->i", probability, x)
        sd = np.sqrt(np.einsum("nk,nki->i", probability, (x - mean) ** 2))
        share = probability.sum(axis=1)
        known = share > 0.0
        off = np.einsum("nk,nki->ni", probability, x)[known] / share[known, None] - mean
        value = logsumexp(log_density[known], axis=1)
        error = rough_error(value, share[known], off, (self.nodes[known] - mean[1:]) / sd[1:])
        return Moments(mean, sd, error)


def rough_error(value: Array, share: Array, off: Array, place: Array) -> Array:
    """(d,) SD of a mean by what is rough in a density, taken as independent at the nodes.

    `value` (n,) is ln density at the nodes, `share` (n,) their probabilities, none 0, `off` (n, d)
    of what the mean is taken, less the mean, `place` (n, 2) where they are. Rough is what a
    polynomial of degree `DEGREE` leaves, which itself is fitted and takes part of it along.
    """
    powers = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
    terms = np.array([place[:, 0] ** i * place[:, 1] ** j for i, j in powers]).T
    weight = np.sqrt(share)[:, None]
    fit = np.linalg.lstsq(terms * weight, value * weight[:, 0], rcond=None)[0]
    hat = np.einsum("ni,in->n", terms * weight, np.linalg.pinv(terms * weight))
    freedom = np.sum(share * (1.0 - hat))
    rough = np.sum(share * (value - terms @ fit) ** 2) / freedom
    found: Array = np.sqrt(rough * np.sum((share[:, None] * off) ** 2, axis=0))
    return found


def log_likelihood(likelihood: Likelihood, x: Array) -> Array:
    """(m,) of rows of x that share (r, s): the field, which does not know kappa, is seen once."""
    theta, errors = theta_of(x), likelihood.errors
    stated = likelihood.forward.predict(theta[:1])
    scale = theta[:, 0] / theta[0, 0]
    force = np.outer(stated.force[0], scale)
    covariance = None
    if stated.force_covariance is not None:
        covariance = scale[:, None, None] ** 2 * stated.force_covariance
    by_force = log_density_along(
        errors.covariance(force, covariance),
        likelihood.force[:, None] - force,
        errors.shifts(force),
    )
    basis = likelihood.forward.field_basis
    assert likelihood.field is not None and basis is not None
    by_field = likelihood.field.with_basis(basis).along(stated)
    return marginal([by_force, by_field])


class Known:
    """Runs of a campaign, by their ratios."""

    def __init__(self, campaign: Campaign) -> None:
        self._runs = {
            row.tobytes(): run for row, run in zip(campaign.theta, campaign.responses, strict=True)
        }

    def __call__(self, ratios: Array) -> Any:
        """The run at these ratios (2,)."""
        return self._runs[np.ascontiguousarray(ratios).tobytes()]
