"""The force of a rubber that relaxes: linear viscoelasticity over the force at rest."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from calib.virtual.laboratory_settings import Rubber
from fe.response import Array


def relaxing_force(at_rest: Array, step_s: float, rubber: Rubber) -> Array:
    """Force over even times `step_s` apart, N, from that at rest (n,), N.

    F = Fe + sum_i g_i h_i with h_i' = Fe' - h_i / tau_i: each change of the force at rest comes
    with an excess g_i that dies out over tau_i (quasi-linear viscoelasticity; Fung,
    Biomechanics, 1993, section 7.6). Exact for forces that change evenly between the times.
    """
    force = at_rest.copy()
    change = np.diff(at_rest, prepend=at_rest[0])
    for share, tau in zip(rubber.relaxing_shares, rubber.relaxing_s, strict=True):
        decay = np.exp(-step_s / tau)
        gain = tau / step_s * (1.0 - decay)
        force += share * lfilter([gain], [1.0, -decay], change)
    return force
