"""How the figures of a study look: colours, marks, intervals, and writing them as PNG.

Colours are those of Okabe and Ito (2008), told apart with every common form of colour blindness;
hypotheses also differ in marker and line style. Figures use Matplotlib's object interface only:
no display, no state.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from calib.study.artifacts import write_bytes

Array = npt.NDArray[np.float64]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
MARKERS = ("o", "s", "^", "D", "v", "P")
LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1)), (0, (3, 2)))
INK = "#222222"
MUTED = "#777777"
INTERVAL = 0.94
"""probability of every band and interval drawn"""
SHARE = f"{100 * INTERVAL:.0f} %"
"""the same as it is written"""

LEGEND_WIDTH = 2.2
"""inches that one entry of a legend takes"""


def legend_columns(width: float) -> int:
    """How many columns of a legend a figure of that width has room for, inches."""
    return max(1, min(5, int(width / LEGEND_WIDTH)))


def save_png(figure: Figure, path: Path, dpi: int = 150) -> None:
    """Write the figure as PNG, atomically."""
    write_bytes(path, png_bytes(figure, dpi))


def png_bytes(figure: Figure, dpi: int = 150) -> bytes:
    """The figure as PNG."""
    stream = io.BytesIO()
    FigureCanvasAgg(figure)
    # Without the software's name in it the same numbers give the same file on every machine.
    figure.savefig(stream, format="png", dpi=dpi, metadata={"Software": None})
    return stream.getvalue()


def hdi(draws: Array, probability: float = INTERVAL) -> tuple[float, float]:
    """Shortest interval that holds the given share of the draws (n,).

    Raises ValueError when there are fewer than two finite draws.
    """
    ordered = np.sort(np.asarray(draws, dtype=float).ravel())
    if ordered.size < 2 or not np.isfinite(ordered).all():
        raise ValueError(f"draws: expected at least two finite values, found {ordered.size}")
    n_inside = min(int(np.floor(probability * ordered.size)), ordered.size - 1)
    width = ordered[n_inside:] - ordered[: ordered.size - n_inside]
    start = int(np.argmin(width))
    return float(ordered[start]), float(ordered[start + n_inside])


def tidy(axis: Axes) -> None:
    """Leave out the frame where no axis is."""
    axis.spines[["top", "right"]].set_visible(False)


def symbol(name: str) -> str:
    """A constant's name as it is set in formulas."""
    known = {"mu": "$\\mu$", "kappa": "$\\kappa$", "r": "$r$", "s": "$s$"}
    if name in known:
        return known[name]
    letters, digits = name.rstrip("0123456789"), name[len(name.rstrip("0123456789")) :]
    if letters in ("mu", "alpha"):
        return f"$\\{letters}_{{{digits}}}$"
    if len(letters) > 1:
        return name.replace("_", " ")
    return f"${name[0]}_{{{name[1:]}}}$"
