"""Numbers on the axes of figures, as one would write them."""

from __future__ import annotations

import numpy as np
from matplotlib.axis import Axis, XAxis
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, ScalarFormatter


def plain_log(axis: Axis) -> None:
    """A logarithmic scale with numbers as 0.1, 1, 10, and some between where the range is short.

    Numbers from 1e6 on, and below 0.0001, are written as these are. To be called after all is
    drawn: which numbers are shown depends on the limits.
    """
    if isinstance(axis, XAxis):
        axis.axes.set_xscale("log")
    else:
        axis.axes.set_yscale("log")
    low, high = sorted(float(end) for end in axis.get_view_interval())
    decades = np.log10(high / low)
    if decades < 0.8:
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    else:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def thousandths(axis: Axis) -> None:
    """Numbers of a linear scale as they are, or in powers of 1000: side by side they compare.

    To be called after all is drawn. Numbers below 0.1 are given in thousandths, not in millionths
    unless below 0.0001.
    """
    largest = float(np.max(np.abs(axis.get_view_interval())))
    power = 3 * int(np.floor((np.log10(largest) + 1.001) / 3)) if 0.0 < largest < 0.1 else 0
    numbers = ScalarFormatter(useOffset=False, useMathText=True)
    numbers.set_scientific(power != 0)
    if power:
        numbers.set_powerlimits((power, power))
    axis.set_major_formatter(numbers)
