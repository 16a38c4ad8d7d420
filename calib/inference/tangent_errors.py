"""A field's model errors that would be mistaken for other parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calib.inference.field_noise import FieldCovariance
from calib.inference.forward import ForwardModel
from calib.inference.shared_error import SharedError
from fe.response import Array

TRAVEL_LENGTH = 0.8
"""mm of travel over which errors of a mesh are correlated"""
FOLLOWED = 0.2
"""share of the box of a ratio over which the turning of tangents is looked at, at most"""
SINGULAR = 1e-10
"""share of the largest eigenvalue below which a combination of parameters is not seen at all"""


@dataclass(frozen=True)
class Mistaken:
    """Errors of constants and nuisances for which that of a field would be mistaken."""

    ratios: Array
    """(d,) SDs of r, s, ..., independent of each other"""
    names: tuple[str, ...]
    """of q nuisances that move the field"""
    nuisances: Array
    """(q, q) covariance of their errors, in their units"""
    box: Array
    """(d, 2) of the ratios, within which the model is known"""

    def patterns(self, tangents: Array) -> Array:
        """(d + q, n_step, n_point, 3) errors of a field of SD one, mm.

        `tangents` (d + q, ...) are changes of the field with the ratios and the nuisances.
        """
        d = self.ratios.size
        values, vectors = np.linalg.eigh(self.nuisances)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        together = np.tensordot(root.T, tangents[d:], axes=1)
        return np.concatenate([self.ratios[:, None, None, None] * tangents[:d], together])


def mistaken(
    errors: FieldCovariance,
    travel: Array,
    tangents: Array,
    differences: Array,
    prior_sd: Array | float = np.inf,
) -> Array:
    """(d, d) sizes of the changes of d parameters that `differences` would be mistaken for.

    Each difference (n, n_step, n_point, 3) [mm] at each increment alone is fitted, by least squares
    in the other `errors` of a field, by the changes of the whole field with the parameters,
    `tangents` (d, n_step, n_point, 3), which `prior_sd` (d,) holds at zero where it is finite: in
    those of the noise alone what a mesh errs by within an element would weigh far more than it does
    in a likelihood that states such errors. Changes by different increments are taken as correlated
    over `TRAVEL_LENGTH` of the `travel` (n_step,), so that they add up where they agree and do not
    cancel altogether where they do not: found is the sum over differences of shift rho shift^T.
    This is the grid convergence index of what is asked for, the parameters, in place of that of
    displacements (Roache 1994; Eca and Hoekstra 2014).
    """
    sd = np.broadcast_to(np.asarray(prior_sd, dtype=np.float64), len(tangents))
    held = np.isfinite(sd)
    # In units of the prior's SD, so that one of zero is no division.
    unit = np.where(held, sd, 1.0)
    changes = tangents * unit[:, None, None, None]
    weighed = errors.solve(changes)
    gram = np.einsum("aipx,bipx->ab", weighed, changes) + np.diag(held.astype(np.float64))
    pull = np.einsum("aipx,nipx->ani", weighed, differences)
    scale = np.sqrt(np.diag(gram))
    scale = np.where(scale > 0.0, scale, 1.0)[:, None]
    flat = pull.reshape(len(tangents), -1) / scale
    fitted, *_ = np.linalg.lstsq(gram / (scale * scale.T), flat, rcond=SINGULAR)
    shifts = (unit[:, None] * fitted / scale).reshape(pull.shape)
    correlation = np.exp(-np.abs(np.subtract.outer(travel, travel)) / TRAVEL_LENGTH)
    found: Array = np.einsum("ani,ij,bnj->ab", shifts, correlation, shifts)
    return found


def patterns_at(
    found: Mistaken, forward: ForwardModel, theta: Array, nuisances: Sequence[SharedError]
) -> Array:
    """(n, n_step, n_point, 3) errors of a model's field in known shapes, of SD one, mm.

    Those along the tangents at theta (1 + d,), and how the ratios' tangents turn where a ratio errs
    by its size. An error has the shape of the tangent where the constants are, not of that where
    the mesh was checked: within 0.1 of r that of a stuck block turns so far that an error stated in
    the latter alone leaves most of itself for r to explain. `nuisances` are those of `found.names`.
    """
    along = found.patterns(tangents_at(forward, theta, nuisances))
    return np.concatenate([along, *_turned(found, forward, theta)])


def _turned(found: Mistaken, forward: ForwardModel, theta: Array) -> Iterator[Array]:
    """(d, n_step, n_point, 3) changes of the ratios' errors as each ratio errs, one by one."""
    low, high = found.box.T
    here = np.clip(theta[1:], low, high)
    for a, reach in enumerate(np.minimum(found.ratios, FOLLOWED * (high - low))):
        if reach <= 0.0:
            continue
        step = reach * np.eye(found.ratios.size)[a]
        ends = [np.clip(here + sign * step, low, high) for sign in (1.0, -1.0)]
        upper, lower = (tangents_at(forward, np.append(theta[0], end), ()) for end in ends)
        followed = (ends[0] - ends[1])[a]
        yield found.ratios[:, None, None, None] * (upper - lower) * (reach / followed)


def apart(found: Array, names: tuple[str, ...], box: Array) -> Mistaken:
    """Each ratio with its own size, whatever the others', and the last `names` together.

    What a finer mesh changes has not the direction in the ratios of what was measured. Nuisances
    do nearly the same to a field, so that one takes what another leaves.
    """
    d = len(found) - len(names)
    return Mistaken(np.sqrt(np.diag(found)[:d]), names, found[d:, d:], box)


def tangents_at(forward: ForwardModel, theta: Array, nuisances: Sequence[SharedError]) -> Array:
    """(d + q, n_step, n_point, 3) changes of a model's field at theta (1 + d,), mm.

    With its inputs, all but kappa, which no field depends on, and with a unit of each of the
    nuisances. The model must have a field and modes.
    """
    stated, slopes = forward.predict(theta[None]), forward.jacobian(theta[None]).weights
    basis = forward.field_basis
    assert slopes is not None and basis is not None and basis.modes is not None
    assert stated.weights is not None
    by_input = np.tensordot(slopes[0][:, 1:].T, basis.modes, axes=1)
    return with_nuisances(by_input, basis.fields(stated.weights)[0], nuisances)


def with_nuisances(tangents: Array, field: Array, nuisances: Sequence[SharedError]) -> Array:
    """(d + q, ...) tangents (d, ...), and what a predicted `field` changes with nuisances."""
    by_unit = [np.tensordot(error.field / error.sd, field, axes=1) for error in nuisances]
    return np.concatenate([tangents, np.reshape(by_unit, (-1, *field.shape))])
