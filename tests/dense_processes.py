"""Covariance matrices of fitted processes, as the formulas write them."""

from __future__ import annotations

import numpy as np

from surrogate.covariance import covariance
from surrogate.evidence import noise_shape
from surrogate.gp import GaussianProcesses


def dense_covariance(processes: GaussianProcesses, member: int) -> np.ndarray:
    """(n_rows, n_rows) covariance of the noisy training rows at unit amplitude."""
    group = int(processes.group[member])
    family, parameters = int(processes.family[group]), processes.hyperparameters(group)
    x, rows = processes.inputs, processes.rows
    noise = processes.nugget[member] * noise_shape(family, parameters, rows)
    return covariance(family, parameters.length, x, rows, x, rows) + np.diag(noise)
