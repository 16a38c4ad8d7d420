"""Tables of one hypothesis' posterior: constants with their intervals, and maxima beside them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from calib.inference.at_bound import leaning_sentence
from calib.study.tables import Table, number

if TYPE_CHECKING:
    from calib.study.summary import Summary


def constants_table(summary: Summary, truth: Mapping[str, float] | None = None) -> Table:
    """Posterior of one hypothesis; with the truth beside it for synthetic data."""
    columns = ["constant", "unit", "mean", "SD", f"{summary.interval} low", "high"]
    columns += ["ESS bulk", "ESS tail", "R-hat"]
    columns += ["synthetic truth", "within"] if truth else []
    rows = []
    for name, c in summary.constants.items():
        row = [name, c.unit, number(c.mean), number(c.sd, 2), number(c.hdi_low)]
        row += [number(c.hdi_high), f"{c.ess_bulk:.0f}", f"{c.ess_tail:.0f}", f"{c.r_hat:.4f}"]
        if truth:
            inside = c.hdi_low <= truth[name] <= c.hdi_high
            row += [number(truth[name]), "yes" if inside else "no"]
        rows.append(tuple(row))
    kind = ", SYNTHETIC data" if summary.synthetic else ""
    return Table(
        f"Posterior under {summary.hypothesis} (study {summary.study}{kind})",
        tuple(columns),
        tuple(rows),
    )


def points_table(summary: Summary) -> Table:
    """Maxima by emulator and FE model, and published values, beside the posterior's mean."""
    columns = ["constant", "unit", "mean", "SD", "MAP emulator", "MAP direct FE"]
    columns += ["difference [SD]"]
    with_published = any(c.published is not None for c in summary.constants.values())
    columns += ["published", "out by [SD]"] if with_published else []
    rows = []
    for name, c in summary.constants.items():
        row = [name, c.unit, number(c.mean), number(c.sd, 2), number(c.map_emulator)]
        row += [number(c.map_fe), _signed(c.map_difference_sd, 3)]
        row += [number(c.published), _signed(c.published_z, 1)] if with_published else []
        rows.append(tuple(row))
    note = "difference = direct FE minus emulator, in posterior standard deviations."
    if with_published:
        note += " out by = (published - mean) / SD: how far out, not a probability."
    note = f"{note} {leaning_sentence(summary.hypothesis, summary.at_bound)}".rstrip()
    note = f"{note} {summary.mesh_remark}".strip()
    return Table(f"Maxima under {summary.hypothesis}", tuple(columns), tuple(rows), note)


def _signed(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:+.{digits}f}"
