"""Truths of virtual laboratories that no FE run has to be waited for."""

from __future__ import annotations

import numpy as np

from calib.virtual import BlockTruth, TruthResponse
from calib.virtual.front_response import FrontResponse
from calib.virtual.truth import ShiftedFields

TRAVEL = np.arange(1, 20) * 0.1


def field_of(x: np.ndarray, y: np.ndarray, travel: float, shift: float = 0.0) -> np.ndarray:
    """(..., 3) smooth displacement of a face 2.5 high below a pin at `shift`, mm."""
    sideways, height = x - shift, y / 2.5
    bulge = np.exp(-((sideways / 2.2) ** 2))
    return travel * np.stack(
        [
            0.5 * np.tanh(sideways / 1.5) * height * (1.2 - height),
            -0.9 * bulge * height,
            0.8 * bulge * height * (1.3 - height),
        ],
        axis=-1,
    )


def front(shift: float = 0.0, n: int = 33) -> FrontResponse:
    """An analytic response in place of that of a quarter (or half, if shifted) model."""
    x = np.linspace(0.0 if shift == 0.0 else -5.0, 5.0, n if shift == 0.0 else 2 * n - 1)
    y = np.linspace(0.0, 2.5, 17)
    field = np.stack([field_of(x[:, None], y[None, :], travel, shift) for travel in TRAVEL])
    return FrontResponse(x, y, TRAVEL, 100.0 * TRAVEL**2, field)


def analytic_truth() -> TruthResponse:
    """A truth whose field goes with the pin."""
    return TruthResponse(BlockTruth(), front())


def shifted_truth() -> TruthResponse:
    """The same, whose coarser models say so too."""
    return TruthResponse(BlockTruth(), front(), ShiftedFields(front(), front(0.4), 0.4))
