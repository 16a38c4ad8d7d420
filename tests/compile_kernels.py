"""Compile the kernels of the FE models once, which processes of the tests would do side by side.

python tests/compile_kernels.py
"""

from __future__ import annotations

import numpy as np

from fe import BlockPin, BlockPinModel, Contact, Cylinder, CylinderModel, NotchedPlate, TensileModel

RATIOS = np.array([0.5, 0.05])

for contact in (Contact(), Contact(0.3, 0.2)):
    BlockPinModel(BlockPin(), contact, (2, 2, 1), (0.02,))(RATIOS)
CylinderModel(Cylinder(), (2, 2), (0.1,), friction=0.3)(RATIOS)
TensileModel(NotchedPlate(), (1, 2, 1), (0.1,))(RATIOS)
