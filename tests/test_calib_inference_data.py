"""The saved posterior holds what was sampled, with units, and judges its own convergence."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from pathlib import Path

import arviz as az
import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward

from calib.data import thesis_forces
from calib.inference import (
    Marginal,
    NoiseSettings,
    Posterior,
    Prior,
    SamplerSettings,
    SamplingResult,
    SamplingStatus,
    build_likelihood,
    sample_posterior,
)
from calib.inference.convergence import convergence
from calib.inference.inference_data import (
    HypothesisSamples,
    build_inference_data,
    load_inference_data,
    provenance_of,
    save_inference_data,
)
from fe.response import Array

PRIOR = Prior(
    Marginal("log_uniform", 0.003, 0.3), Marginal("uniform", 0, 1), Marginal("uniform", 0, 0.5)
)
LIKELIHOOD = build_likelihood(
    thesis_forces(),
    AnalyticForward(AnalyticBlock(), 0.005),
    NoiseSettings(),
    force_discretisation=0.02,
)
PROVENANCE = {"study": "test", "seed": 1, "version": "0", "maps": {"stuck": [1.0, 2.0]}}


@cache
def data() -> az.InferenceData:
    """Two hypotheses, sampled briefly: nothing here needs chains that have settled."""
    settings = SamplerSettings(n_ensembles=3, n_walkers=16, max_steps=100, check_every=50)
    posterior = Posterior(PRIOR, LIKELIHOOD)
    runs = {
        name: HypothesisSamples(
            LIKELIHOOD, sample_posterior(posterior, settings, np.random.default_rng(seed))
        )
        for seed, name in enumerate(("stuck", "sliding"))
    }
    return build_inference_data(runs, thesis_forces(), PROVENANCE, np.random.default_rng(0))


def artificial(chains: Array) -> az.InferenceData:
    result = SamplingResult(
        chains=chains,
        log_prob=np.zeros(chains.shape[:3]),
        autocorrelation_time=np.ones((len(chains), 3)),
        acceptance=np.ones(len(chains)),
        n_burn=0,
        status=SamplingStatus.CONVERGED,
        message="artificial",
    )
    runs = {"only": HypothesisSamples(LIKELIHOOD, result)}
    return build_inference_data(runs, thesis_forces(), {}, np.random.default_rng(0))


def independent(seed: int, shape: tuple[int, ...] = (4, 300, 8)) -> Array:
    x = np.random.default_rng(seed).standard_normal((*shape, 3))
    return x * np.array([0.05, 0.02, 0.01]) + np.array([-3.6, 0.4, 0.2])


@pytest.mark.lasting
def test_constants_are_those_of_the_ratios_and_carry_their_unit() -> None:
    posterior = data()["posterior"]
    kappa, r = posterior["kappa"], posterior["r"]
    assert np.allclose(posterior["C10"] + posterior["C01"], kappa)
    assert np.allclose(posterior["C01"], r * kappa)
    assert np.allclose(posterior["C11"], posterior["s"] * kappa)
    assert np.allclose(posterior["mu"], 2 * kappa)
    assert posterior["mu"].attrs["units"] == "MPa"
    assert posterior["C10"].dims == ("hypothesis", "chain", "draw")
    assert posterior["ensemble"].values.tolist() == np.repeat([0, 1, 2], 16).tolist()


def test_saved_file_comes_back_the_same_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "posterior.nc"
    save_inference_data(data(), path)
    back = load_inference_data(path)
    assert [p.name for p in tmp_path.iterdir()] == ["posterior.nc"]
    for group in ("posterior", "posterior_predictive", "log_likelihood", "observed_data"):
        assert back[group].identical(data()[group]) or back[group].equals(data()[group])
    assert back["posterior"]["C10"].attrs["units"] == "MPa"
    assert back["posterior_predictive"]["force"].attrs["units"] == "N"
    assert provenance_of(back) == PROVENANCE
    save_inference_data(back, path)  # a loaded file is not held open


def test_damaged_file_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "posterior.nc"
    save_inference_data(data(), path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ValueError, match=r"posterior\.nc"):
        load_inference_data(path)
    with pytest.raises(ValueError, match=r"absent\.nc"):
        load_inference_data(tmp_path / "absent.nc")


@pytest.mark.parametrize("provenance", ["[1]", "{", "", "3", 3])
def test_a_provenance_that_is_no_table_is_refused_by_the_files_name(
    tmp_path: Path, provenance: object
) -> None:
    path = tmp_path / "posterior.nc"
    damaged = data().copy()
    damaged.attrs["provenance"] = provenance
    save_inference_data(damaged, path)
    with pytest.raises(ValueError, match=r"posterior\.nc: its provenance is"):
        load_inference_data(path)


def test_leave_one_out_scores_come_from_the_stored_likelihood() -> None:
    stuck = data().sel(hypothesis="stuck")
    score = az.loo(stuck, pointwise=True)
    assert np.isfinite(score.elpd_loo)
    assert score.n_data_points == 5


def test_independent_draws_pass() -> None:
    found = convergence(artificial(independent(0)), "only")["kappa"]
    assert found.r_hat < 1.005
    assert found.ess_bulk > 0.7 * 4 * 300 * 8
    assert found.ess_tail > 0.5 * 4 * 300 * 8


def test_r_hat_sees_one_ensemble_that_went_elsewhere() -> None:
    chains = independent(1)
    chains[3, :, :, 1] += 0.02  # one SD of r
    found = convergence(artificial(chains), "only")
    assert found["r"].r_hat > 1.05


def test_slow_walkers_are_not_flattered_by_their_number() -> None:
    """An AR(1) chain of coefficient 0.9 has tau = 19; interleaved walkers would hide it."""
    noise = independent(2, (4, 2000, 8)) - np.array([-3.6, 0.4, 0.2])
    chains = np.empty_like(noise)
    chains[:, 0] = noise[:, 0]
    for step in range(1, noise.shape[1]):
        chains[:, step] = 0.9 * chains[:, step - 1] + np.sqrt(1 - 0.81) * noise[:, step]
    chains += np.array([-3.6, 0.4, 0.2])
    found = convergence(artificial(chains), "only")["r"]
    expected = chains[..., 0].size / 19
    assert 0.6 * expected < found.ess_bulk < 1.2 * expected


def test_hypotheses_with_different_ensembles_are_refused() -> None:
    results = []
    for shape in ((4, 50, 8), (3, 50, 8)):
        chains = independent(3, shape)
        results.append(
            SamplingResult(
                chains,
                np.zeros(shape),
                np.ones((shape[0], 3)),
                np.ones(shape[0]),
                0,
                SamplingStatus.CONVERGED,
                "",
            )
        )
    runs = {str(i): HypothesisSamples(LIKELIHOOD, result) for i, result in enumerate(results)}
    with pytest.raises(ValueError, match="must agree"):
        build_inference_data(runs, thesis_forces(), {}, np.random.default_rng(0))


FULL_DISK = """
import resource, sys
from pathlib import Path
import arviz as az, numpy as np, xarray as xr
from calib.inference.inference_data import save_inference_data
draws = xr.Dataset({"x": (("chain", "draw"), np.random.default_rng(1).random((2, 50_000)))})
data = az.InferenceData(attrs={"provenance": "{}"}, posterior=draws)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
import calib.cli
path, sys.argv = sys.argv[1], ["calib", "studies"]
calib.cli.studies_verb = lambda _: save_inference_data(data, Path(path))
sys.exit(calib.cli.main())
"""


def test_a_full_disk_is_told_and_leaves_the_posterior_before(tmp_path: Path) -> None:
    """In a process of its own, which HDF5 would crash as it ends."""
    path = tmp_path / "posterior.nc"
    path.write_bytes(b"before")
    ended = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(path)], capture_output=True, text=True, check=False
    )
    last = ended.stderr.splitlines()[-1]  # after what h5py could not raise
    assert last.startswith(f"calib: {path}: cannot be written, expected a disk with room")
    assert ended.returncode == 2
    assert path.read_bytes() == b"before"
    assert [each.name for each in tmp_path.iterdir()] == ["posterior.nc"]
