"""Lens and set-up of stereo DIC: the thesis' Appendix A, the thin lens, and a search.

Beside its command only `calib.virtual` needs it, for the blur of its cameras; it needs the thesis'
tables and the reading of TOML files.
"""

from calib.optics.design_file import Camera, Design, Lens, Limits, Sample, load_design
from calib.optics.published import Check, published_checks
from calib.optics.published_limits import published_limits
from calib.optics.search import Found, out_of_reach, search
from calib.optics.setup import Setup, View, conditions, view

__all__ = [
    "Camera",
    "Check",
    "Design",
    "Found",
    "Lens",
    "Limits",
    "Sample",
    "Setup",
    "View",
    "conditions",
    "load_design",
    "out_of_reach",
    "published_checks",
    "published_limits",
    "search",
    "view",
]
