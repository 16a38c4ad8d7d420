"""Gaussian processes of values and derivatives over the same inputs, evaluated together."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from surrogate.array_checks import check_arrays
from surrogate.covariance import FAMILIES, Rows, covariance, mean_gradient, rows_of, values_only
from surrogate.design import unit_design
from surrogate.evidence import Hyperparameters, noise_shape
from surrogate.value_rows import value_rows
from surrogate.variance_directions import unneeded
from surrogate.warp import warp_slope, warped

Array = npt.NDArray[np.float64]

_CHUNK = 128
"""points predicted at a time: their covariances with the runs stay in the cache"""
_MANY_ROWS = 200
"""training rows above which a variance is computed from the directions it depends on"""
_N_SAMPLE = 1024
"""points of the box at which these directions are chosen"""


@dataclass(frozen=True)
class GaussianProcesses:
    """k posterior processes in g groups; those of a group share all but their amplitude.

    Inputs are scaled to the unit box of the training points and stretched there, outputs scaled to
    mean 0 and variance 1.
    Training rows are the values of all runs, then the derivatives that are usable, run by run.
    The predicted variance holds the nugget: it is that of a new run, numerical noise included.
    It is that of the fitted process times `inflation`, which stands for the hyperparameters
    having been estimated from the same few runs, or for what runs left out say of it (see
    `surrogate.gp_fit`).
    """

    low: Array
    """(d,) lowest training input"""
    span: Array
    """(d,) extent of the training inputs"""
    strength: Array
    """(d,) how much each input is stretched near its low edge, see `surrogate.warp`"""
    inputs: Array
    """(n, d) training inputs in the unit box, stretched"""
    usable: Array
    """(n, d) 1 where the derivative of a run by an input is a training row, else 0"""
    offset: Array
    """(k,) mean of the training outputs"""
    scale: Array
    """(k,) standard deviation of the training outputs"""
    targets: Array
    """(k, n_rows) scaled training outputs and derivatives"""
    group: Array
    """(k,) group of each process"""
    amplitude: Array
    """(k,) variance of each process, scaled outputs"""
    inflation: Array
    """(k,) factor of the predicted variance, 1 for known hyperparameters"""
    family: Array
    """(g,) place of the covariance in `FAMILIES`"""
    length: Array
    """(g, d) correlation lengths, stretched unit box"""
    nugget: Array
    """(k,) noise variance of values over the amplitude"""
    roughness: Array
    """(g,) noise variance of derivatives over their prior variance, as a share of the nugget"""
    alpha: Array
    """(k, n_rows) inverse covariance at unit amplitude times targets"""
    basis: Array
    """(g, n_rows, n_rows) B, see `surrogate.evidence`: that inverse is
    B diag(1 / (eigenvalues + nugget)) B.T"""
    eigenvalues: Array
    """(g, n_rows) ascending"""
    further: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(q, d) further inputs that the mean is conditioned on, see `with_further`; scaled"""
    further_alpha: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(k, q) their weights in the mean"""
    further_shift: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(k, n_rows) what they change of alpha"""

    def __post_init__(self) -> None:
        if self.inputs.ndim != 2 or not np.isfinite(self.inputs).all():
            raise ValueError(f"inputs: expected finite (n, d), got shape {self.inputs.shape}")
        n, d, k, g = *self.inputs.shape, len(self.offset), len(self.family)
        n_rows = n + int(np.count_nonzero(self.usable))
        shapes = {
            **dict.fromkeys(("low", "span", "strength"), (d,)),
            "usable": (n, d),
            **dict.fromkeys(("offset", "scale", "group", "amplitude", "inflation", "nugget"), (k,)),
            **dict.fromkeys(("targets", "alpha"), (k, n_rows)),
            "roughness": (g,),
            "length": (g, d),
            "basis": (g, n_rows, n_rows),
            "eigenvalues": (g, n_rows),
        }
        if q := len(self.further):
            shapes |= {"further": (q, d), "further_alpha": (k, q), "further_shift": (k, n_rows)}
        check_arrays(self, shapes)
        if not np.isin(self.group, np.arange(g)).all():
            raise ValueError(f"group: expected places among {g} groups, got {self.group}")
        if not np.isin(self.family, np.arange(len(FAMILIES))).all():
            raise ValueError(f"family: expected places in {FAMILIES}, got {self.family}")

    @property
    def rows(self) -> Rows:
        """Which training rows are values and which derivatives."""
        return self._rows

    def hyperparameters(self, group: int) -> Hyperparameters:
        """Lengths and roughness of a group."""
        return Hyperparameters(self.length[group], float(self.roughness[group]))

    def members(self, group: int) -> npt.NDArray[np.int64]:
        """Processes of a group."""
        return np.flatnonzero(self.group == group)

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean (m, k) and variance (m, k) of new runs at inputs x (m, d), in output units.

        With more than 200 training rows the variance is larger than the exact one by up to 1 %, as
        it is computed from the directions that matter (see `surrogate.variance_directions`).
        """
        scaled = self.scaled(x)
        mean, variance = np.empty((len(x), len(self.offset))), np.empty((len(self.offset), len(x)))
        for group, (members, weights) in enumerate(self._weights):
            directions, share = self._directions[group]
            nugget = self.nugget[members, None]
            for first in range(0, len(x), _CHUNK):
                part = slice(first, first + _CHUNK)
                cross = self._cross(group, scaled[part])
                mean[part, members] = (weights @ cross + self._further(group, scaled[part])).T
                rest = 1.0 - share @ (directions @ cross) ** 2
                # Rounding may take it below its least value, zero, near the training points.
                variance[members, part] = np.maximum(rest, 0.0) + nugget
        variance *= self.variance_scale[:, None]
        return self.offset + self.scale * mean, variance.T

    def mean(self, x: Array) -> Array:
        """(m, k) mean at inputs x (m, d), in output units: `predict` without its variance."""
        scaled, mean = self.scaled(x), np.empty((len(x), len(self.offset)))
        for group, (members, weights) in enumerate(self._weights):
            for first in range(0, len(x), _CHUNK):
                part = slice(first, first + _CHUNK)
                cross = self._cross(group, scaled[part])
                mean[part, members] = (weights @ cross + self._further(group, scaled[part])).T
        found: Array = self.offset + self.scale * mean
        return found

    def gradient(self, x: Array) -> Array:
        """(m, k, d) derivative of the mean by the inputs at x (m, d), in output per input units."""
        gradient = np.empty((len(x), len(self.offset), x.shape[1]))
        scaled = self.scaled(x)
        for group, (members, weights) in enumerate(self._weights):
            known = [(self.inputs, self._rows, weights)]
            if len(self.further):
                own = self.further_alpha[members]
                known.append((self.further, values_only(*self.further.shape), own))
            gradient[:, members] = sum(
                mean_gradient(
                    int(self.family[group]),
                    self.length[group],
                    scaled,
                    inputs,
                    rows,
                    np.ascontiguousarray(by_row.T),
                ).transpose(0, 2, 1)
                for inputs, rows, by_row in known
            )
        by_unit = warp_slope((x - self.low) / self.span, self.strength)
        gradient *= by_unit[:, None, :] * (self.scale[:, None] / self.span)
        return gradient

    def covariance(
        self, x: Array, other: Array, x_rows: Rows | None = None, other_rows: Rows | None = None
    ) -> Array:
        """(k, m_rows, q_rows) covariance of the processes at x (m, d) and other (q, d).

        By default of their values; rows may ask for derivatives by the stretched unit inputs, too.
        In output units. Of the processes themselves: the noise of a new run is not in it.
        """
        x_rows, other_rows = _or_values(x_rows, x), _or_values(other_rows, other)
        joint = np.empty((len(self.offset), x_rows.n_rows, other_rows.n_rows))
        for group in range(len(self.family)):
            basis, prior = self.basis[group].T, self.prior(group, x, other, x_rows, other_rows)
            here = basis @ self._cross_rows(group, x, x_rows)
            there = here if other is x and other_rows is x_rows else None
            if there is None:
                there = basis @ self._cross_rows(group, other, other_rows)
            for member, share in zip(self.members(group), self._shares(group), strict=True):
                joint[member] = prior - here.T @ (share[:, None] * there)
        return joint * self.variance_scale[:, None, None]

    def prior(
        self,
        group: int,
        x: Array,
        other: Array,
        x_rows: Rows | None = None,
        other_rows: Rows | None = None,
    ) -> Array:
        """(m_rows, q_rows) prior covariance at unit amplitude of a group, see `covariance`."""
        return covariance(
            int(self.family[group]),
            self.length[group],
            self.scaled(x),
            _or_values(x_rows, x),
            self.scaled(other),
            _or_values(other_rows, other),
        )

    def with_further(self, x: Array, weights: Array) -> GaussianProcesses:
        """The same with C_j(., x) @ weights[j] added to the mean of process j, in output units.

        C is `covariance` at x (q, d), weights (k, q): the change of the mean that knowing more of
        the processes at x makes, in place of any made so before. Variances, and what runs left out
        say, stay as they are.
        """
        alpha = weights * (self.variance_scale / self.scale)[:, None]
        shift = np.empty_like(self.alpha)
        for group in range(len(self.family)):
            members, basis = self.members(group), self.basis[group]
            here = basis.T @ self._cross(group, self.scaled(x))
            shift[members] = -(self._shares(group) * (alpha[members] @ here.T)) @ basis.T
        return replace(self, further=self.scaled(x), further_alpha=alpha, further_shift=shift)

    @property
    def without_further(self) -> GaussianProcesses:
        """The same conditioned on the training rows alone."""
        none = np.zeros((0, 0))
        return replace(self, further=none, further_alpha=none, further_shift=none)

    def noise_of_run(self, rows: Rows) -> Array:
        """(k, n_rows) noise variance of values and derivatives of new runs, as in `covariance`."""
        noise = np.empty((len(self.offset), rows.n_rows))
        for group in range(len(self.family)):
            members = self.members(group)
            shape = noise_shape(int(self.family[group]), self.hyperparameters(group), rows)
            noise[members] = self.nugget[members, None] * shape
        return noise * self.variance_scale[:, None]

    def leave_one_out(self) -> tuple[Array, Array]:
        """Mean (n, k) and variance (n, k) at each training input given the other runs only.

        A run is left out with its value and all its derivatives. Closed form with the
        hyperparameters held (Rasmussen & Williams 2006, eqs 5.10-5.12; in blocks: Dubrule 1983,
        Math. Geol. 15, 687).
        """
        n, k = len(self.inputs), len(self.offset)
        mean, variance = np.empty((k, n)), np.empty((k, n))
        for group in range(len(self.family)):
            members, shares = self.members(group), self._shares(group)
            for run, rows in enumerate(self._rows.of_point):
                own = rows[rows >= 0]
                basis = self.basis[group][own]
                left_out = np.linalg.inv((basis * shares[:, None]) @ basis.T)[:, 0]
                error = np.sum(left_out * self.alpha[np.ix_(members, own)], axis=1)
                mean[members, run] = self.targets[members, run] - error
                variance[members, run] = left_out[:, 0]
        variance *= self.variance_scale[:, None]
        return (self.offset[:, None] + self.scale[:, None] * mean).T, variance.T

    def scaled(self, x: Array) -> Array:
        """Inputs x (m, d) in the stretched unit box of the training points."""
        return np.ascontiguousarray(warped((x - self.low) / self.span, self.strength))

    @cached_property
    def variance_scale(self) -> Array:
        """(k,) variance of each process in output units, inflation included."""
        scale: Array = self.inflation * self.amplitude * self.scale**2
        return scale

    def _cross(self, group: int, scaled: Array) -> Array:
        """(n_rows, m) covariance at unit amplitude of training rows and values at scaled (m, d)."""
        family, length = int(self.family[group]), self.length[group]
        return value_rows(family, length, scaled, self.inputs, self._rows)

    def _cross_rows(self, group: int, x: Array, x_rows: Rows) -> Array:
        """(n_rows, m_rows) covariance at unit amplitude of training rows and rows at x (m, d)."""
        family, length = int(self.family[group]), self.length[group]
        return covariance(family, length, self.inputs, self._rows, self.scaled(x), x_rows)

    @cached_property
    def _rows(self) -> Rows:
        return rows_of(self.usable.astype(np.bool_))

    @cached_property
    def _weights(self) -> list[tuple[npt.NDArray[np.int64], Array]]:
        """Members of each group and their weights (k_g, n_rows)."""
        alpha = self.alpha + self.further_shift if len(self.further) else self.alpha
        groups = [self.members(group) for group in range(len(self.family))]
        return [(members, alpha[members]) for members in groups]

    def _further(self, group: int, scaled: Array) -> Array | float:
        """(k_g, m) part of further inputs in the mean at scaled (m, d), scaled outputs."""
        if not len(self.further):
            return 0.0
        family, length = int(self.family[group]), self.length[group]
        rows = values_only(*self.further.shape)
        cross = value_rows(family, length, scaled, self.further, rows)
        part: Array = self.further_alpha[self.members(group)] @ cross
        return part

    def _shares(self, group: int) -> Array:
        """(k_g, n_rows) 1 / (eigenvalues + nugget) of each member of a group."""
        nugget = self.nugget[self.members(group), None]
        shares: Array = 1.0 / (self.eigenvalues[group] + nugget)
        return shares

    @cached_property
    def _directions(self) -> list[tuple[Array, Array]]:
        """D (q, n_rows) and s (k_g, q) with s @ (D @ cross)^2 what the runs explain, by group."""
        found, sample = [], np.zeros((0, 0))
        if self._rows.n_rows > _MANY_ROWS:
            inside = unit_design(_N_SAMPLE, self.inputs.shape[1], 0, n_corners=0)
            # Runs too: the variance is least there, and refinement puts them where a posterior is.
            sample = np.vstack([inside, self.inputs])
        for group in range(len(self.family)):
            directions, shares = self.basis[group].T, self._shares(group)
            first = 0
            if len(sample):
                squared = (directions @ self._cross(group, sample)) ** 2
                first = unneeded(squared, shares, self.nugget[self.members(group)])
            found.append((np.ascontiguousarray(directions[first:]), shares[:, first:]))
        return found


def _or_values(rows: Rows | None, x: Array) -> Rows:
    return values_only(*x.shape) if rows is None else rows


def to_arrays(processes: GaussianProcesses) -> dict[str, Array]:
    """All arrays by name, as the constructor takes them."""
    return {field.name: getattr(processes, field.name) for field in fields(GaussianProcesses)}
