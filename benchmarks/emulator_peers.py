"""Other emulators on the same runs: scikit-learn PCA with Gaussian processes, and surmise."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from surrogate import TrainingSet
from surrogate.gp import Array


class Predicted(NamedTuple):
    """Predictions of a peer at held-out points."""

    force: Array
    """(m, n_step) N"""
    field: Array
    """(m, n_obs) mm"""


@dataclass(frozen=True)
class PeerFigures:
    """Errors of a peer trained on the same runs."""

    field_rmse_mm: float
    force_max_percent: float
    train_seconds: float


def peer_figures(training: TrainingSet, held_out: TrainingSet) -> dict[str, PeerFigures]:
    """Errors of every peer that is installed."""
    peers: dict[str, Callable[[Array, Array, Array], Array]] = {"sklearn_pca_gp": pca_gp}
    if find_spec("surmise") is not None:
        peers["surmise_pcgp"] = surmise_pcgp
    else:
        print("surmise is not installed: not compared (pip install surmise)")
    return {name: _figures(peer, training, held_out) for name, peer in peers.items()}


def pca_gp(x: Array, y: Array, new: Array) -> Array:
    """As MatCal's field surrogates: scaled, PCA to 99.99 %, a scikit-learn process per mode.

    Inputs to the unit box, a constant times a squared exponential with a length for
    each input, three restarts.
    """
    from sklearn.decomposition import PCA
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel
    from sklearn.preprocessing import MinMaxScaler, StandardScaler

    inputs, outputs = MinMaxScaler(), StandardScaler()
    unit = inputs.fit_transform(x)
    pca = PCA(n_components=0.9999, svd_solver="full")
    weights = pca.fit_transform(outputs.fit_transform(y))
    scale = weights.std(axis=0)
    columns = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        for target in (weights / scale).T:
            kernel = ConstantKernel(1.0) * RBF(np.ones(x.shape[1]), (1e-2, 1e2))
            process = GaussianProcessRegressor(
                kernel, n_restarts_optimizer=3, random_state=0, alpha=1e-10
            ).fit(unit, target)
            columns.append(process.predict(inputs.transform(new)))
    found: Array = outputs.inverse_transform(pca.inverse_transform(np.array(columns).T * scale))
    return found


def surmise_pcgp(x: Array, y: Array, new: Array) -> Array:
    """Surmise's principal-component Gaussian process, as many components as change anything.

    Its own limit on the components, 0.1, would leave it with two or three of the field.
    """
    from surmise import set_RNG
    from surmise.emulation import emulator

    set_RNG(np.random.default_rng(0))
    place = np.arange(y.shape[1], dtype=np.float64)[:, None]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fitted = emulator(
            x=place, theta=x, f=np.ascontiguousarray(y.T), method="PCGP", args={"epsilon": 1e-4}
        )
        found: Array = fitted.predict(x=place, theta=new).mean().T
    return found


def _figures(
    peer: Callable[[Array, Array, Array], Array], training: TrainingSet, held_out: TrainingSet
) -> PeerFigures:
    assert training.displacement is not None and held_out.displacement is not None
    x, new = training.ratios, held_out.ratios
    start = time.process_time()
    force = peer(x, training.force, new)
    field = peer(x, training.displacement.reshape(len(x), -1), new)
    seconds = time.process_time() - start
    error = field - held_out.displacement.reshape(len(new), -1)
    return PeerFigures(
        field_rmse_mm=float(np.sqrt(np.mean(error**2))),
        force_max_percent=float(100.0 * np.abs(force / held_out.force - 1.0).max()),
        train_seconds=seconds,
    )
