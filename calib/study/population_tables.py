"""Tables of a population, its samples and a new one."""

from __future__ import annotations

from calib.inference.population_data import SD
from calib.study.figure_style import INTERVAL
from calib.study.population_summary import PopulationSummary, Spread
from calib.study.tables import Table, number

INTERVAL_NAME = f"{INTERVAL:.0%} HDI"
FEW = 3
"""samples that tell little of their scatter, whatever the width of its posterior"""


def population_tables(found: PopulationSummary | None, hypothesis: str) -> list[Table]:
    """All tables of one hypothesis; none where its samples were not taken one by one."""
    if found is None:
        return []
    return [
        population_table(found, hypothesis),
        new_sample_table(found, hypothesis),
        samples_table(found, hypothesis),
    ]


def population_table(found: PopulationSummary, hypothesis: str) -> Table:
    """Constants of the population, SDs between samples, what is common."""
    rows = []
    for name, spread in found.population.items():
        checked = found.convergence[name]
        rows.append(
            (
                f"SD of {name.removeprefix(SD)} between samples" if name.startswith(SD) else name,
                *_cells(spread),
                f"{min(checked.ess_bulk, checked.ess_tail):.0f}",
                f"{checked.r_hat:.4f}",
            )
        )
    note = (
        f"Of {len(found.sample_names)} samples. "
        f"Between samples {' and '.join(found.varying)} differ{'s' * (len(found.varying) == 1)}, "
        "the rest is common to all. "
        "The population's kappa is its median; SDs of kappa and bulk_ratio are relative (of their "
        "logarithm)."
    )
    if found.prior_driven:
        names = ", ".join(name.removeprefix(SD) for name in found.prior_driven)
        note += f" The scatter of {names} is hardly known better than its prior says."
    elif len(found.sample_names) <= FEW:
        note += " Of so few samples their scatter is in good part the prior's."
    columns = ("quantity", "unit", "mean", "SD", f"{INTERVAL_NAME} low", "high", "ESS", "R-hat")
    return Table(f"Population under {hypothesis}", columns, tuple(rows), note)


def new_sample_table(found: PopulationSummary, hypothesis: str) -> Table:
    """What a sample not yet seen will have and show."""
    rows = [(name, *_cells(spread)) for name, spread in found.new.items()]
    for travel, spread in zip(found.travel, found.force_new, strict=True):
        rows.append((f"force at {travel:g} mm", *_cells(spread)))
    columns = ("quantity", "unit", "mean", "SD", f"{INTERVAL_NAME} low", "high")
    note = "Predictive: the forces as they would be measured, with all errors."
    return Table(f"A new sample under {hypothesis}", columns, tuple(rows), note)


def samples_table(found: PopulationSummary, hypothesis: str) -> Table:
    """Each sample by the population and by its own data."""
    names = [name for name in found.samples if name in (*found.varying, "mu")]
    rows = []
    for index, sample in enumerate(found.sample_names):
        cells = [sample]
        for name in names:
            for spread in (found.samples[name][index], found.alone[name][index]):
                cells.append(f"{number(spread.mean)} ± {number(spread.sd, 2)}")
        rows.append((*cells, number(found.fit_p[index], 2)))
    columns = ["sample"]
    for name in names:
        unit = _unit(found.samples[name][0].unit)
        columns += [f"{name} [{unit}]", "by itself"]
    return Table(
        f"Samples under {hypothesis} (mean ± SD)",
        (*columns, "fit p"),
        tuple(rows),
        "By itself: from the sample's own data, with what is common to all as all data say. fit p: "
        "p-value of the sample's residuals; small where no constants explain them.",
    )


def _cells(spread: Spread) -> tuple[str, str, str, str, str]:
    return (
        _unit(spread.unit),
        number(spread.mean),
        number(spread.sd, 2),
        number(spread.hdi_low),
        number(spread.hdi_high),
    )


def _unit(unit: str) -> str:
    return "-" if unit == "1" else unit
