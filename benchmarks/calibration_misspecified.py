"""Truths that the model cannot be: another law, compressible, friction where stick is assumed.

Each is tried without a discrepancy and with it, and so are truths that the model can be: what the
discrepancy costs where nothing is wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from benchmarks import calibration_runs as runs
from benchmarks.calibration_experiments import Experiments, by_runs, likelihood_of, sbc_prior
from benchmarks.calibration_figures import points, stuck_emulator
from calib.inference import Likelihood, Marginal, Posterior, integrate
from calib.inference.discrepancy import COMMON, TYPICAL, size_of
from calib.inference.field_likelihood import FieldLikelihood
from calib.inference.rank_uniformity import clustered_error
from calib.inference.weighted_draws import WeightedDraws, draw_weighted
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import ScaledEmulator

SPACING = 2.0 ** (1.0 / 3.0)
SHARES = 0.00125 * SPACING ** np.arange(31)
"""relative SDs of the model's error that are summed over, to 1.28: further than a model can err"""
PRIOR = Marginal("half_cauchy", 0.0, 2.0, median=TYPICAL)
COARSE = 3
"""every which share is looked at first"""
DEPTH = 12.0
"""ln of posterior weight below the best coarse share at which a share's neighbours are left out"""
RATIO_NODES = np.exp(np.sqrt(3.0) * np.log(2.0) * np.array([-1.0, 0.0, 1.0]))
RATIO_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
"""of the common error of the force over `COMMON`, known to a factor of two: lognormal with an SD of
ln 2, by the Gauss-Hermite rule of three nodes"""
N_LOOK, N_DRAWS = 512, 1024
"""draws of a first look at a share, and of a share that counts"""
FEWEST = 0.05
"""share of the draws that must be effective; else a quadrature takes their place"""
LEVEL = 0.95
"""of the central interval of mu"""
CHUNK = 100
"""experiments between two files"""

Truths = Callable[[Path], Campaign]
TRUTHS: dict[str, tuple[Truths, int]] = {
    "": (runs.other_truths, runs.SEED + 5),
    "rubbing_": (runs.rubbing_truths, runs.SEED + 7),
    "right_": (lambda store: runs.held_out_truths(store, "stuck"), runs.SEED + 8),
}
"""by the start of their figures' names; the first are those of the aim"""


@dataclass(frozen=True)
class Form:
    """One likelihood for each share of the model's error, or the only one of a model without."""

    name: str
    emulator: ScaledEmulator
    ratios: tuple[float, ...]
    """errors of the force common to all travels, over the share; none without a discrepancy"""
    weights: tuple[float, ...] = (1.0,)
    """probability of each"""

    @property
    def shares(self) -> Array:
        """(n,) shares"""
        return SHARES if self.ratios else np.zeros(1)

    @cached_property
    def rivals(self) -> list[Likelihood]:
        """The likelihood at each share, with the ratio in the middle."""
        if not self.ratios:
            return [likelihood_of(self.emulator, points())]
        middle = self.ratios[len(self.ratios) // 2]
        return [
            likelihood_of(self.emulator, points(), discrepancy=(share, middle)) for share in SHARES
        ]

    def of_ratios(self, posterior: Posterior) -> list[Posterior]:
        """The posterior at one share with each ratio."""
        found = posterior.likelihood.errors.discrepancy
        if found is None:
            return [posterior]
        each = [replace(found, of_force=ratio) for ratio in self.ratios]
        likelihood = posterior.likelihood
        errors = [replace(likelihood.errors, discrepancy=one) for one in each]
        return [replace(posterior, likelihood=replace(likelihood, errors=e)) for e in errors]


def figures(store: Path, n: int) -> dict[str, Any]:
    """Share of experiments whose interval of mu holds the truth, with the discrepancy and without.

    Truths are by FE, each serving several experiments with a modulus and errors of measurement of
    their own. The model sticks and is nearly incompressible. Its prior of kappa is the study's, ten
    times as wide on either side as what moduli are drawn from: an interval is narrow or wide by the
    data.
    """
    emulator = stuck_emulator(store)
    without = likelihood_of(emulator, points())
    unknown = Form("with", emulator, tuple(COMMON * RATIO_NODES), tuple(RATIO_WEIGHTS))
    forms = [Form("without", emulator, ()), unknown]
    known = Form("with_rival", emulator, (COMMON,))
    told: dict[str, Any] = (
        {
            "misspecified_n": n,
            "misspecified_level": LEVEL,
            "misspecified_prior_sd": float(np.ptp(runs.prior().bounds[0]) / np.sqrt(12.0)),
        }
        | of_rivals(store)
        | of_fitted_rivals(store)
    )
    for start, (truths, seed) in TRUTHS.items():
        # kappa = mu / 2 of an Ogden run at mu = 2 MPa is 1 MPa, as for ratios.
        campaign = truths(store)
        drawn = by_runs(without, sbc_prior(), campaign, n, seed)
        told[f"misspecified_{start}n_fe_runs"] = len(np.unique(drawn.run))
        for form in [*forms, known] if not start else forms:
            found = _placed(store / "placed" / f"misspecified-{start}{form.name}", form, drawn)
            told |= _described(found, drawn.run, f"misspecified_{{}}_{start}{form.name}")
            print(f"  {start}{form.name}: {told[f'misspecified_coverage_{start}{form.name}']:.2f}")
    return told


def of_rivals(store: Path) -> dict[str, float]:
    """How far the rivals of the study, stuck and sliding at the same (r, s), differ.

    What `calib.inference.discrepancy.COMMON` is held against: of forces the logarithm, its mean
    over the travels and what is left; of fields the share of a discrepancy of the stuck block.
    """
    stuck, sliding = (runs.further_training(store, name) for name in ("stuck", "sliding"))
    force = np.log(stuck.force / sliding.force)
    common = force.mean(axis=1)
    size = size_of(stuck.displacement.mean(axis=0))
    off = (stuck.displacement - sliding.displacement) / size[:, None, None]
    return {
        "rivals_field_share": float(np.sqrt(np.mean(off**2))),
        "rivals_ln_force_common": float(np.sqrt(np.mean(common**2))),
        "rivals_ln_force_shape": float(np.sqrt(np.mean((force - common[:, None]) ** 2))),
    }


def of_fitted_rivals(store: Path) -> dict[str, float]:
    """What the best fits of the stuck block to fields of the sliding one leave of these.

    The share is then what a likelihood sees; of the forces the logarithm, its mean over travels.
    """
    likelihood = likelihood_of(stuck_emulator(store), points())
    bounds = runs.prior().bounds[1:]
    starts = bounds[:, 0] + np.array([[0.2, 0.2], [0.5, 0.5], [0.8, 0.8]]) * np.ptp(bounds, axis=1)
    sliding = runs.further_training(store, "sliding")
    shares, common = [], []
    for field, force in zip(sliding.displacement, sliding.force, strict=True):

        def misfit(ratios: Array, field: Array = field) -> float:
            theta = np.array([[1.0, *ratios]])
            weights = likelihood.forward.predict(theta).weights
            basis = likelihood.forward.field_basis
            assert weights is not None and basis is not None
            off = (field - basis.fields(weights)[0]) / size_of(field)[:, None, None]
            return float(np.mean(off**2))

        fits = [minimize(misfit, start, method="L-BFGS-B", bounds=bounds) for start in starts]
        best = min(fits, key=lambda fit: float(fit.fun))
        predicted = likelihood.forward.predict(np.array([[1.0, *best.x]])).force[0]
        shares.append(float(np.sqrt(best.fun)))
        common.append(float(np.mean(np.log(force / predicted))))
    return {
        "rivals_fitted_field_share": float(np.sqrt(np.mean(np.square(shares)))),
        "rivals_fitted_ln_force_common": float(np.sqrt(np.mean(np.square(common)))),
    }


def _described(found: dict[str, Array], run: Array, name: str) -> dict[str, Any]:
    inside = (np.abs(found["below"] - 0.5) <= 0.5 * LEVEL).astype(float)
    told = {
        name.format("coverage"): float(inside.mean()),
        name.format("coverage") + "_standard_error": clustered_error(inside, run),
        name.format("bias"): float(found["off"].mean()),
        name.format("rms_error"): float(np.sqrt(np.mean(found["off"] ** 2))),
        name.format("sd"): float(found["sd"].mean()),
    }
    if found["share"].any():
        told[name.format("share")] = float(found["share"].mean())
        told[name.format("share") + "_range"] = [
            float(found["share"].min()),
            float(found["share"].max()),
        ]
    return told


def _placed(folder: Path, form: Form, drawn: Experiments) -> dict[str, Array]:
    """Posterior probability below the true mu, mean and SD of ln mu, by experiment; kept."""
    folder.mkdir(parents=True, exist_ok=True)
    names, n = ("below", "off", "sd", "share", "ess"), len(drawn.x)
    chunks = []
    for first in range(0, n, CHUNK):
        path = folder / f"{n}_{first}.npz"
        if not path.exists():
            print(f"  {folder.name}: {first}/{n}", flush=True)
            rows = _chunk(form, drawn, np.arange(first, min(first + CHUNK, n)))
            part = path.with_suffix(".part.npz")
            np.savez(part, **dict(zip(names, np.array(rows).T, strict=True)))
            part.replace(path)
        with np.load(path) as stored:
            chunks.append({name: stored[name] for name in names})
    return {name: np.concatenate([chunk[name] for chunk in chunks]) for name in names}


def _chunk(form: Form, drawn: Experiments, index: Array) -> list[tuple[float, ...]]:
    """Fields of a chunk are projected together, under each share."""
    fields: list[list[FieldLikelihood]] = []
    for rival in form.rivals:
        assert rival.field is not None
        fields.append(rival.field.of_fields(drawn.field[index]))
    prior, rows = runs.prior(), []
    for row, i in enumerate(index):
        posteriors = [
            Posterior(prior, replace(rival, force=drawn.force[i], field=own[row]))
            for rival, own in zip(form.rivals, fields, strict=True)
        ]
        rows.append(_of(posteriors, form, float(drawn.x[i, 0]), int(i)))
    return rows


def _of(posteriors: list[Posterior], form: Form, truth: float, index: int) -> tuple[float, ...]:
    """Average over shares and ratios by their posterior probability."""
    shares = form.shares
    rng = [np.random.default_rng([7, index, k]) for k in range(len(shares))]
    # A share of ln share: they are equally far apart on that scale.
    log_prior = PRIOR.log_density(shares) + np.log(shares) if len(shares) > 1 else np.zeros(1)
    kept = np.arange(len(shares))
    if len(kept) > 1:
        look = kept[::COARSE]
        value = [_sampled(posteriors[k], rng[k], N_LOOK).log_evidence for k in look]
        kept = _worth(np.array(value) + log_prior[look], look, len(shares))
    pairs = [(k, one) for k in kept for one in form.of_ratios(posteriors[k])]
    found = [_sampled(one, rng[k], N_DRAWS) for k, one in pairs]
    kept = np.array([k for k, _ in pairs])
    weight = np.array([draws.log_evidence for draws in found]) + log_prior[kept]
    weight += np.tile(np.log(form.weights), len(pairs) // len(form.weights))
    each = np.exp(weight - logsumexp(weight))
    x = np.concatenate([draws.x[:, 0] for draws in found])
    weights = np.concatenate([p * draws.weights for p, draws in zip(each, found, strict=True)])
    mean = float(weights @ x)
    return (
        float(weights @ (x < truth)),
        mean - truth,
        float(np.sqrt(weights @ (x - mean) ** 2)),
        float(each @ shares[kept]),
        float(1.0 / np.sum(weights**2)),
    )


def _worth(value: Array, look: Array, n: int) -> Array:
    """Shares between the best coarse one and its neighbours, and about all that come near it."""
    near = np.abs(np.arange(n)[:, None] - look) < COARSE
    good = value > value.max() - DEPTH
    kept: Array = np.flatnonzero((near & good).any(axis=1))
    return kept


def _sampled(posterior: Posterior, rng: np.random.Generator, n: int) -> WeightedDraws:
    """Weighted draws, or the nodes of a quadrature where a posterior is squeezed into a corner."""
    with suppress(ValueError):
        found = draw_weighted(posterior, rng, n, n_round=n // 2)
        if found.ess > FEWEST * n:
            return found
    exact = integrate(posterior, 18)
    return WeightedDraws(exact.x, exact.weights, exact.log_evidence, 0)
