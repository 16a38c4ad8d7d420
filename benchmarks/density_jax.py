"""The log posterior of forces and field by emulator, written for JAX: for gradient samplers.

Only for benchmarks/inference.py, which checks it against the product's density before it is used.
Stationary covariances as in `surrogate.covariance`, the likelihood as in `calib.inference`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from calib.inference import Likelihood, Posterior
from fe.response import Array
from surrogate import ScaledEmulator
from surrogate.gp import GaussianProcesses

jax.config.update("jax_enable_x64", True)


def log_density(posterior: Posterior, emulator: ScaledEmulator) -> Callable[[Any], Any]:
    """Log posterior of x (3,) up to a constant, where prior bounds are flat and not checked.

    For an emulator without mesh correction, a log-uniform prior of kappa and uniform ones of r, s.
    """
    of_force = _of_force(posterior.likelihood, emulator)
    of_field = _of_field(posterior.likelihood, emulator)

    def density(x: Any) -> Any:
        parts = (of_force(x), of_field(x))
        value, first, second = (sum(part[i] for part in parts) for i in range(3))
        return value + 0.5 * (first**2 / (1.0 + second) - jnp.log1p(second))

    return density


def _of_force(likelihood: Likelihood, emulator: ScaledEmulator) -> Callable[[Any], Any]:
    """Log density of the forces along the zero of the travel: value, slope, curvature at x (3,)."""
    own = emulator.emulator
    force_gp = _processes(own.force.processes)
    modes, offset = jnp.array(own.force.pod.modes), jnp.array(own.force.pod.offset)
    factor = own.force.pod.truncation_factor
    truncation, mean = jnp.array(factor @ factor.T), jnp.array(own.force_scale.mean)
    errors = likelihood.errors
    measured, slope = jnp.array(likelihood.force), jnp.array(errors.slope)
    disc = jnp.array(errors.discretisation)

    def of_force(x: Any) -> tuple[Any, Any, Any]:
        y, variance = force_gp(x[1:])
        shape = offset + modes @ y
        covariance = (modes * variance) @ modes.T + truncation
        if own.force_scale.log:
            unit = mean * jnp.exp(shape)
            covariance = jnp.expm1(covariance) * jnp.outer(unit, unit)
        else:
            unit = mean * shape
            covariance = covariance * jnp.outer(mean, mean)
        kappa = jnp.exp(x[0])
        force = kappa * unit
        scaled = disc * force
        total = errors.mean + kappa**2 * covariance
        total = total + 0.5 * jnp.outer(scaled, scaled) + 0.5 * jnp.diag(scaled**2)
        return _along(total, measured - force, errors.travel_zero_sd * slope @ force)

    return of_force


def _of_field(likelihood: Likelihood, emulator: ScaledEmulator) -> Callable[[Any], Any]:
    """The same of the field, by its projection on the emulator's modes."""
    own = emulator.emulator
    assert own.field is not None and likelihood.field is not None
    field_gp, projected = _processes(own.field.processes), likelihood.field.projected
    [shared_modes], [shared_pull] = projected.shared_modes, projected.shared_pull
    [[shared_precision]] = projected.shared_precision  # of one shared error, the travel's zero

    def of_field(x: Any) -> tuple[Any, Any, Any]:
        weights, variance = field_gp(x[1:])
        off = projected.best - weights
        pulled = projected.precision @ off
        moved = jnp.concatenate([jnp.ones(1), weights])
        by_mode = moved @ shared_modes
        slope_ = moved @ shared_pull - weights @ by_mode
        curvature = moved @ shared_precision @ moved
        root = jnp.sqrt(variance)
        matrix = jnp.eye(len(root)) + root[:, None] * projected.precision * root
        lower = jnp.linalg.cholesky(matrix)
        both = jax.scipy.linalg.solve_triangular(
            lower, jnp.stack([root * pulled, root * by_mode], axis=1), lower=True
        )
        gained = both.T @ both
        misfit = off @ pulled - gained[0, 0] + 2 * jnp.log(jnp.diag(lower)).sum()
        return (
            projected.constant - 0.5 * misfit,
            slope_ - gained[0, 1],
            curvature - gained[1, 1],
        )

    return of_field


def _along(covariance: Any, residual: Any, error: Any) -> tuple[Any, Any, Any]:
    lower = jnp.linalg.cholesky(covariance)
    white = jax.scipy.linalg.solve_triangular(
        lower, jnp.stack([residual, error], axis=1), lower=True
    )
    gram = white.T @ white
    logdet = 2 * jnp.log(jnp.diag(lower)).sum() + len(residual) * np.log(2 * np.pi)
    return -0.5 * (gram[0, 0] + logdet), gram[0, 1], gram[1, 1]


def _processes(gp: GaussianProcesses) -> Callable[[Any], tuple[Any, Any]]:
    """Mean (k,) and variance (k,) of a new run at inputs (d,).

    Raises ValueError where runs that ended early have taught the emulator: that is not done here.
    """
    if len(gp.further):
        raise ValueError("density_jax: expected an emulator of complete runs alone")
    index = gp.rows.of_point
    groups = []
    for group in range(len(gp.family)):
        members = gp.members(group)
        shares = 1.0 / (gp.eigenvalues[group] + gp.nugget[members, None])
        groups.append((int(gp.family[group]), gp.length[group], members, gp.basis[group].T, shares))

    def predict(x: Any) -> tuple[Any, Any]:
        scaled = _warped((x - gp.low) / gp.span, gp.strength)
        y, variance = jnp.zeros(len(gp.offset)), jnp.zeros(len(gp.offset))
        for family, length, members, basis, shares in groups:
            cross = _cross(family, length, scaled, gp.inputs, index, gp.rows.n_rows)
            y = y.at[members].set(gp.alpha[members] @ cross)
            explained = shares @ (basis @ cross) ** 2
            rest = jnp.maximum(1.0 - explained, 0.0) + gp.nugget[members]
            variance = variance.at[members].set(rest)
        return gp.offset + gp.scale * y, gp.variance_scale * variance

    return predict


def _cross(family: int, length: Array, x: Any, runs: Array, index: Array, n_rows: int) -> Any:
    """(n_rows,) covariance of training rows with the value at x (d,)."""
    a = (x - runs) / length
    squared = jnp.sum(a**2, axis=1)
    if family == 2:
        value = jnp.exp(-0.5 * squared)
        first = -0.5 * value
    else:
        q = jnp.sqrt((5.0 if family == 1 else 3.0) * squared + 1e-300)
        e = jnp.exp(-q)
        value = (1.0 + q + q * q / 3.0) * e if family == 1 else (1.0 + q) * e
        first = -5.0 / 6.0 * (1.0 + q) * e if family == 1 else -1.5 * e
    columns = jnp.column_stack([value, -2.0 * first[:, None] * a / length])
    rows, place = np.nonzero(index >= 0)
    return jnp.zeros(n_rows).at[index[rows, place]].set(columns[rows, place])


def _warped(u: Any, strength: Array) -> Any:
    c = np.where(strength != 0.0, np.abs(strength), 1.0)
    turned = jnp.where(strength < 0.0, 1.0 - u, u)
    stretched = (jnp.log1p(c * jnp.maximum(turned, 0.0)) + c * jnp.minimum(turned, 0.0)) / np.log1p(
        c
    )
    stretched = jnp.where(strength < 0.0, 1.0 - stretched, stretched)
    return jnp.where(strength != 0.0, stretched, u)


def check_same(posterior: Posterior, density: Any) -> None:
    """Raise RuntimeError where another density of x (m, 3) is not that of the product."""
    x = posterior.prior.sample(np.random.default_rng(2), 64)
    own, theirs = posterior.log_prob(x), np.asarray(density(x))
    # Up to the constant of the prior, which is flat in x.
    spread = float(np.ptp(own - theirs) / np.abs(own).max())
    if not spread < 1e-8:
        raise RuntimeError(f"density_jax: differs from the product's by {spread:.2g}")
