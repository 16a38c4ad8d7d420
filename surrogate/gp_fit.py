"""Fits of Gaussian processes: scaling, hyperparameters by evidence, posterior arrays."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from surrogate.covariance import FAMILIES, rows_of
from surrogate.evidence import (
    Fitted,
    Hyperparameters,
    Spectrum,
    best_nuggets,
    bounds_reached,
    maximise_evidence,
    nuggets_of,
    spectrum,
)
from surrogate.gp import GaussianProcesses
from surrogate.regressor import fit_regressor, from_regressor
from surrogate.warp import warp_slope, warped

Array = npt.NDArray[np.float64]
Sharing = Literal["auto", "all", "leading", "none"]
"""whether all outputs share a covariance, all but the first two, or none; "auto": see `_groups`"""

_N_LEADING = 2
_MANY_RUNS = 40
"""runs without derivatives above which covariances are shared: what a search costs is cubic"""
_MOST_PARTED = 200
"""values and derivatives up to which processes are parted by `_parted`: each group costs a search,
and a product of that size in predictions"""
_MOST_GROUPS = 3
_NOISE = 0.01
"""nugget above which a process is next to noise to the covariance of its group"""


class Scaled(NamedTuple):
    """Runs in the stretched unit box, outputs of mean 0 and variance 1, and how they got there."""

    low: Array
    span: Array
    strength: Array
    offset: Array
    scale: Array
    inputs: Array
    """(n, d)"""
    usable: npt.NDArray[np.bool_]
    """(n, d)"""
    targets: Array
    """(k, n_rows)"""


def fit_processes(
    x: Array,
    y: Array,
    seed: int,
    *,
    slopes: Array | None = None,
    strength: Array | None = None,
    n_restarts: int = 1,
    sharing: Sharing = "auto",
    families: tuple[str, ...] = FAMILIES,
) -> GaussianProcesses:
    """Fit a process to each column of y (n, k) over x (n, d) by maximum marginal likelihood.

    `slopes` (n, k, d) are derivatives of y; NaN marks those that cannot be used, which then teach
    nothing. `strength` (d,) stretches the inputs (see `surrogate.warp`). Without slopes,
    scikit-learn's regressor searches the hyperparameters, else our own evidence of values and
    derivatives. The covariance of `families` with the largest evidence is kept. Searches start from
    a fixed point and `n_restarts` random ones, with seeds spawned from `seed`, so that a process
    with its own covariance does not depend on the other columns. Maximum likelihood takes a
    variance too small, as in regression, so variances are inflated by n / (n - p) with the p fitted
    numbers of a process: mean, amplitude and its part of lengths and nuggets; or by what the errors
    of runs left out ask for, where that is more (see `_honest`).
    Raises ValueError for fewer than 3 runs, inputs that do not vary, constant outputs or unknown
    families.
    """
    unknown = set(families) - set(FAMILIES)
    if unknown or not families:
        raise ValueError(f"families: expected some of {FAMILIES}, found {families}")
    scaled = scale_runs(x, y, slopes, strength)
    k = len(scaled.targets)
    groups = _groups(k, scaled.usable, sharing)
    places = tuple(FAMILIES.index(family) for family in families)
    if sharing == "auto" and scaled.usable.any() and scaled.targets.shape[1] <= _MOST_PARTED:
        return _honest(posterior(scaled, *_parted(scaled, places, seed, n_restarts)))
    fitted = [
        _fit_group(scaled, members, places, child, n_restarts)
        for members, child in zip(
            groups, np.random.SeedSequence(seed).spawn(len(groups)), strict=True
        )
    ]
    return _honest(posterior(scaled, groups, fitted))


def _parted(
    scaled: Scaled, families: tuple[int, ...], seed: int, n_restarts: int
) -> tuple[list[npt.NDArray[np.int64]], list[Fitted]]:
    """Groups of processes that share a covariance, the smoothest first, and their fits.

    Strong modes are smooth and fix the lengths that all share; to such lengths the weak ones, where
    kinks of contact are, are noise, and their evidence is then largest with nothing but noise. So
    what is noise to the covariance of a group gets one of its own, and every process goes to
    the covariance under which it is most probable.
    """
    members, fits = np.arange(len(scaled.targets)), []
    for child in np.random.SeedSequence(seed).spawn(_MOST_GROUPS):
        fits.append(_fit_group(scaled, members, families, child, n_restarts))
        members = members[fits[-1].nugget > _NOISE]
        if not len(members):
            break
    rows, targets = rows_of(scaled.usable), np.ascontiguousarray(scaled.targets.T)
    found = [
        nuggets_of(fit.family, fit.hyperparameters, scaled.inputs, rows, targets) for fit in fits
    ]
    best = np.argmax([evidence for _, evidence in found], axis=0)
    groups, kept = [], []
    for place, fit in enumerate(fits):
        own = np.flatnonzero(best == place)
        if len(own):
            groups.append(own)
            kept.append(fit._replace(nugget=found[place][0][own]))
    return groups, kept


def _honest(processes: GaussianProcesses) -> GaussianProcesses:
    """With variances no less than the squared errors of runs left out, in the mean over runs.

    A stationary process is too sure where the outputs change faster than elsewhere. Corners are
    not counted where they are few: leaving one out asks to extrapolate, which no prediction does.
    """
    inputs, n = processes.inputs, len(processes.inputs)
    inner: npt.NDArray[np.bool_] = np.any((inputs > 0.0) & (inputs < 1.0), axis=1)
    if np.count_nonzero(inner) < n / 2:
        inner = np.ones(n, dtype=np.bool_)
    mean, variance = processes.leave_one_out()
    values = processes.offset + processes.scale * processes.targets[:, :n].T
    squared = ((mean - values) ** 2 / variance)[inner].mean(axis=0)
    return replace(processes, inflation=processes.inflation * np.maximum(squared, 1.0))


def _groups(k: int, usable: npt.NDArray[np.bool_], sharing: Sharing) -> list[npt.NDArray[np.int64]]:
    """Outputs that share a covariance.

    By default all with derivatives (few rows are parted further, see `_parted`); without, each has
    its own until there are many runs.
    """
    if sharing not in get_args(Sharing):
        known = ", ".join(get_args(Sharing))
        raise ValueError(f"sharing: expected one of {known}, found {sharing!r}")
    if sharing == "auto":
        few: Sharing = "none" if len(usable) <= _MANY_RUNS else "leading"
        sharing = "all" if usable.any() else few
    n_own = {"all": 0, "leading": min(_N_LEADING, k), "none": k}[sharing]
    groups = [np.array([j]) for j in range(n_own)]
    return groups if n_own == k else [*groups, np.arange(n_own, k)]


def scale_runs(
    x: Array, y: Array, slopes: Array | None = None, strength: Array | None = None
) -> Scaled:
    """Scale runs for a fit; raises ValueError as `fit_processes` does."""
    low, span = x.min(axis=0), np.ptp(x, axis=0)
    outputs = np.ascontiguousarray(y.T)  # rows are summed alike however many there are
    offset, scale = outputs.mean(axis=1), outputs.std(axis=1)
    if len(x) < 3 or not (span > 0.0).all():
        raise ValueError(f"x: need at least 3 runs that vary in every input, got {x.shape}")
    varies = (np.ptp(outputs, axis=1) > 0.0) & (scale > 0.0)
    if not varies.all():
        raise ValueError(f"y: column {int(np.argmin(varies))} is constant; leave it out")
    targets = (outputs - offset[:, None]) / scale[:, None]
    strength = np.zeros(x.shape[1]) if strength is None else strength
    unit = (x - low) / span
    usable: npt.NDArray[np.bool_] = np.zeros(x.shape, dtype=np.bool_)
    if slopes is not None:
        if slopes.shape != (*y.shape, x.shape[1]):
            raise ValueError(
                f"slopes: expected shape {(*y.shape, x.shape[1])}, found {slopes.shape}"
            )
        usable = np.asarray(np.isfinite(slopes).all(axis=1), dtype=np.bool_)
        in_box = (slopes / scale[:, None]).transpose(0, 2, 1)
        by_stretched = in_box * (span / warp_slope(unit, strength))[:, :, None]
        targets = np.concatenate([targets, by_stretched[usable].T], axis=1)
    return Scaled(low, span, strength, offset, scale, warped(unit, strength), usable, targets)


def conditioned(scaled: Scaled, family: int, hyperparameters: Hyperparameters) -> GaussianProcesses:
    """Processes of one covariance with given lengths on the runs, each with its best nugget."""
    rows = rows_of(scaled.usable)
    decomposed = spectrum(family, hyperparameters, scaled.inputs, rows)
    nugget = best_nuggets(decomposed.values, decomposed.basis.T @ scaled.targets.T)
    every = np.arange(len(scaled.inputs))
    fit = Fitted(family, hyperparameters, nugget, np.nan, every, rows.n_rows)
    return posterior(scaled, [np.arange(len(scaled.targets))], [fit], [decomposed])


def posterior(
    scaled: Scaled,
    groups: list[npt.NDArray[np.int64]],
    fitted: list[Fitted],
    spectra: list[Spectrum] | None = None,
) -> GaussianProcesses:
    """Condition processes with given hyperparameters on the runs; `spectra` if known, by group."""
    k, n_rows = scaled.targets.shape
    rows = rows_of(scaled.usable)
    d = scaled.inputs.shape[1]
    group, nugget, amplitude, inflation = (np.empty(k) for _ in range(4))
    alpha = np.empty((k, n_rows))
    if spectra is None:
        spectra = [spectrum(f.family, f.hyperparameters, scaled.inputs, rows) for f in fitted]
    for place, (members, fit) in enumerate(zip(groups, fitted, strict=True)):
        decomposed = spectra[place]
        rotated = decomposed.basis.T @ scaled.targets[members].T
        solved = rotated / (decomposed.values[:, None] + fit.nugget)
        alpha[members] = (decomposed.basis @ solved).T
        amplitude[members] = np.einsum("nk,nk->k", rotated, solved) / n_rows
        group[members], nugget[members] = place, fit.nugget
        n_fitted = 3 + (d + scaled.usable.any()) / len(members)
        inflation[members] = n_rows / max(n_rows - n_fitted, 1.0)
    return GaussianProcesses(
        low=scaled.low,
        span=scaled.span,
        strength=scaled.strength,
        inputs=scaled.inputs,
        usable=scaled.usable.astype(np.float64),
        offset=scaled.offset,
        scale=scaled.scale,
        targets=scaled.targets,
        group=group,
        amplitude=amplitude,
        inflation=inflation,
        family=np.array([float(fit.family) for fit in fitted]),
        length=np.array([fit.hyperparameters.length for fit in fitted]),
        nugget=nugget,
        roughness=np.array([fit.hyperparameters.roughness for fit in fitted]),
        alpha=alpha,
        basis=np.array([np.ascontiguousarray(decomposed.basis) for decomposed in spectra]),
        eigenvalues=np.array([decomposed.values for decomposed in spectra]),
    )


def at_bounds(processes: GaussianProcesses) -> list[str]:
    """What a search left at a bound, one phrase each: a hint that the data do not say it."""
    has_slopes = bool(processes.usable.any())
    found = []
    for group in range(len(processes.family)):
        members = ", ".join(str(member) for member in processes.members(group))
        nugget = processes.nugget[processes.members(group)]
        reached = bounds_reached(processes.hyperparameters(group), nugget, has_slopes)
        found += [f"{what} (processes {members})" for what in reached]
    return found


def too_few(processes: GaussianProcesses) -> list[str]:
    """A phrase where runs hardly tell the covariance, and leaving one out does not show it.

    On toys without derivatives, stated errors of 5 to 7 runs over two inputs were up to 60 times
    too small, those of 8 up to 11, from 10 on 1.5 times.
    """
    n_rows, d = processes.targets.shape[1], processes.inputs.shape[1]
    expected = 2 * (3 + d)
    if n_rows >= expected:
        return []
    what = f"{n_rows} values and derivatives of each process, expected {expected} or more"
    return [f"{what}: its stated errors mean little"]


def _fit_group(
    scaled: Scaled,
    members: npt.NDArray[np.int64],
    families: tuple[int, ...],
    seed: np.random.SeedSequence,
    n_restarts: int,
) -> Fitted:
    targets = np.ascontiguousarray(scaled.targets[members].T)
    if scaled.usable.any():
        rng = np.random.default_rng(seed)
        return maximise_evidence(families, scaled.inputs, scaled.usable, targets, rng, n_restarts)
    number = int(seed.generate_state(1)[0])
    fits = [
        fit_regressor(scaled.inputs, targets, number, FAMILIES[family], n_restarts=0)
        for family in families
    ]
    best = int(np.argmax([fit.log_marginal_likelihood_value_ for fit in fits]))
    if not n_restarts:
        return from_regressor(fits[best], families[best])
    family = families[best]
    again = fit_regressor(
        scaled.inputs,
        targets,
        number,
        FAMILIES[family],
        n_restarts=n_restarts,
        begun=fits[best],
    )
    return from_regressor(again, family)
