"""Table of what was unknown beside the constants."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.study.tables import Table, number

if TYPE_CHECKING:
    from calib.study.summary import Summary


def further_table(summary: Summary) -> Table | None:
    """Posterior of what else was unknown under one hypothesis; None where that is nothing."""
    if not summary.further:
        return None
    rows = [
        (
            name,
            "-" if c.unit == "1" else c.unit,
            *(number(value) for value in (c.mean, c.sd, c.hdi_low, c.hdi_high)),
            f"{c.ess_bulk:.0f}",
            f"{c.ess_tail:.0f}",
            f"{c.r_hat:.4f}",
        )
        for name, c in summary.further.items()
    ]
    columns = ("parameter", "unit", "mean", "SD", f"{summary.interval} low", "high")
    return Table(
        f"Further unknowns under {summary.hypothesis}",
        (*columns, "ESS bulk", "ESS tail", "R-hat"),
        tuple(rows),
        "A posterior as wide as the prior says that the data know nothing of the parameter.",
    )
