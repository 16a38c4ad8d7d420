"""Measured figures against the design requirements of the thesis, as in its Table 6.1."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.data.thesis import optimization_runs, thesis_table

_COMPARE = {"<": operator.lt, "<=": operator.le, ">=": operator.ge}


@dataclass(frozen=True)
class Outcome:
    """One requirement beside what was reached."""

    number: int
    """of the requirement in thesis 3.2.1"""
    quantity: str
    figure: float | None
    """what was reached, in `unit`; None when it was not measured"""
    comparison: str
    """`<`, `<=` or `>=`"""
    threshold: float
    """in `unit`"""
    unit: str
    """`mm`, `percent` or `1`"""

    @property
    def passed(self) -> bool | None:
        """Whether the requirement is met; None when it was not measured."""
        if self.figure is None:
            return None
        return bool(_COMPARE[self.comparison](self.figure, self.threshold))


def requirements_table(figures: Mapping[str, float]) -> tuple[Outcome, ...]:
    """All requirements that have a number, in the order of thesis 3.2.1.

    `figures` are by the quantity's name and in its unit; see the table `Requirements 3.2.1`.
    Raises ValueError for a quantity that no requirement is about, and for one that is not finite.
    """
    table = thesis_table("Requirements 3.2.1")
    quantities = table.cells("quantity")
    for name, figure in figures.items():
        if name not in quantities:
            expected = ", ".join(quantities)
            raise ValueError(f"figures: found {name}, expected one of {expected}")
        if not np.isfinite(figure):
            raise ValueError(f"figures: {name}: found {figure}, expected a finite number")
    thresholds, units = table.numbers("threshold"), table.cells("unit")
    numbers, comparisons = table.cells("number"), table.cells("comparison")
    return tuple(
        Outcome(
            number=int(numbers[i]),
            quantity=name,
            figure=float(figures[name]) if name in figures else None,
            comparison=comparisons[i],
            threshold=float(thresholds[i]),
            unit=units[i],
        )
        for i, name in enumerate(quantities)
    )


def force_deviation(force_mean: Sequence[float], force_sd: Sequence[float]) -> float:
    """Largest SD between samples in per cent of the full scale, the largest mean force.

    Both (n_increment,), N. Raises ValueError when lengths differ or the full scale is not positive.
    """
    mean, sd = np.asarray(force_mean, dtype=np.float64), np.asarray(force_sd, dtype=np.float64)
    if mean.shape != sd.shape or mean.ndim != 1:
        raise ValueError(f"force_sd: found shape {sd.shape}, expected that of means, {mean.shape}")
    if not mean.size or not mean.max() > 0:
        raise ValueError("force_mean: found no positive force, expected one or more")
    return float(100 * sd.max() / mean.max())


def thesis_figures() -> dict[str, float]:
    """What the thesis itself reached, from its tables and section 5.6.

    The spread of the constants is the largest deviation of one of the nine runs of Table 5.3 from
    their mean. Error and correlation are those of the validation test, the worse direction.
    """
    forces, validation = thesis_table("Table 5.1"), thesis_table("Section 5.6")
    constants = optimization_runs().result
    spread = 100 * np.abs(constants / constants.mean(axis=0) - 1).max()
    return {
        "sample_width": 10.0,  # section 3.4
        "sample_depth": 10.0,
        "sample_height": 2.5,
        "force_levels": float(len(forces.cells("increment"))),
        "data_points": 840.0,  # Table 6.1
        "displacement_error": 100 * float(validation.numbers(_ERROR).max()),
        "force_deviation": force_deviation(
            forces.numbers("average_N").tolist(), forces.numbers("standard_deviation_N").tolist()
        ),
        "constants_spread": float(spread),
        "correlation": float(validation.numbers("average_correlation_coefficient").min()),
    }


_ERROR = "average_absolute_relative_error"


def requirements_text(outcomes: Sequence[Outcome]) -> str:
    """The outcomes as aligned text: number, quantity, limit, figure, pass or fail."""
    words = {True: "pass", False: "fail", None: "not measured"}
    rows = [("no.", "quantity", "limit", "figure", "unit", "result")]
    for one in outcomes:
        figure = "-" if one.figure is None else f"{one.figure:.4g}"
        limit = f"{one.comparison} {one.threshold:g}"
        rows.append((str(one.number), one.quantity, limit, figure, one.unit, words[one.passed]))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
