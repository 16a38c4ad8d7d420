"""Calibration: from measurements to a posterior of the constants, with the FE model in the loop.

What the names are stands in `__init__.pyi`; each is imported when it is first asked for, so that
the command answers at once.
"""

import lazy_loader

__version__ = "0.3.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
