"""Whether the stated error of a mesh covers what a finer mesh would make of r and s.

Without noise of its own: the field of a finer mesh's run is fitted by the emulator's tangent in r
and s, weighed by all errors that a likelihood states, and what it is off by is held against the SDs
that go with it. A linear look at what ranks of whole posteriors take hours for.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_figures import finer_case, with_mesh_error
from calib.inference import Likelihood
from calib.inference.tangent_errors import tangents_at
from fe.response import Array

WITHIN = 1.96


@dataclass(frozen=True)
class Fitted:
    """What the field of one truth says of (r, s)."""

    off: Array
    """(2,) distance from the truth"""
    sd: Array
    """(2,) as it is stated"""
    misfit: float
    """mean square of the field's error in units of what is stated of it"""


def figures(store: Path, name: str) -> dict[str, Any]:
    """For a mesh and its finer truths, of `MESH_CASES`: errors of r and s in their SDs."""
    case = runs.MESH_CASES[name]
    known, truths, _ = finer_case(store, case)
    ratios = truths.theta[:, :2]
    likelihoods = with_mesh_error(store, case, known, ratios[:, None])
    found = [fitted(*each) for each in zip(likelihoods, ratios, truths.displacement, strict=True)]
    z = np.array([one.off / one.sd for one in found])
    told = {
        "n_truths": len(found),
        "z_rms": np.sqrt(np.mean(z**2, axis=0)).tolist(),
        "within_1.96": np.mean(np.abs(z) < WITHIN, axis=0).tolist(),
        "mean_off": np.mean([one.off for one in found], axis=0).tolist(),
        "mean_sd": np.mean([one.sd for one in found], axis=0).tolist(),
        "mean_misfit": float(np.mean([one.misfit for one in found])),
    }
    return {f"mesh_statement_{name.replace('-', '_')}": told}


def fitted(likelihood: Likelihood, ratios: Array, truth: Array) -> Fitted:
    """Fit a field without noise (n_step, n_point, 3) about the prediction at ratios (2,)."""
    theta = np.concatenate([[1.0], ratios])[None]
    field, basis = likelihood.field, likelihood.forward.field_basis
    stated = likelihood.forward.predict(theta)
    assert field is not None and basis is not None and basis.modes is not None
    assert stated.weights is not None and stated.weight_variance is not None
    own = np.sqrt(stated.weight_variance[0])[:, None, None, None] * basis.modes
    by_ratio = tangents_at(likelihood.forward, theta[0])
    error = truth - basis.fields(stated.weights)[0]
    vectors = np.concatenate([by_ratio, error[None]])
    gram = field.total.with_patterns(own).inner(vectors, vectors)
    covariance = np.linalg.inv(gram[:2, :2])
    return Fitted(covariance @ gram[:2, 2], np.sqrt(np.diag(covariance)), gram[2, 2] / error.size)
