"""How fast the inference is: log-probabilities, samplers on one density, dataset to posterior.

    python benchmarks/inference.py [--json FILE] [--only rate samplers study] [--store DIR]
                                   [--study DIR]

`rate` and `samplers`: forces and a field of 840 points at 5 increments, with covariances, under the
sliding block's emulator of the study thesis-forces, whose FE runs are kept in --store (those of
`make verify-inference`; a minute or two if they are missing).  The sampler numpyro comes
with the extra `benchmark`.  Their times are of the processor, of one thread, since other work
on the machine would count otherwise.  `study`: the embedded study virtual under its true hypothesis
by the clock, in one process; what comes before is kept in --study (half an hour, the first
time).
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # read when numpy and MKL are loaded
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
if __name__ == "__main__" and not __package__:
    # as a script, this folder comes first on the path, and benchmarks/fe.py would hide `fe`
    sys.path[0] = str(Path(__file__).resolve().parents[1])

import argparse
import json
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_experiments import by_runs, likelihood_of, sbc_prior
from benchmarks.calibration_figures import emulator, points
from calib.inference import Posterior, SamplerSettings, sample_posterior
from calib.study import verification
from calib.study.artifacts import RECORD_FOLDER, read_json
from calib.study.config import Study, load_study
from calib.study.context import Context, block_pin_model
from calib.study.maxima_table import is_verified
from calib.study.stage_list import stages_of
from calib.study.stages import run_stages
from calib.study.summary import load_summary
from calib.study.training_runs import rows
from fe.executors import serial_map
from surrogate import ScaledEmulator

BATCH = 65_536
SETTINGS = SamplerSettings(n_ensembles=4, n_walkers=32)
ESS, R_HAT = 2000.0, 1.01
"""with the maximum by direct FE, what makes a posterior verified"""
STUDY = runs.ROOT / "runs" / "inference-study"


def experiment(store: Path, scaled: ScaledEmulator) -> Posterior:
    """One experiment of the calibration study: truth by FE on the sampling mesh, not trained on."""
    likelihood = likelihood_of(scaled, points())
    prior = sbc_prior()
    truth = rows(runs.truths(store), slice(-1, None))
    drawn = by_runs(likelihood, prior, truth, 1, runs.SEED + 7)
    assert likelihood.field is not None
    field = likelihood.field.of_fields(drawn.field)[0]
    return Posterior(prior, replace(likelihood, force=drawn.force[0], field=field))


def rate(store: Path) -> dict[str, Any]:
    """Log-probabilities a second over draws of the prior: median and best of nine batches."""
    posterior = experiment(store, emulator(store, "sliding", 20, True))
    x = posterior.prior.sample(np.random.default_rng(1), BATCH)
    posterior.log_prob(x[:2048])
    times = []
    for _ in range(9):
        start = time.process_time()
        posterior.log_prob(x)
        times.append(time.process_time() - start)
    field = posterior.likelihood.field
    assert field is not None
    return {
        "log_prob_per_second": BATCH / float(np.median(times)),
        "log_prob_per_second_best": BATCH / min(times),
        "log_prob_n_modes": len(field.projected.best),
        "log_prob_n_values": int(np.prod(field.observed.shape)),
    }


def samplers(store: Path) -> dict[str, Any]:
    """Effective draws a second of emcee, dynesty and NUTS, warm-up included, compilation not.

    emcee: kept draws over the longest autocorrelation time; dynesty: Kish's size of its weights;
    NUTS: the least bulk size of ArviZ.
    """
    posterior = experiment(store, emulator(store, "sliding", 20, True))
    found = {"emcee": _emcee(posterior)}
    found["dynesty"] = _dynesty(posterior)
    found["numpyro"] = _numpyro(posterior, store)
    mean, sd = np.array(found["emcee"]["mean"]), np.array(found["emcee"]["sd"])
    for figures in found.values():
        figures["mean_off_emcee_sd"] = ((np.array(figures["mean"]) - mean) / sd).tolist()
    return {
        "ess_per_second": {name: f["ess"] / f["seconds"] for name, f in found.items()},
        "samplers": found,
    }


def _emcee(posterior: Posterior) -> dict[str, Any]:
    start = time.process_time()
    result = sample_posterior(posterior, SETTINGS, np.random.default_rng(1))
    seconds = time.process_time() - start
    draws = result.draws
    return {
        "ess": result.chains[..., 0].size / float(result.autocorrelation_time.max()),
        "seconds": seconds,
        "mean": draws.mean(axis=0).tolist(),
        "sd": draws.std(axis=0).tolist(),
    }


def _dynesty(posterior: Posterior) -> dict[str, Any]:
    import dynesty

    prior = posterior.prior

    def log_likelihood(x: Any) -> float:
        # The prior is in the transform; where it is flat its density is a constant.
        return float((posterior.log_prob(x[None]) - prior.log_prob(x[None]))[0])

    start = time.process_time()
    sampler = dynesty.NestedSampler(
        log_likelihood,
        lambda u: prior.quantile(u[None])[0],
        3,
        nlive=300,
        rstate=np.random.default_rng(1),
    )
    sampler.run_nested(dlogz=0.1, print_progress=False)
    seconds = time.process_time() - start
    weights = sampler.results.importance_weights()
    x = sampler.results.samples
    mean = weights @ x
    return {
        "ess": float(1.0 / np.sum(weights**2)),
        "seconds": seconds,
        "mean": mean.tolist(),
        "sd": np.sqrt(weights @ (x - mean) ** 2).tolist(),
    }


def _numpyro(posterior: Posterior, store: Path) -> dict[str, Any]:
    import arviz as az
    import jax
    import jax.numpy as jnp
    from numpyro.infer import MCMC, NUTS

    from benchmarks.density_jax import check_same, log_density

    density = log_density(posterior, emulator(store, "sliding", 20, True))
    check_same(posterior, jax.vmap(density))
    low, high = posterior.prior.bounds.T

    def potential(y: Any) -> Any:
        unit = jax.nn.sigmoid(y)
        jacobian = jnp.sum(jnp.log(high - low) + jax.nn.log_sigmoid(y) + jax.nn.log_sigmoid(-y))
        return -density(low + (high - low) * unit) - jacobian

    def run(seed: int, n: int) -> Any:
        sampler = MCMC(
            NUTS(potential_fn=potential),
            num_warmup=300,
            num_samples=n,
            num_chains=2,
            chain_method="sequential",
            progress_bar=False,
        )
        starts = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, 3))
        sampler.run(jax.random.PRNGKey(seed), init_params=jnp.array(starts))
        return np.asarray(sampler.get_samples(group_by_chain=True)), sampler

    start = time.process_time()
    draws, sampler = run(1, 500)
    first = time.process_time() - start
    # The compiled functions are kept: a second run of the same sampler has none to compile.
    start = time.process_time()
    sampler.run(jax.random.PRNGKey(2), init_params=jnp.array(draws[:, -1]))
    draws = np.asarray(sampler.get_samples(group_by_chain=True))
    seconds = time.process_time() - start
    x = low + (high - low) / (1.0 + np.exp(-draws))
    effective = min(float(az.ess(x[:, :, i], method="bulk")) for i in range(3))
    flat = x.reshape(-1, 3)
    return {
        "ess": effective,
        "seconds": seconds,
        "seconds_with_compilation": first,
        "mean": flat.mean(axis=0).tolist(),
        "sd": flat.std(axis=0).tolist(),
    }


def fixed_hypothesis() -> Study:
    """The embedded study `virtual`, forces and field of 840 points, under its true hypothesis."""
    found = load_study("virtual")
    assert found.virtual is not None
    true = tuple(h for h in found.hypotheses if h.name == found.virtual.hypothesis)
    return replace(found, hypotheses=true)


def in_folder(out: Path) -> Context:
    """The study in a folder, one process; what it says goes to standard error."""

    def echo(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    return Context(fixed_hypothesis(), out, block_pin_model, serial_map, echo, show_progress=False)


def study(folder: Path) -> dict[str, Any]:
    """From dataset and trained emulator to a verified posterior, rounds of verification included.

    Dataset, FE runs and emulator are made first, not timed, and kept in `folder`. The time is that
    of the stages from `sample` to posterior.nc, as `calib run` runs them, in a copy in which no
    chain and no direct solve is left.
    """
    run_stages(in_folder(folder), until="check")
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "study"
        shutil.copytree(folder, out)
        for left in ("map", "chains"):
            shutil.rmtree(out / left, ignore_errors=True)
        for left in (verification.FILE, verification.MAP, *_later_records()):
            (out / left).unlink(missing_ok=True)
        context = in_folder(out)
        run_stages(context, until="check")
        wall, start = time.perf_counter(), time.process_time()
        run_stages(context, until="posterior")
        clock, seconds = time.perf_counter() - wall, time.process_time() - start
        [summary] = load_summary(out / "posterior.nc")
        [found] = read_json(out / verification.MAP).values()
        rounds = verification.load_rounds(out)
    solves = [next(iter(each.values()))["n_fe_solves"] for each in rounds]
    constants = (summary.constants | summary.further).values()
    ess, r_hat = min(c.ess_bulk for c in constants), max(c.r_hat for c in constants)
    return {
        "study_seconds": clock,
        "study_processor_seconds": seconds,
        "study_load_average": os.getloadavg()[0],
        "study_ess": ess,
        "study_r_hat": r_hat,
        "study_map_difference_sd": dict(zip(found["x"], found["difference_sd_x"], strict=True)),
        "study_rounds": [next(iter(each.values()))["difference_sd"] for each in rounds],
        "study_fe_solves": sum(solves) + found["n_fe_solves"],
        "study_verified": bool(ess > ESS and r_hat < R_HAT and is_verified(found)),
    }


def _later_records() -> list[str]:
    names = [stage.name for stage in stages_of(fixed_hypothesis())]
    return [f"{RECORD_FOLDER}/{name}.json" for name in names[names.index("sample") :]]


PARTS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "rate": rate,
    "samplers": samplers,
    "study": study,
}


def main(arguments: list[str] | None = None) -> None:
    """Measure the parts asked for."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.inference", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    parser.add_argument("--store", type=Path, default=runs.STORE, metavar="DIR")
    parser.add_argument("--study", type=Path, default=STUDY, metavar="DIR")
    options = parser.parse_args(arguments)
    figures: dict[str, Any] = {}
    for name in options.only:
        try:
            figures |= PARTS[name](options.study if name == "study" else options.store)
        except ModuleNotFoundError as error:
            parser.error(
                f"--only {name}: found no module {error.name}, expected the extra benchmark "
                "(pip install -e '.[benchmark]'); without it: --only rate study"
            )
        print(json.dumps(figures, indent=2), flush=True)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2) + "\n")
        print(f"written to {options.json}")


if __name__ == "__main__":
    main()
