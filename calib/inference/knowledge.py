"""What data made of the prior: contraction by parameter and part of the data, and in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.inference.coordinates import PARAMETERS, constants_of, theta_of
from calib.inference.data_parts import Part, given, parts_of
from calib.inference.fisher import Spectrum, fisher_information, observed_information, spectrum
from calib.inference.moments import Moments
from calib.inference.nested import nested
from calib.inference.posterior import Posterior
from calib.inference.profile import Profile, profile_likelihood
from calib.inference.quadrature import integrate
from fe.response import Array

IS_PRIOR = 0.8
"""posterior SD over prior SD above which a parameter is said to be the prior"""
KNOWN = 0.3
"""the same ratio below which it is said to be known"""
SUM_ONLY = 3.0
"""how many times better than its terms a sum is known when it is said to be known as a sum only"""
N_PRIOR = 20_000
N_NODES = 30
MEANING = {
    "kappa": "C10 + C01",
    "r": "r = C01 / (C10 + C01)",
    "s": "s = C11 / (C10 + C01)",
}
"""what the coordinates are called in words"""


@dataclass(frozen=True)
class PartKnowledge:
    """What one part of the data says."""

    part: Part
    moments: Moments
    contraction: Array
    """(d,) posterior SD over prior SD of each coordinate"""
    spectrum: Spectrum
    """of the Fisher information at the mean of the posterior given all data"""


@dataclass(frozen=True)
class Knowledge:
    """Identifiability before (Fisher) and after (contraction, profiles) for one hypothesis."""

    names: tuple[str, ...]
    """coordinates; the first is the logarithm of what it is called"""
    prior_sd: Array
    """(d,)"""
    parts: tuple[PartKnowledge, ...]
    profiles: tuple[Profile, ...]
    """of each coordinate, given all data"""
    warnings: tuple[str, ...]
    """what a reader must know, one sentence each"""

    @property
    def whole(self) -> PartKnowledge:
        """What all data together say."""
        return self.parts[-1]


def moments_of(posterior: Posterior, rng: np.random.Generator) -> Moments:
    """By quadrature for three coordinates, by nested sampling for any other number."""
    if posterior.prior.bounds.shape[0] == 3:
        quadrature = integrate(posterior, N_NODES)
        return Moments(quadrature.x, quadrature.weights)
    return nested(posterior, rng).moments


def information_of(posterior: Posterior, part: Part, x: Array, sd: Array) -> Array:
    """(d, d) information of a part of the data at x (d,).

    Fisher's where all coordinates are the forward model's; where sizes of errors are among them,
    the curvature of the likelihood over the posterior's SDs (d,).
    """
    jacobian = posterior.likelihood.forward.jacobian
    if x.size == 3 and jacobian(theta_of(x[None])).force.shape[-1] == x.size:
        return fisher_information(posterior.likelihood, x, part)
    return observed_information(given(posterior, part), x, sd)


def knowledge(
    posterior: Posterior,
    rng: np.random.Generator,
    names: tuple[str, ...] = PARAMETERS,
    n_profile: int = 21,
) -> Knowledge:
    """All that is asked of identifiability, for every part of the data.

    Raises ValueError when there is another number of names than of coordinates.
    """
    d = posterior.prior.bounds.shape[0]
    if len(names) != d:
        raise ValueError(f"names: expected {d} as coordinates, got {len(names)}")
    prior_sd = posterior.prior.sample(rng, N_PRIOR).std(axis=0)
    whole = moments_of(posterior, rng)
    centre = whole.mean
    parts = []
    for part in parts_of(posterior):
        last = part == parts_of(posterior)[-1]
        moments = whole if last else moments_of(given(posterior, part), rng)
        information = information_of(posterior, part, centre, whole.sd)
        parts.append(
            PartKnowledge(part, moments, moments.sd / prior_sd, spectrum(information, prior_sd))
        )
    profiles = tuple(
        profile_likelihood(posterior, index, centre, whole.sd, n_profile) for index in range(d)
    )
    said = warnings_of(names, prior_sd, tuple(parts), profiles)
    return Knowledge(names, prior_sd, tuple(parts), profiles, said)


def warnings_of(
    names: tuple[str, ...],
    prior_sd: Array,
    parts: tuple[PartKnowledge, ...],
    profiles: tuple[Profile, ...],
) -> tuple[str, ...]:
    """What the numbers say in plain words."""
    whole = parts[-1]
    said = [_constants_sentence(whole.moments)]
    said += [
        f"{MEANING.get(name, name)} is the prior: the data leave {100 * ratio:.0f} % of its SD."
        for name, ratio in zip(names, whole.contraction, strict=True)
        if ratio > IS_PRIOR
    ]
    said += _combinations(names, prior_sd, whole)
    for name, profile in zip(names, profiles, strict=True):
        ends = profile.open_ends
        if all(ends):
            said.append(f"No value of {name} within the prior's bounds is refused by the data.")
        elif any(ends):
            side = "lower" if ends[0] else "upper"
            said.append(f"The data set no limit to {name} before the prior's {side} bound.")
    for entry in parts[:-1]:
        blind = [
            MEANING.get(name, name)
            for name, ratio in zip(names, entry.contraction, strict=True)
            if ratio > 0.95
        ]
        if blind:
            said.append(f"The {entry.part} alone says nothing of {'; '.join(blind)}.")
    return tuple(said)


def _constants_sentence(moments: Moments) -> str:
    """How well C10, C01 and their sum are known."""
    c10, c01, c11, mu = np.moveaxis(constants_of(theta_of(moments.x)[:, :3]), -1, 0)
    first, second, third, total = moments.relative_sd(np.column_stack([c10, c01, c11, mu]))
    one_by_one = f"{100 * first:.2g} % and {100 * second:.2g} %"
    if min(first, second) > SUM_ONLY * total:
        text = f"C10 and C01 are known only as their sum, to {100 * total:.2g} % (one by one: "
        text += f"{one_by_one})"
    else:
        text = f"C10 and C01 are known to {one_by_one}, their sum to {100 * total:.2g} %"
    return f"{text}; C11 to {100 * third:.2g} % (SD over mean)."


def _combinations(names: tuple[str, ...], prior_sd: Array, whole: PartKnowledge) -> list[str]:
    """Pairs that are known far better together than apart."""
    covariance = whole.moments.covariance
    sd = np.sqrt(np.diag(covariance))
    said = []
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            correlation = covariance[i, j] / (sd[i] * sd[j])
            if abs(correlation) > 0.9 and max(whole.contraction[i], whole.contraction[j]) > KNOWN:
                sign = "-" if correlation > 0 else "+"
                first = "ln kappa" if i == 0 and names[0] == "kappa" else names[i]
                said.append(
                    f"{first} and {names[j]} are known only together, as "
                    f"{first} {sign} {sd[i] / sd[j]:.2g} {names[j]} "
                    f"(correlation {correlation:+.2f})."
                )
    return said
