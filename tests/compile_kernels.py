"""Compile kernels once, which processes of the tests would do side by side.

python tests/compile_kernels.py
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from scipy.ndimage import gaussian_filter

from calib.dic import CorrelationSettings, correlate
from fe import BlockPin, BlockPinModel, Contact, Cylinder, CylinderModel, NotchedPlate, TensileModel

RATIOS = np.array([0.5, 0.05])


def blocks() -> None:
    """Kernels of the solid and of its contact, with and without friction."""
    for contact in (Contact(), Contact(0.3, 0.2)):
        BlockPinModel(BlockPin(), contact, (2, 2, 1), (0.02,))(RATIOS)


def images() -> None:
    """Kernels that correlate two images."""
    image = gaussian_filter(np.random.default_rng(0).uniform(0.0, 1e4, (80, 80)), 2.0)
    for settings in (CorrelationSettings(), CorrelationSettings(light="constant", glare=0.0)):
        correlate(image, image, np.array([[40.0, 40.0]]), settings, guess=[[0.0, 0.0]])


def other_specimens() -> None:
    """What these have of their own; the rest is that of the blocks."""
    CylinderModel(Cylinder(), (2, 2), (0.1,), friction=0.3)(RATIOS)
    TensileModel(NotchedPlate(), (1, 2, 1), (0.1,))(RATIOS)


def in_turn(*parts: Callable[[], None]) -> None:
    """Call one after the other."""
    for part in parts:
        part()


if __name__ == "__main__":
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        tasks = [processes.submit(blocks), processes.submit(in_turn, images, other_specimens)]
        for task in tasks:
            task.result()
