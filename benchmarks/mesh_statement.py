"""Whether the stated error of a mesh covers what a finer mesh would make of the constants.

Without noise of their own: forces and field of a finer mesh's run are fitted by the emulator's
tangents, weighed by all errors that a likelihood states, and what they are off by is held against
the SDs that go with it. A linear look at what ranks of whole posteriors take hours for.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibration_experiments import KAPPA
from benchmarks.calibration_finer import finer_case, with_mesh_error
from benchmarks.mesh_cases import MESH_CASES, PIN_SHARE
from benchmarks.mesh_fit import Fitted, Linear, told
from benchmarks.mesh_order import order_of
from calib.inference import Likelihood
from calib.study.mesh_error import ALL
from fe.response import Array

MIDDLE = float(np.sqrt(np.prod(KAPPA)))
"""MPa"""


def figures(store: Path, name: str, n: int) -> dict[str, Any]:
    """For a mesh and its finer truths, of `MESH_CASES`: errors of the constants in their SDs.

    Under what studies state, and under the part of it that these truths show; of as many truths as
    n experiments have. And at which order the field's error falls.
    """
    case = MESH_CASES[name].of(n)
    known, truths, _ = finer_case(store, case)
    ratios = truths.theta[:, :2]
    found = {}
    for stated, share, pin_share in (
        ("stated", ALL, 1.0),
        ("to_truth", case.truth_share, PIN_SHARE),
    ):
        likelihoods = with_mesh_error(
            store, case, known, ratios[:, None], share=share, pin_share=pin_share
        )
        each = zip(likelihoods, ratios, truths.force, truths.displacement, strict=True)
        found[stated] = told([fitted(*one) for one in each])
        print(f"{case} {stated}: {found[stated]}", flush=True)
    key = name.replace("-", "_")
    return {f"mesh_statement_{key}": found, f"mesh_order_{key}": order_of(store, case, truths)}


def fitted(likelihood: Likelihood, ratios: Array, force: Array, field: Array) -> Fitted:
    """Fit forces at kappa = 1 MPa (n_step,) and a field, both without noise, at ratios (2,)."""
    errors, own = likelihood.errors, likelihood.field
    basis = likelihood.forward.field_basis
    assert own is not None and basis is not None and basis.modes is not None
    theta = np.array([[MIDDLE, *ratios]])
    stated, slope = likelihood.forward.predict(theta), likelihood.forward.jacobian(theta)
    assert stated.weights is not None and stated.weight_variance is not None
    assert slope.weights is not None
    predicted, column = basis.fields(stated.weights)[0], np.ascontiguousarray(stated.force.T)
    by_ratio = np.tensordot(slope.weights[0][:, 1:].T, basis.modes, axes=1)
    modes = np.sqrt(stated.weight_variance[0])[:, None, None, None] * basis.modes
    linear = Linear(
        force=np.column_stack([slope.force[0], errors.slope @ column]),
        field=np.concatenate([by_ratio, np.tensordot(errors.slope, predicted, axes=1)[None]]),
        zero_sd=errors.travel_zero_sd,
    )
    return linear.fit(
        MIDDLE * force - stated.force[0],
        errors.covariance(column, stated.force_covariance)[:, :, 0],
        field - predicted,
        own.total.with_patterns(modes),
    )
