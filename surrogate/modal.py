"""Emulator of an array over a few inputs: POD of the outputs, a Gaussian process for each mode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from surrogate.coordinates import Chosen, choose_coordinates
from surrogate.covariance import FAMILIES
from surrogate.gp import Array, GaussianProcesses, to_arrays
from surrogate.gp_fit import Sharing, fit_processes
from surrogate.pod import Pod, fit_pod
from surrogate.step_scale import step_scale

N_LEADING = 6
"""modes that choose the coordinates: the others may be little more than noise"""


@dataclass(frozen=True)
class ModalEmulator:
    """y(x) = offset + modes @ w(x) + truncation, with independent processes w."""

    pod: Pod
    processes: GaussianProcesses

    def __post_init__(self) -> None:
        if self.pod.modes.shape[1] != len(self.processes.offset):
            raise ValueError(
                f"processes: expected one for each of {self.pod.modes.shape[1]} modes, "
                f"got {len(self.processes.offset)}"
            )

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean (m, n_obs) and covariance (m, n_obs, n_obs) at x (m, d): for a small n_obs."""
        mean, variance = self.processes.predict(x)
        return self.pod.reconstruct(mean), self._covariance(variance)

    def gradient(self, x: Array) -> Array:
        """(m, n_obs, d) derivative of the mean."""
        gradient: Array = self.pod.modes @ self.processes.gradient(x)
        return gradient

    def leave_one_out(self) -> tuple[Array, Array]:
        """Mean (n, n_obs) and covariance (n, n_obs, n_obs) of each run given the others."""
        mean, variance = self.processes.leave_one_out()
        return self.pod.reconstruct(mean), self._covariance(variance)

    def _covariance(self, variance: Array) -> Array:
        n_obs = len(self.pod.offset)
        products, truncation = self._covariance_parts
        covariance: Array = variance @ products + truncation
        return covariance.reshape(len(variance), n_obs, n_obs)

    @cached_property
    def _covariance_parts(self) -> tuple[Array, Array]:
        """(k, n_obs^2) product of each mode with itself, (n_obs^2,) truncation covariance."""
        modes, factor = self.pod.modes, self.pod.truncation_factor
        products = np.einsum("ik,jk->kij", modes, modes).reshape(modes.shape[1], -1)
        return products, (factor @ factor.T).ravel()


def fit_modal(
    x: Array,
    y: Array,
    seed: int,
    *,
    slopes: Array | None = None,
    tolerance: float = 0.0,
    max_modes: int = 12,
    n_restarts: int = 1,
    sharing: Sharing = "auto",
    chosen: Chosen | None = None,
    n_step: int = 1,
) -> ModalEmulator:
    """Fit to y (n, n_obs) over x (n, d) and its derivatives `slopes` (n, n_obs, d), if any.

    Coordinates and, with derivatives, the covariance are those in which the leading modes of a run
    left out are most probable, unless they are `chosen` already. Outputs are those of `n_step`
    load steps, one after the other, each measured by how well it can be foretold (see
    `surrogate.step_scale`). See `fit_pod` and `fit_processes` for the other arguments.
    """
    if chosen is None:
        chosen = _chosen(x, y, slopes, n_step)
    by_step = None if slopes is None else slopes.reshape(len(x), n_step, -1, x.shape[1])
    scale = step_scale(x, y.reshape(len(x), n_step, -1), by_step, chosen)
    pod = fit_pod(
        y,
        tolerance=tolerance,
        max_modes=max_modes,
        weight=inner_weight(x),
        scale=np.repeat(scale, y.shape[1] // n_step),
    )
    weights = pod.weights(y)
    by_input = None if slopes is None else np.matmul(pod.dual.T, slopes)
    processes = fit_processes(
        x,
        weights,
        seed,
        slopes=by_input,
        strength=chosen.strength,
        n_restarts=n_restarts,
        sharing=sharing,
        families=FAMILIES if by_input is None else (chosen.family,),
    )
    return ModalEmulator(pod, processes)


def _chosen(x: Array, y: Array, slopes: Array | None, n_step: int) -> Chosen:
    """Choice for the leading modes of all steps, each divided by its variation."""
    deviation = (y - y.mean(axis=0)).reshape(len(x), n_step, -1)
    spread = np.sqrt(np.mean(deviation**2, axis=(0, 2)))
    scale = np.repeat(np.where(spread > 0.0, spread, 1.0), y.shape[1] // n_step)
    pod = fit_pod(y, tolerance=0.0, max_modes=N_LEADING, scale=scale)
    by_input = None if slopes is None else np.matmul(pod.dual.T, slopes)
    return choose_coordinates(x, pod.weights(y), by_input)


def inner_weight(x: Array) -> Array:
    """(n,) 1 for runs inside the box of all, 0 for its corners; all 1 where few are inside.

    Modes fitted without a corner are asked to extrapolate to it. A prediction never asks that of
    them, as the corner is among the runs: it would take the truncation several times too large.
    """
    inside = ((x > x.min(axis=0)) & (x < x.max(axis=0))).any(axis=1)
    if np.count_nonzero(inside) < len(x) / 2:
        return np.ones(len(x))
    weight: Array = inside.astype(np.float64)
    return weight


def modal_to_arrays(modal: ModalEmulator, prefix: str) -> dict[str, Array]:
    """All arrays under names with a prefix; `modal_from_arrays` is the inverse."""
    pod = {
        "pod_offset": modal.pod.offset,
        "pod_modes": modal.pod.modes,
        "pod_scale": modal.pod.scale,
        "pod_truncation": modal.pod.truncation,
        "pod_weight": modal.pod.weight,
    }
    return {f"{prefix}{name}": value for name, value in (pod | to_arrays(modal.processes)).items()}


def modal_from_arrays(arrays: Mapping[str, Array], prefix: str) -> ModalEmulator:
    """Inverse of `modal_to_arrays`; raises KeyError or ValueError when arrays do not fit."""
    own = {
        name.removeprefix(prefix): value
        for name, value in arrays.items()
        if name.startswith(prefix)
    }
    pod = Pod(
        own.pop("pod_offset"),
        own.pop("pod_modes"),
        own.pop("pod_scale"),
        own.pop("pod_truncation"),
        own.pop("pod_weight"),
    )
    try:
        return ModalEmulator(pod, GaussianProcesses(**own))
    except TypeError as error:  # an array too few or too many
        raise ValueError(str(error)) from error
