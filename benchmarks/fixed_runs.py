"""How many runs a fixed design needs where a study that refines its emulator makes so many.

    python -m benchmarks.verify_inference --only fixed

The experiments of `calibration_direct`, forces and field: emulators of the first 32, 64 ... points
of one Sobol design over the whole prior, corners first, against the posterior by FE. The study's
own way is that of the part `direct`: its first design, one run at the mean, a second design in the
posterior's box, further runs.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_direct import by_study, rule_of
from benchmarks.calibration_experiments import sbc_prior
from benchmarks.calibration_figures import trained
from benchmarks.calibration_refined import experiment
from benchmarks.direct_case import CONTACT, DirectCase, cases
from benchmarks.direct_rule import Moments
from calib.inference import Posterior
from calib.inference.quadrature import integrate
from calib.study.training_runs import rows, training_set
from fe.campaign_result import Campaign
from surrogate import sobol_design

N_FIXED = (32, 64, 128, 256)
TOLERANCE = 0.05
"""of mean and SD, in SDs by FE, to be reached"""


def figures(store: Path) -> dict[str, Any]:
    """Each experiment by itself."""
    each = [
        runs.kept(store / f"fixed-{case.index}.json", partial(_figures, case))
        for case in cases(store, "direct")
    ]
    return {"fixed_design": each, "fixed_design_tolerance": TOLERANCE}


def _figures(case: DirectCase) -> dict[str, Any]:
    """Errors of both ways, and the runs of the study over those of the fixed design."""
    found = by_study(case, runs.study().design.n_local)
    rule = rule_of(case, found.posterior)
    by_fe = rule.moments(found.posterior.with_forward(rule.exact))
    design = _fixed(case.store)
    errors = {n: _error(_posterior(case, rows(design, slice(n))), by_fe) for n in N_FIXED}
    n_refined = len(case.first.theta) + len(found.loop.ratios)
    enough = next((n for n, error in errors.items() if error <= TOLERANCE), None)
    return {
        "ratios": case.truth.tolist(),
        "refined": {"n_runs": n_refined, "error_sd": _error(found.posterior, by_fe)},
        "fixed": {str(n): error for n, error in errors.items()},
        "run_ratio": n_refined / (enough or max(N_FIXED)),
        "run_ratio_is_a_bound": enough is None,
    }


def _fixed(store: Path) -> Campaign:
    """The largest design; its first points are the smaller ones."""
    points = sobol_design(max(N_FIXED), sbc_prior().bounds[1:], runs.SEED + 12)
    progress = runs.told("fixed design")
    return runs.solved(store, CONTACT, f"fixed-{CONTACT}", points, runs.COARSE_CELLS, progress)


def _posterior(case: DirectCase, used: Campaign) -> Posterior:
    known = trained(case.store, training_set([used], gradients=True))
    return experiment(known, case.drawn, 0)[1]


def _error(posterior: Posterior, by_fe: Moments) -> float:
    """Largest error of mean and SD of (ln kappa, r, s), in SDs by FE.

    The emulator's by its own quadrature, for its posterior may be wider than the nodes by FE.
    """
    own = integrate(posterior)
    off = np.maximum(np.abs(own.mean - by_fe.mean), np.abs(own.sd - by_fe.sd)) / by_fe.sd
    return float(off.max())
