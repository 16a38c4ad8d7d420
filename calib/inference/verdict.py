"""What evidence and fit of rival hypotheses say in words.

The evidence is the likelihood averaged over the prior. When two hypotheses fit equally well at
their best, their Bayes factor is the ratio of the shares of the prior that fit (the Occam factor)
and changes with the bounds of the prior; that is not said to be support by the data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STRONG = float(np.log(20.0))
"""ln Bayes factor called decisive here: 20 to 1, "strong" in Kass & Raftery, JASA 90 (1995) 773"""
POOR_FIT = 0.01
"""posterior predictive p-value below which the forces contradict a hypothesis"""
BARE_FIT = 0.05
"""posterior predictive p-value below which the forces are not said to be compatible without more"""
HOPELESS = 1e-10
"""predictive p-value of all hypotheses below which the data are doubted before the hypotheses"""
NONE_EXPLAINS = (
    "No hypothesis explains the forces: before contact and law are asked, see whether they are in "
    "N and the travel in mm."
)


@dataclass(frozen=True)
class HypothesisFit:
    """How one hypothesis stands."""

    name: str
    log_evidence: float
    log_evidence_error: float
    p_value: float
    """posterior predictive p-value of the forces' chi-square"""
    mu_mean: float
    """posterior mean of mu = 2 (C10 + C01), MPa"""
    mu_sd: float
    """posterior SD of mu, MPa"""
    max_log_likelihood: float
    """largest ln likelihood of all data (force, and field where there is one) in the prior's box"""
    best_misfit: float
    """chi-square of the forces at that point, of as many values as there are increments"""

    @property
    def contradicted(self) -> bool:
        """Whether the forces lie outside what the hypothesis can explain."""
        return self.p_value < POOR_FIT


def verdict_of(fits: tuple[HypothesisFit, ...]) -> str:
    """What the data support and what they cannot separate; best evidence first in `fits`."""
    leader, rivals = fits[0], fits[1:]
    sentences = _level(leader, rivals)
    sentences += [_against(leader, rival) for rival in rivals if _factor(leader, rival) > STRONG]
    for fit in fits:
        word = "contradict" if fit.contradicted else "are compatible with"
        if POOR_FIT <= fit.p_value < BARE_FIT:
            word = "are hardly compatible with"
        sentences.append(f"The forces {word} {fit.name} (predictive p = {fit.p_value:.3g}).")
    if all(fit.p_value < HOPELESS for fit in fits):
        sentences.append(NONE_EXPLAINS)
    return " ".join(sentences)


def _factor(leader: HypothesisFit, rival: HypothesisFit) -> float:
    """Bayes factor of the leader over the rival, ln."""
    return leader.log_evidence - rival.log_evidence


def _factor_error(leader: HypothesisFit, rival: HypothesisFit) -> float:
    """Numerical error of that."""
    return float(np.hypot(leader.log_evidence_error, rival.log_evidence_error))


def bayes_factor(log_factor: float) -> str:
    """A Bayes factor in words, from its ln: beyond a hundred digits by its power of ten alone."""
    power = log_factor / np.log(10.0)
    return f"{np.exp(log_factor):.3g}" if power < 100.0 else f"10^{power:.0f}"


def _gain(leader: HypothesisFit, rival: HypothesisFit) -> float:
    """By how much the leader fits better at its best, in ln likelihood."""
    return leader.max_log_likelihood - rival.max_log_likelihood


def _best(leader: HypothesisFit, rival: HypothesisFit) -> str:
    return f"best ln L {leader.max_log_likelihood:.2f} and {rival.max_log_likelihood:.2f}"


def _level(leader: HypothesisFit, rivals: tuple[HypothesisFit, ...]) -> list[str]:
    """Hypotheses that the evidence does not separate from the leader."""
    level = [rival for rival in rivals if _factor(leader, rival) <= STRONG]
    if not level:
        return []
    names = ", ".join(fit.name for fit in (leader, *level))
    sentences = [f"The data cannot separate {names} by evidence (Bayes factors below 20)."]
    for rival in level:
        gain = _gain(leader, rival)
        if abs(gain) > STRONG:
            better, worse = (leader, rival) if gain > 0 else (rival, leader)
            sentences.append(
                f"At its best {better.name} fits better than {worse.name} ({_best(better, worse)})."
            )
    return sentences


def _against(leader: HypothesisFit, rival: HypothesisFit) -> str:
    """The leader against a rival of far smaller evidence."""
    value, error = _factor(leader, rival), _factor_error(leader, rival)
    factor = bayes_factor(value)
    told = f"ln Bayes factor {value:.2f} ± {error:.2f} numerical; {_best(leader, rival)}"
    gain = _gain(leader, rival)
    contradicted = rival.contradicted and not leader.contradicted
    if gain > STRONG or contradicted:
        return (
            f"The data support {leader.name} over {rival.name} "
            f"by a Bayes factor of {factor} ({told})."
        )
    of_prior = value - gain
    if of_prior <= min(gain, STRONG):
        return (
            f"The data prefer {leader.name} to {rival.name} by a Bayes factor of {factor} "
            f"({told}): {bayes_factor(gain)} by the best fit, and {bayes_factor(of_prior)} as "
            f"{rival.name} fits over a smaller share of the prior's box, which another box would "
            "change."
        )
    fit = "fit {} and {} equally well" if gain >= -STRONG else "fit {1} better than {0}"
    return (
        f"The data {fit.format(leader.name, rival.name)} ({told}); the evidence "
        f"prefers {leader.name} by a Bayes factor of {factor} only through the prior: "
        f"{rival.name} fits over a smaller share of the prior's box, and another box "
        "would give another factor."
    )
