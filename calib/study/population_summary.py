"""What a population's file says: the population, its samples, a new one, and convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.inference.convergence import Convergence, convergence_of
from calib.inference.inference_data import load_inference_data, provenance_of
from calib.inference.population import ScatterPrior
from calib.inference.population_data import ALONE, NEW, ONE, SD
from calib.study.figure_style import Array, hdi

ODD = 0.01
"""p-value over the number of samples below which constants do not explain a sample"""
MOST_OF_PRIOR = 0.8
"""SD of a scatter over that of its prior above which the data hardly speak of it"""


NAMED = 4
"""samples that lean on one bound are named, at most"""


@dataclass(frozen=True)
class Spread:
    """Mean, SD and interval of one quantity."""

    unit: str
    mean: float
    sd: float
    hdi_low: float
    hdi_high: float


@dataclass(frozen=True)
class PopulationSummary:
    """The hierarchical model under one hypothesis."""

    varying: tuple[str, ...]
    """parameters that differ between samples"""
    sample_names: tuple[str, ...]
    population: dict[str, Spread]
    """constants, parameters and SDs between samples (`sd_` before the parameter's name)"""
    convergence: dict[str, Convergence]
    """of the same"""
    new: dict[str, Spread]
    """constants and parameters of a sample not yet seen"""
    samples: dict[str, tuple[Spread, ...]]
    """constants and varying parameters of each sample"""
    alone: dict[str, tuple[Spread, ...]]
    """the same by its own data"""
    fit_p: tuple[float, ...]
    """p-value of each sample's residuals"""
    prior_driven: tuple[str, ...]
    """SDs between samples that are hardly narrower than their prior, and lie where it does"""
    beyond_prior: tuple[str, ...]
    """SDs between samples that lie beyond what their prior expects"""
    leaning: tuple[tuple[str, str], ...]
    """of the population and of samples by name: bounds of the prior that they lean on"""
    force_new: tuple[Spread, ...]
    """force of a new sample at each travel, N"""
    travel: tuple[float, ...]
    sampling: dict[str, Any]
    failures: tuple[str, ...]
    """diagnostics outside the limits of the study, one sentence each"""
    without_field: tuple[str, ...] = ()
    """samples whose forces count alone, as no point of their fields is there at all increments"""


def population_remarks(found: PopulationSummary) -> list[str]:
    """What speaks against the population: short chains, odd samples, bounds, a narrow prior."""
    said = []
    if found.sampling.get("status", "converged") != "converged":
        said.append(f"the population's chains were stopped early: {found.sampling['message']}")
    said += [
        f"the forces or the field of {name} lie outside what any constants explain (fit p = "
        f"{p:.2g}); it draws what is common to all samples, and their scatter"
        for name, p in zip(found.sample_names, found.fit_p, strict=True)
        if p < ODD / len(found.sample_names)
    ]
    said += [
        f"{_listed(names)} on the prior's {bounds}: a convention of the prior, not a finding, and "
        "SDs say little about distance"
        for bounds, names in _by_bounds(found.leaning).items()
    ]
    said += [
        f"the scatter of {name.removeprefix(SD)} lies beyond what its prior expects, which holds "
        "it down: is its size in population.scatter too small?"
        for name in found.beyond_prior
    ]
    said += [
        f"of {name} the forces count alone: no point of its field is there at all increments"
        for name in found.without_field
    ]
    return said


def _by_bounds(leaning: Sequence[tuple[str, str]]) -> dict[str, list[str]]:
    """Who leans on the same bounds."""
    found: dict[str, list[str]] = {}
    for name, bounds in leaning:
        found.setdefault(bounds, []).append(name)
    return found


def _listed(names: Sequence[str]) -> str:
    """Names and a verb; of many the first three."""
    if len(names) == 1:
        return f"{names[0]} leans"
    if len(names) > NAMED:
        return f"{', '.join(names[: NAMED - 1])} and {len(names) - NAMED + 1} more lean"
    return f"{', '.join(names[:-1])} and {names[-1]} lean"


def population_path(out: Path, hypothesis: str) -> Path:
    """File of a hypothesis' population in the folder of a study."""
    return out / f"population_{hypothesis}.nc"


def load_population(path: Path) -> PopulationSummary:
    """Summary of a population_<hypothesis>.nc; raises ValueError naming a damaged file."""
    data = load_inference_data(path)
    facts: dict[str, Any] = dict(provenance_of(data))
    posterior, constant = data["posterior"], data["constant_data"]
    ensemble = posterior["ensemble"].values
    plain_names = [
        str(name)
        for name in posterior.data_vars
        if not str(name).endswith(NEW) and not str(name).endswith(ONE)
    ]
    shown = [*facts["constants"], *(n for n in facts["varying"] if n not in facts["constants"])]
    found = {
        name: convergence_of(posterior[name].transpose("chain", "draw").values, ensemble)
        for name in plain_names
    }
    predictive = data["posterior_predictive"]["force_new"]
    return PopulationSummary(
        varying=tuple(facts["varying"]),
        sample_names=tuple(str(name) for name in posterior["sample"].values),
        population={name: _spread(posterior[name]) for name in plain_names},
        convergence=found,
        new={name: _spread(posterior[name + NEW]) for name in shown},
        samples={name: _each(posterior[name + ONE]) for name in shown},
        alone={name: _each(constant[name + ALONE]) for name in shown},
        fit_p=tuple(float(p) for p in constant["fit_p"].values),
        prior_driven=tuple(
            SD + name for name in facts["varying"] if is_prior(posterior[SD + name], name, facts)
        ),
        beyond_prior=tuple(
            SD + name for name in facts["varying"] if is_beyond(posterior[SD + name], name, facts)
        ),
        leaning=tuple((name, " and ".join(bounds)) for name, bounds in facts.get("leaning", [])),
        force_new=tuple(
            _spread(predictive.isel(travel=i)) for i in range(predictive.sizes["travel"])
        ),
        travel=tuple(float(d) for d in predictive["travel"].values),
        sampling=facts["sampling"],
        failures=tuple(
            _failures(found | worst_of_samples(posterior, facts["varying"]), facts["limits"])
        ),
        without_field=tuple(facts.get("without_field", ())),
    )


def worst_of_samples(posterior: Any, varying: Sequence[str]) -> dict[str, Convergence]:
    """Convergence of the worst samples, of each parameter that varies, by what it is called."""
    found = {}
    ensemble = posterior["ensemble"].values
    for name in varying:
        draws = posterior[name + ONE].transpose("sample", "chain", "draw").values
        each = [convergence_of(one, ensemble) for one in draws]
        r_hat = [one.r_hat for one in each]
        ess = [min(one.ess_bulk, one.ess_tail) for one in each]
        for worst in (int(np.argmax(r_hat)), int(np.argmin(ess))):
            found[f"{name} of {posterior['sample'].values[worst]}"] = each[worst]
    return found


def _spread(draws: Any) -> Spread:
    """Of a variable with its unit."""
    values: Array = np.asarray(draws.values, dtype=np.float64).ravel()
    low, high = hdi(values)
    unit = str(draws.attrs.get("units", "1"))
    return Spread(unit, float(values.mean()), float(values.std(ddof=1)), low, high)


def _each(draws: Any) -> tuple[Spread, ...]:
    return tuple(_spread(draws.isel(sample=i)) for i in range(draws.sizes["sample"]))


def is_prior(draws: Any, name: str, facts: Mapping[str, Any]) -> bool:
    """Whether the posterior of an SD between samples is nearly as wide as its prior, and there."""
    low, middle, high = ScatterPrior(**facts["scatter"][name]).quantile(np.array([0.05, 0.5, 0.95]))
    posterior = np.quantile(draws.values, [0.05, 0.95])
    return bool(np.ptp(posterior) > MOST_OF_PRIOR * (high - low) and posterior[0] < middle)


def is_beyond(draws: Any, name: str, facts: Mapping[str, Any]) -> bool:
    """Whether an SD between samples is probably larger than all but 5 % of its prior."""
    [most] = ScatterPrior(**facts["scatter"][name]).quantile(np.array([0.95]))
    return bool(np.median(draws.values) > most)


def _failures(found: Mapping[str, Convergence], limits: Mapping[str, float]) -> list[str]:
    failures = []
    for name, one in found.items():
        if not one.r_hat <= limits["max_r_hat"]:
            failures.append(
                f"population {name}: R-hat is {one.r_hat:.4f}, above {limits['max_r_hat']:g}"
            )
        ess = min(one.ess_bulk, one.ess_tail)
        if not ess >= limits["min_ess"]:
            failures.append(f"population {name}: ESS is {ess:.0f}, below {limits['min_ess']:g}")
    return failures
