"""The ensemble sampler of a density of few coordinates, by emcee."""

from __future__ import annotations

from collections.abc import Callable

import emcee

from fe.response import Array


def ensemble_sampler(
    n_walkers: int, d: int, log_prob: Callable[[Array], Array]
) -> emcee.EnsembleSampler:
    """Sampler of `n_walkers` walkers; `log_prob` takes x (m, d) to ln densities (m,).

    Differential evolution crosses narrow ridges (kappa against r, s) faster than the stretch move,
    which changes scale along bounds. emcee's snooker move is left out: its acceptance takes half
    the power of the distance ratio that detailed balance needs (ter Braak & Vrugt 2008: d - 1) and
    biases the spread (docs/inference.md; emcee 3.1.6).
    """
    moves = [(emcee.moves.DEMove(), 0.7), (emcee.moves.StretchMove(), 0.3)]
    sampler = emcee.EnsembleSampler(n_walkers, d, log_prob, moves=moves, vectorize=True)
    sampler.log_prob_fn = log_prob  # its wrapper prints a traceback at a Ctrl-C
    return sampler
