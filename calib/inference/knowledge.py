"""What data made of the prior: contraction by parameter and part of the data, and in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.inference.coordinates import Space, theta_of
from calib.inference.data_parts import Part, given, parts_of
from calib.inference.fisher import Spectrum, fisher_information, observed_information, spectrum
from calib.inference.moments import Moments
from calib.inference.posterior import Posterior
from calib.inference.profile import Profile, profile_likelihood
from calib.inference.quadrature import integrate
from calib.inference.weighted_distribution import furthest_apart, quantiles
from fe.response import Array

IS_PRIOR = 0.8
"""posterior SD over prior SD above which a parameter is said to be the prior"""
SAME = 0.15
"""largest difference of cumulative distributions up to which it is: data that leave two ranges at
the ends of a prior do not narrow it, and yet are no prior"""
KNOWN = 0.3
"""the same ratio below which it is said to be known"""
SUM_ONLY = 3.0
"""how many times better than its terms a sum is known when it is said to be known as a sum only"""
LEVELS = (0.01, 0.05, 0.16, 0.3, 0.5, 0.7, 0.84, 0.95, 0.99)
"""of the quantiles of a marginal at which its profile is looked at"""
N_PRIOR = 20_000
N_NODES = 30
MEANING = {
    "kappa": "C10 + C01",
    "r": "r = C01 / (C10 + C01)",
    "s": "s = C11 / (C10 + C01)",
}
"""what the coordinates of Mooney-Rivlin laws are called in words"""
STIFFNESS = "the stiffness (kappa = mu / 2)"
"""what kappa is of other laws"""


@dataclass(frozen=True)
class Constants:
    """Moments of the law's constants and of mu, MPa (exponents: 1)."""

    mean: Array
    """(n_constant + 1,)"""
    sd: Array
    """(n_constant + 1,)"""


@dataclass(frozen=True)
class PartKnowledge:
    """What one part of the data says."""

    part: Part
    moments: Moments
    contraction: Array
    """(d,) posterior SD over prior SD of each coordinate"""
    moved: Array
    """(d,) largest difference of the cumulative distributions of prior and posterior"""
    spectrum: Spectrum
    """of the Fisher information at the mean of the posterior given all data"""
    constants: Constants
    constants_moved: Array
    """(n_constant + 1,) as `moved`"""


@dataclass(frozen=True)
class Knowledge:
    """Identifiability before (Fisher) and after (contraction, profiles) for one hypothesis."""

    names: tuple[str, ...]
    """of the coordinates"""
    units: tuple[str, ...]
    """of the coordinates: MPa, ln MPa or "1", for example"""
    prior_sd: Array
    """(d,)"""
    constant_names: tuple[str, ...]
    """of the law's constants, mu last"""
    constant_units: tuple[str, ...]
    prior_constants: Constants
    parts: tuple[PartKnowledge, ...]
    profiles: tuple[Profile, ...]
    """of each coordinate, given all data"""
    warnings: tuple[str, ...]
    """what a reader must know, one sentence each"""

    @property
    def whole(self) -> PartKnowledge:
        """What all data together say."""
        return self.parts[-1]


def n_pieces(posterior: Posterior) -> int:
    """Pieces of work of `knowledge`: parts of the data, and profiles."""
    return len(parts_of(posterior)) + posterior.prior.space.size


def moments_of(posterior: Posterior) -> Moments:
    """By quadrature, or by importance sampling where there are many unknowns."""
    quadrature = integrate(posterior, N_NODES)
    return Moments(quadrature.x, quadrature.weights)


def information_of(posterior: Posterior, part: Part, x: Array, sd: Array) -> Array:
    """(d, d) information of a part of the data at x (d,).

    Fisher's where all coordinates are the forward model's; where sizes of errors are among them,
    the curvature of the likelihood over the posterior's SDs (d,).
    """
    jacobian = posterior.likelihood.forward.jacobian
    if not posterior.likelihood.unknown and jacobian(theta_of(x[None])).force.shape[-1] == x.size:
        return fisher_information(posterior.likelihood, x, part)
    return observed_information(given(posterior, part), x, sd)


def knowledge(
    posterior: Posterior,
    rng: np.random.Generator,
    n_profile: int = 21,
    sampled: Posterior | None = None,
    told: Callable[[], None] | None = None,
) -> Knowledge:
    """All that is asked of identifiability, for every part of the data.

    `told` is called after each of `n_pieces`.

    `sampled`, where there is another one, is the posterior of all data where these alone leave
    it: by a forward model that is better there, but not known where parts of the data reach.
    """
    sampled, tell = posterior if sampled is None else sampled, told or (lambda: None)
    space = posterior.prior.space
    drawn = posterior.prior.sample(rng, N_PRIOR)
    prior_sd, before = drawn.std(axis=0), Moments(drawn, np.full(N_PRIOR, 1.0 / N_PRIOR))
    whole = moments_of(sampled)
    centre = whole.mean
    parts = []
    for part in parts_of(posterior):
        last = part == parts_of(posterior)[-1]
        moments = whole if last else moments_of(given(posterior, part))
        information = information_of(sampled, part, centre, whole.sd)
        parts.append(
            PartKnowledge(
                part,
                moments,
                moments.sd / prior_sd,
                furthest_apart(before, moments),
                spectrum(information, prior_sd),
                constants_of(moments, space),
                furthest_apart(_in_constants(before, space), _in_constants(moments, space)),
            )
        )
        tell()
    profiles = []
    for index in range(space.size):
        profiles.append(_profile(posterior, sampled, index, whole, n_profile))
        tell()
    prior_constants = constants_of(before, space)
    of_constants = prior_constants.sd if posterior.prior.of else None
    said = warnings_of(space, prior_sd, tuple(parts), tuple(profiles), of_constants)
    return Knowledge(
        _labels(space),
        tuple(unknown.x_unit for unknown in space.unknowns),
        prior_sd,
        space.law.constants,
        space.law.units,
        prior_constants,
        tuple(parts),
        tuple(profiles),
        said,
    )


def _profile(
    posterior: Posterior, sampled: Posterior, index: int, whole: Moments, n_profile: int
) -> Profile:
    """Of a coordinate given all data, by what is known further out where it reaches beyond."""
    likely = quantiles(whole.x[:, index], whole.weights, LEVELS)
    found = profile_likelihood(sampled, index, whole.mean, whole.sd, n_profile, likely)
    if sampled is posterior or not any(found.open_ends):
        return found
    return profile_likelihood(posterior, index, whole.mean, whole.sd, n_profile, likely)


def constants_of(moments: Moments, space: Space) -> Constants:
    """Moments of the law's constants from weighted points of the coordinates."""
    values = space.constants(theta_of(moments.x))
    mean = moments.weights @ values
    return Constants(mean, np.sqrt(moments.weights @ (values - mean) ** 2))


def _in_constants(moments: Moments, space: Space) -> Moments:
    """The same points as the law's constants and mu."""
    return Moments(space.constants(theta_of(moments.x)), moments.weights)


def _labels(space: Space) -> tuple[str, ...]:
    return tuple(unknown.x_name for unknown in space.unknowns)


def warnings_of(
    space: Space,
    prior_sd: Array,
    parts: tuple[PartKnowledge, ...],
    profiles: tuple[Profile, ...],
    of_constants: Array | None = None,
) -> tuple[str, ...]:
    """What the numbers say in plain words.

    `of_constants` are the prior SDs of the constants and mu where these have the priors: what the
    data leave is then told of them, as kappa and the ratios have none that anyone stated.
    """
    whole, names = parts[-1], space.names
    meaning = MEANING if "C01" in space.law.constants else MEANING | {"kappa": STIFFNESS}
    said = [_constants_sentence(whole.moments, space)]
    said += [
        _prior_sentence(meaning.get(name, name), ratio, apart)
        for name, ratio, apart in _contractions(whole, space, of_constants)
        if ratio > IS_PRIOR
    ]
    said += _combinations(_labels(space), whole)
    for name, label, profile in zip(names, _labels(space), profiles, strict=True):
        ends = profile.open_ends
        ranges = [f"{low:.3g} to {high:.3g}" for low, high in profile.intervals]
        if len(ranges) > 1:
            said.append(f"The data leave separate ranges of {label}: {'; '.join(ranges)}.")
        if all(ends) and len(ranges) == 1:
            said.append(f"No value of {name} within the prior's bounds is refused by the data.")
        elif all(ends):
            said.append(f"The data set no limit to {name} before the prior's bounds.")
        elif any(ends):
            side = "lower" if ends[0] else "upper"
            said.append(f"The data set no limit to {name} before the prior's {side} bound.")
    for entry in parts[:-1]:
        blind = [
            meaning.get(name, name)
            for name, ratio, apart in _contractions(entry, space, of_constants)
            if ratio > 0.95 and apart < SAME
        ]
        if blind:
            said.append(f"The {entry.part} alone says nothing of {'; '.join(blind)}.")
    return tuple(said)


def _prior_sentence(name: str, ratio: float, apart: float) -> str:
    """Of what the data do not narrow, whether they say nothing or move it."""
    left = f"the data leave {100 * ratio:.0f} % of its SD"
    if apart < SAME:
        return f"{name} is the prior: {left}."
    return f"{name} is moved by the data, not narrowed: {left}."


def _contractions(
    part: PartKnowledge, space: Space, of_constants: Array | None
) -> list[tuple[str, float, float]]:
    """Of what the prior is stated of: name, posterior SD over prior SD, and how far it moved."""
    coordinates = zip(space.names, part.contraction.tolist(), part.moved.tolist(), strict=True)
    if of_constants is None:
        return list(coordinates)
    n = len(of_constants) - 1  # the last is mu, which the others make
    ratios, apart = (part.constants.sd / of_constants)[:n], part.constants_moved[:n]
    found = zip(space.law.constants[:n], ratios.tolist(), apart.tolist(), strict=True)
    return [*found, *list(coordinates)[n:]]


def _constants_sentence(moments: Moments, space: Space) -> str:
    """How well the constants of the law are known; of C10 and C01 also their sum."""
    names = space.law.constants
    found = moments.relative_sd(space.constants(theta_of(moments.x)))
    known = dict(zip(names, found.tolist(), strict=True))
    total = known.pop("mu")
    text = ""
    if {"C10", "C01"} <= set(names):
        first, second = known.pop("C10"), known.pop("C01")
        one_by_one = f"{_percent(first)} and {_percent(second)}"
        if min(first, second) > SUM_ONLY * total:
            text = f"C10 and C01 are known only as their sum, to {_percent(total)} (one by one: "
            text += f"{one_by_one})"
        else:
            text = f"C10 and C01 are known to {one_by_one}, their sum to {_percent(total)}"
    else:
        text = f"mu is known to {_percent(total)}"
    others = "".join(f"; {name} to {_percent(value)}" for name, value in known.items())
    return f"{text}{others} (SD over mean)."


def _percent(ratio: float) -> str:
    """Two digits, and no power of ten; of an SD above the mean that it is one."""
    value = 100.0 * ratio
    if value >= 100.0:
        return f"no better than {value:.0f} %"
    return f"{value:.2g} %" if value < 9.95 else f"{value:.0f} %"


def _combinations(names: tuple[str, ...], whole: PartKnowledge) -> list[str]:
    """Pairs that are known far better together than apart."""
    covariance = whole.moments.covariance
    sd = np.sqrt(np.diag(covariance))
    said = []
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            correlation = covariance[i, j] / (sd[i] * sd[j])
            if abs(correlation) > 0.9 and max(whole.contraction[i], whole.contraction[j]) > KNOWN:
                sign = "-" if correlation > 0 else "+"
                first = names[i]
                said.append(
                    f"{first} and {names[j]} are known only together, as "
                    f"{first} {sign} {sd[i] / sd[j]:.2g} {names[j]} "
                    f"(correlation {correlation:+.2f})."
                )
    return said
