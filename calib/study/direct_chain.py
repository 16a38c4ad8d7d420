"""`calib direct-chain`: a short chain of a study's posterior by the FE model itself.

Delayed acceptance about the emulator's posterior (`calib.inference.delayed_acceptance`). Every FE
solve and the chain after every step are kept: stopped, it goes on; asked for more steps, it is
extended.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from calib.inference.autocorrelation import integrated_time
from calib.inference.delayed_acceptance import DelayedChain, Densities, begin, extend
from calib.inference.forward import DirectForward
from calib.inference.forward_errors import DirectWithErrors
from calib.inference.posterior import Posterior
from calib.study.artifacts import (
    hash_of,
    hash_of_file,
    plain,
    read_json,
    read_npz,
    write_json,
    write_npz,
)
from calib.study.context import Context, stream
from calib.study.finished import chosen, finished
from calib.study.local_design import LOCAL, kept_box
from calib.study.mesh_error_file import load_mesh_error
from calib.study.posterior_setup import emulator_posterior
from calib.study.refine_outlook import refine_folder
from calib.study.sample_stage import load_samples, samples_path
from calib.study.sections import Hypothesis
from calib.study.simulate_stage import campaign_folder
from calib.study.simulations import StoredSimulate
from calib.study.tables import Table, number
from calib.study.train_stage import emulator_path
from calib.study.unknowns import parameters_of
from calib.study.verification import MAP, map_folder
from fe.response import Array

FOLDER = "direct_chain"
PARTS = ("x", "direct", "emulator", "moved", "accepted", "inner")
MADE_FROM = "made_from"
"""what a chain depends on, in the same file: another chain is never taken for it"""
Echo = Callable[[str], None]


def direct_chain(
    out: Path,
    hypothesis: str | None,
    n_steps: int,
    n_inner: int,
    echo: Echo,
    context: Context | None = None,
) -> tuple[Table, list[Path]]:
    """Make `n_steps` in all, each of `n_inner` by the emulator; returns what came out and files.

    `hypothesis` may be left out where there is one only. `context` stands in for that of the
    folder. Raises ValueError where the folder holds no finished study, the study has no such
    hypothesis, or direct FE found no maximum.
    """
    context = context or finished(out)
    under = chosen(context.study, hypothesis)
    posterior = emulator_posterior(context, under)
    samples = load_samples(out, under)
    found = read_json(out / MAP)[under.name]
    if found["fe_x"] is None:
        raise ValueError(f"{out}: {under.name}: found no maximum by direct FE, expected one")
    folder = out / FOLDER / under.name
    path = folder / "chain.npz"
    made_from = _made_from(out, under, n_inner)
    densities = Densities(_direct(context, under, posterior, folder).log_prob, posterior.log_prob)
    chain = _kept(path, made_from, n_steps)
    if chain is None:
        chain = begin(densities, np.asarray(found["fe_x"], dtype=float))

    def keep(each: DelayedChain) -> None:
        parts = {name: getattr(each, name) for name in PARTS}
        write_npz(path, parts | {MADE_FROM: np.array(made_from)})
        word = "accepted" if each.accepted[-1] else "rejected" if each.moved[-1] else "not moved"
        echo(f"  {under.name}: step {each.n_steps} of {n_steps}, {word}")

    covariance = np.atleast_2d(np.cov(samples.result.draws, rowvar=False))
    chain = extend(
        chain,
        densities,
        covariance,
        n_steps,
        seed=int(stream(context.study, f"direct chain {under.name}").integers(2**63)),
        n_inner=n_inner,
        on_step=keep,
    )
    facts = _facts(chain, samples.result.draws, posterior.prior.space.x_names, n_inner)
    write_json(folder / "direct_chain.json", facts)
    return _table(under.name, facts), [folder / "direct_chain.json", path]


def _direct(
    context: Context, hypothesis: Hypothesis, posterior: Posterior, folder: Path
) -> Posterior:
    """The same posterior by the FE model, with the errors that the emulator states."""
    out = context.out
    simulate = StoredSimulate(
        context.sampling_model(hypothesis),
        folder,
        (
            campaign_folder(out, hypothesis),
            refine_folder(out, hypothesis),
            map_folder(out, hypothesis.name),
        ),
        parameters_of(context.study, hypothesis),
    )
    direct = DirectForward(
        simulate,
        with_field=posterior.likelihood.field is not None,
        correction=load_mesh_error(out, hypothesis).correction,
    )
    return posterior.with_forward(DirectWithErrors(direct, posterior.likelihood.forward))


def _made_from(out: Path, hypothesis: Hypothesis, n_inner: int) -> str:
    """Hash of what a chain depends on; another one does not go on."""
    folder = out if kept_box(out, hypothesis) is None else out / LOCAL
    paths = (emulator_path(folder, hypothesis), samples_path(out, hypothesis.name), out / MAP)
    return hash_of([n_inner, *(hash_of_file(path) for path in paths)])


def _kept(path: Path, made_from: str, n_steps: int) -> DelayedChain | None:
    """The chain so far, cut to `n_steps`; None where there is none of these inputs."""
    if not path.is_file():
        return None
    parts = read_npz(path, PARTS)
    if MADE_FROM not in parts or str(parts[MADE_FROM]) != made_from:
        return None
    states = {name: parts[name][: n_steps + 1] for name in PARTS[:3]}
    steps = {name: parts[name][:n_steps] for name in PARTS[3:]}
    return DelayedChain(**states, **steps)


def _facts(
    chain: DelayedChain, draws: Array, names: tuple[str, ...], n_inner: int
) -> dict[str, Any]:
    """Rates, and the chain's moments beside those by the emulator, as JSON data."""
    x, mean, sd = chain.x[1:], draws.mean(axis=0), draws.std(axis=0)
    time = [integrated_time(column[:, None]) for column in x.T]
    own = x.std(axis=0)
    with np.errstate(invalid="ignore"):  # a chain that never moved: no error is known, a dash
        error = own / sd * np.sqrt(np.array(time) / max(1, len(x)))
    found: dict[str, Any] = plain(
        {
            "x": names,
            "n_steps": chain.n_steps,
            "n_inner": n_inner,
            "n_fe_solves": 1 + int(chain.moved.sum()),
            "emulator_acceptance": chain.first_rate,
            "direct_acceptance": chain.second_rate,
            "autocorrelation_time": time,
            "mean_off_emulator_sd": (x.mean(axis=0) - mean) / sd,
            "mean_error_sd": error,
            "sd_ratio": own / sd,
        }
    )
    return found


def _table(name: str, facts: dict[str, Any]) -> Table:
    rows = [
        (
            each,
            f"{off:+.3f} ± {'-' if error is None else number(error, 2)}",
            number(ratio, 3),
            number(time, 3),
        )
        for each, off, error, ratio, time in zip(
            facts["x"],
            facts["mean_off_emulator_sd"],
            facts["mean_error_sd"],
            facts["sd_ratio"],
            facts["autocorrelation_time"],
            strict=True,
        )
    ]
    return Table(
        f"Posterior under {name} by a chain of the FE model itself, against the emulator's",
        ("unknown", "mean off [SD]", "SD over emulator's", "autocorrelation [steps]"),
        tuple(rows),
        f"{facts['n_steps']} steps of {facts['n_inner']} by the emulator each; accepted by the "
        f"emulator {number(facts['emulator_acceptance'], 2)}, then by direct FE "
        f"{number(facts['direct_acceptance'], 2)}; {facts['n_fe_solves']} FE solves with the "
        "start's. ±: Monte Carlo SD by the autocorrelation time, rough in a short chain.",
    )
