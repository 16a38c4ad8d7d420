"""The thesis' method on synthetic fields, at prescribed travels and at prescribed forces.

At prescribed travels the field cannot see kappa.  Table 4.2 of the thesis names its control
"Force", and section 5.6 compares at forces: with forces prescribed the field does see kappa, and a
whole sample's force on a quarter model makes the answer four times too stiff.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from benchmarks.thesis_claims import MAXIMUM_SD, published_theta
from benchmarks.thesis_hypotheses import TRAVEL, TrainedReading
from calib.data import thesis_forces
from calib.data.thesis.forces import SCALE
from calib.inference.baseline import THESIS_STEPS, thesis_baseline, thesis_starts
from calib.inference.coordinates import theta_of_constants
from calib.inference.forward import EmulatorForward
from calib.optimize import Problem, Settings, multistart
from calib.optimize.minimum import THESIS
from fe.response import Array
from surrogate import ScaledEmulator

NOISE_SD = np.array([0.01, 0.01, 0.02])
"""of x, y, z at every point, mm"""
FARTHEST = 2.2
"""travel to which forces and fields are continued beyond 1.4 mm, as powers of the travel"""


@dataclass(frozen=True)
class FieldAtForces:
    """Mean field error of Eq. 2.8 at prescribed forces, of scaled constants."""

    trained: TrainedReading
    observed: Array
    """(n_step, n_point, 3) mm"""
    applied: Array
    """(n_step,) force on the whole model, N"""

    def __call__(self, scaled: Array) -> float:
        """Mean error, mm; NaN where the force asks for more travel than `FARTHEST`."""
        constants = scaled * SCALE
        if not constants[0] + constants[1] > 0:
            return float("nan")
        theta = theta_of_constants(*constants)
        if not 0 <= theta[2] <= 0.5:
            return float("nan")
        travel = self.travel(theta)
        if travel is None:
            return float("nan")
        error = self.field(theta, travel) - self.observed
        return float(np.linalg.norm(error, axis=-1).mean())

    def travel(self, theta: Array) -> Array | None:
        """(n_step,) travel at which the model carries the applied forces, by powers between."""
        force = theta[0] * self.trained.emulator.unit_force(theta[None, 1:])[0][0]
        log_travel, log_force = np.log(TRAVEL), np.log(force)
        wanted = np.log(self.applied)
        found = np.interp(wanted, log_force, log_travel)
        first = np.diff(log_travel)[0] / np.diff(log_force)[0]
        last = np.diff(log_travel)[-1] / np.diff(log_force)[-1]
        found = np.where(
            wanted < log_force[0], log_travel[0] + first * (wanted - log_force[0]), found
        )
        found = np.where(
            wanted > log_force[-1], log_travel[-1] + last * (wanted - log_force[-1]), found
        )
        travel: Array = np.exp(found)
        return travel if travel.max() <= FARTHEST else None

    def field(self, theta: Array, travel: Array) -> Array:
        """(n_step, n_point, 3) mm, linear in the travel between increments and beyond."""
        known = self.trained.emulator.displacement(theta[None, 1:])[0]
        known = np.concatenate([np.zeros_like(known[:1]), known])
        at = np.concatenate([[0.0], TRAVEL])
        index = np.clip(np.searchsorted(at, travel) - 1, 0, len(at) - 2)
        share = ((travel - at[index]) / (at[index + 1] - at[index]))[:, None, None]
        moved: Array = (1.0 - share) * known[index] + share * known[index + 1]
        return moved


def synthetic(trained: TrainedReading, truth: Array, seed: int) -> Array:
    """(n_step, n_point, 3) field at the travels of the truth (3,) [MPa], with noise, mm."""
    theta = theta_of_constants(*truth)
    clean = trained.emulator.displacement(theta[None, 1:])[0]
    noise = np.random.default_rng(seed).standard_normal(clean.shape) * NOISE_SD
    noisy: Array = clean + noise
    return noisy


def both_controls(
    trained: TrainedReading, truth: Array, forces: Array, seed: int = 1
) -> dict[str, Any]:
    """Nine starts of Table 5.3 under both controls; `forces` (n_step,) N on the whole model."""
    observed = synthetic(trained, truth, seed)
    forward = EmulatorForward(ScaledEmulator(trained.emulator), with_field=True)
    by_travel = thesis_baseline(forward, observed)
    objective = FieldAtForces(trained, observed, forces)
    problem = Problem(objective, np.zeros(3), np.full(3, np.inf), steps=THESIS_STEPS)
    starts = list(thesis_starts())
    by_force = multistart(problem, starts, THESIS)
    longer = multistart(problem, starts, Settings(max_iterations=60, kkt_tolerance=1e-9))
    return {
        "synthetic_truth_MPa": truth,
        "kappa_truth_MPa": float(truth[:2].sum()),
        "applied_force_N": forces,
        "travel_control": {
            "result_MPa": by_travel.result,
            "error_mm": by_travel.error,
            "end": [found.status.name for found in by_travel.minima],
        },
        "force_control": _told(by_force),
        "force_control_60_iterations": _told(longer),
    }


def published_at_forces(
    trained: TrainedReading, target: dict[str, float], ratios: Array
) -> dict[str, Any]:
    """The published constants at the measured forces, put on the whole model and on a quarter.

    How far the model is then pressed, its largest displacements at the last force, what `target`
    {x, z} mm says of them with the relative SD of a maximum, and the mean error (Eq. 2.8) to a
    sample of this reading with `ratios` (2,) at the travels measured.
    """
    found: dict[str, Any] = {}
    sample = trained.emulator.displacement(ratios[None])[0]
    theta = published_theta()
    for name, share in (("whole", 1.0), ("quarter", 4.0)):
        applied = share * thesis_forces().force_mean
        objective = FieldAtForces(trained, np.zeros(0), applied)
        travel = objective.travel(theta)
        if travel is None:
            found[name] = None
            continue
        field = objective.field(theta, travel)
        x, y, z = np.moveaxis(field[-1], -1, 0)
        maxima = {"x": np.abs(x).max(), "z": z.max(), "up": y.max(), "vertical": np.abs(y).max()}
        misfit = sum((np.log(target[axis] / maxima[axis]) / MAXIMUM_SD) ** 2 for axis in target)
        found[name] = {
            "travel_mm": travel,
            "maxima_mm": maxima,
            "p_of_maxima": float(chi2.sf(misfit, len(target))),
            "mean_error_to_sample_mm": float(np.linalg.norm(field - sample, axis=-1).mean()),
        }
    return found


def _told(minima: Any) -> dict[str, Any]:
    return {
        "result_MPa": np.array([found.x for found in minima]) * SCALE,
        "error_mm": [found.value if np.isfinite(found.value) else None for found in minima],
        "end": [found.status.name for found in minima],
    }
