"""Digital image correlation: images in, displacements with their uncertainty out.

Nothing here needs another package of softcal.
"""

from calib.dic.correlate import Correlation, correlate
from calib.dic.reasons import Reason
from calib.dic.settings import CorrelationSettings

__all__ = ["Correlation", "CorrelationSettings", "Reason", "correlate"]
