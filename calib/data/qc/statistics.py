"""Statistics of the samples as in chapter 5 of the thesis, and its tables 3.5, 3.6 and 5.2."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.data.qc.experiment_file import Mapping
from calib.data.qc.pipeline import QcResult, sample_field
from calib.data.qc.plateaus import converged_after, cycle_change_sds, cycle_changes
from calib.data.qc.quality import eligibility
from calib.data.qc.table import Cell, QcTable
from calib.data.requirements import Outcome, force_deviation, requirements_table
from fe.response import Array


class Box(NamedTuple):
    """Five numbers of a box plot, whiskers at the outermost values within 1.5 box heights."""

    low: float
    quarter: float
    median: float
    three_quarters: float
    high: float


def box(values: Array) -> Box:
    """Box of values (n,), NaN left out. Raises ValueError when there is none."""
    known = values[np.isfinite(values)]
    if not known.size:
        raise ValueError("values: expected one finite value or more, found none")
    q1, q2, q3 = (float(v) for v in np.percentile(known, [25, 50, 75]))
    reach = 1.5 * (q3 - q1)
    inside = known[(known >= q1 - reach) & (known <= q3 + reach)]
    # with few values the quartiles are means of two, of which one may be beyond the reach
    return Box(min(float(inside.min()), q1), q1, q2, q3, max(float(inside.max()), q3))


def all_tables(result: QcResult) -> tuple[QcTable, ...]:
    """Every table of one experiment; some may have no row."""
    return (
        eligibility_table(result),
        rejections_table(result),
        placement_table(result),
        force_table(result),
        hold_table(result),
        relaxation_table(result),
        cycles_table(result),
        accuracy_table(result),
        mapping_table(result),
        noise_table(result),
    )


def eligibility_table(result: QcResult) -> QcTable:
    """Number of samples eligible for post-processing, as thesis Table 5.2."""
    rows = eligibility(len(result.samples), result.rejections)
    return QcTable("eligible", "Samples eligible", ("criteria", "number_of_samples"), tuple(rows))


def rejections_table(result: QcResult) -> QcTable:
    """Each rule that a sample breaks, with value and threshold."""
    columns = ("sample", "rule", "reason", "value", "threshold", "unit")
    return QcTable(
        "rejections", "Rejected samples", columns, tuple(tuple(r) for r in result.rejections)
    )


def placement_table(result: QcResult) -> QcTable:
    """Where each sample stood, and what else it is judged by."""
    names = ("angle_deg", "tilt_deg", "roll_deg", "x_shift", "width", "plane_rms")
    columns = (
        "sample",
        "kept",
        *(f"{name}_mm" if name in names[3:] else name for name in names),
        "contact_mm",
        "contact_sd_mm",
        "contact_by_force_mm",
        "contact_by_force_sd_mm",
        "clock_offset_s",
        "clock_half_width_s",
        "outliers",
        "points",
    )
    rows: list[tuple[Cell, ...]] = []
    for sample, kept in zip(result.samples, result.kept, strict=True):
        face, machine, together = sample.face, sample.machine, sample.synchronised
        if face is None or machine is None or together is None:
            continue
        complete = np.isfinite(face.lattice.displacement[1:, ..., 0]).all(axis=0)
        rows.append(
            (
                sample.name,
                int(kept),
                *(float(getattr(face.placement, name)) for name in names),
                machine.contact.travel,
                machine.contact.travel_sd,
                machine.contact.by_force,
                machine.contact.by_force_sd,
                together.offset,
                together.half_width,
                int(face.cleaned.is_outlier.sum()),
                int(complete.sum()),
            )
        )
    return QcTable("placement", "Placement", columns, tuple(rows))


def force_table(result: QcResult) -> QcTable:
    """Mean, SD and box of the force at each increment used, of all and of the kept samples."""
    forces, rows = result.forces(), []
    for which, chosen in (("all", np.ones(len(forces), dtype=bool)), ("kept", result.kept)):
        for column, number in enumerate(result.experiment.protocol.use):
            values = forces[chosen, column]
            values = values[np.isfinite(values)]
            if values.size < 2:
                continue
            mean, sd = float(values.mean()), float(values.std(ddof=1))
            travel = float(result.experiment.protocol.travel[column])
            rows.append(
                (which, number, travel, values.size, mean, sd, 100 * sd / mean, *box(values))
            )
    names = ("samples", "increment", "travel_mm", "n", "mean_N", "sd_N", "relative_percent")
    return QcTable(
        "forces", "Force by increment", (*names, *(f"{n}_N" for n in Box._fields)), tuple(rows)
    )


def hold_table(result: QcResult) -> QcTable:
    """Every hold of every sample: force, noise, relaxation."""
    columns = (
        "sample",
        "increment",
        "start_s",
        "end_s",
        "travel_mm",
        "force_N",
        "force_sd_N",
        "noise_sd_N",
        "variation_percent",
        "raw_variation_percent",
        "time_to_constant_s",
        "final_rate_N_per_s",
    )
    rows = [
        (sample.name, hold.number, hold.start, hold.end, float(travel), *plateau)
        for sample in result.samples
        if (test := sample.machine) is not None
        for hold, travel, plateau in zip(
            test.holds, test.plateau_travel, test.plateaus, strict=True
        )
    ]
    return QcTable("holds", "Holds", columns, tuple(rows))


def relaxation_table(result: QcResult) -> QcTable:
    """Variation and time to constant force by increment, mean over the samples (Table 3.6)."""
    found: dict[int, list[tuple[float, float, float]]] = {}
    for sample in result.samples:
        if sample.machine is None:
            continue
        for hold, p in zip(sample.machine.holds, sample.machine.plateaus, strict=True):
            times = (p.variation_percent, p.raw_variation_percent, p.time_to_constant)
            found.setdefault(hold.number, []).append(times)
    rows = []
    for number in result.experiment.protocol.use:
        values = np.array(found.get(number, np.zeros((0, 3))))
        if len(values):
            reached = values[np.isfinite(values[:, 2]), 2]
            time = float(reached.mean()) if reached.size else float("nan")
            rows.append(
                (number, *(float(v) for v in values[:, :2].mean(axis=0)), time, reached.size)
            )
    columns = (
        "increment",
        "variation_percent",
        "raw_variation_percent",
        "time_to_constant_s",
        "samples_that_reach_it",
    )
    return QcTable("relaxation", "Relaxation", columns, tuple(rows))


def cycles_table(result: QcResult) -> QcTable:
    """Peak force of each preconditioning cycle (Figure 5.1)."""
    rows = []
    for sample in result.samples:
        if sample.machine is None:
            continue
        cycles = list(sample.machine.cycles)
        changes = np.concatenate([[np.nan], cycle_changes(cycles)])
        sds = np.concatenate([[np.nan], cycle_change_sds(cycles)])
        settled = converged_after(cycles)
        after = settled if settled is not None else float("nan")
        for i, cycle in enumerate(cycles):
            forces = (cycle.peak_force, cycle.peak_sd)
            rows.append((sample.name, i + 1, *forces, float(changes[i]), float(sds[i]), after))
    columns = (
        "sample",
        "cycle",
        "peak_force_N",
        "peak_force_sd_N",
        "change_percent",
        "change_sd_percent",
        "converged_after_cycles",
    )
    return QcTable("cycles", "Preconditioning", columns, tuple(rows))


def accuracy_table(result: QcResult) -> QcTable:
    """Mean step of the pin by machine and by DIC (Table 3.5), where points of the pin are named."""
    columns = ("sample", "utm_step_mm", "dic_step_mm", "absolute_relative_error_percent")
    rows = []
    for sample in result.samples:
        face = sample.face
        if face is not None and face.pin_travel is not None and face.travel.size > 1:
            n = face.travel.size - 1
            machine = -float(face.travel[-1] - face.travel[0]) / n
            dic = float(face.pin_travel[-1] - face.pin_travel[0]) / n
            rows.append((sample.name, machine, dic, 100 * abs(dic - machine) / abs(machine)))
    return QcTable("displacement_accuracy", "Displacement accuracy", columns, tuple(rows))


def mapping_table(result: QcResult) -> QcTable:
    """How far the ways of mapping differ from each other, RMS over all steps of a kept sample."""
    columns = ("sample", "mapping", "against", "x_mm", "y_mm", "z_mm", "points")
    kept = [s for s, good in zip(result.samples, result.kept, strict=True) if good]
    if not kept:
        return QcTable("mapping", "Mapping", columns, ())
    ways: tuple[Mapping, ...] = ("shape", "linear", "cubic")
    fields = {way: sample_field(kept[0], result.experiment, result.points, way) for way in ways}
    rows: list[tuple[Cell, ...]] = []
    pairs: tuple[tuple[Mapping, Mapping], ...] = (
        ("shape", "linear"),
        ("linear", "cubic"),
        ("shape", "cubic"),
    )
    for one, other in pairs:
        off = fields[one] - fields[other]
        known = np.isfinite(off).all(axis=(0, 2))
        rms = np.sqrt((off[:, known] ** 2).mean(axis=(0, 1))) if known.any() else np.full(3, np.nan)
        rows.append((kept[0].name, one, other, *(float(v) for v in rms), int(known.sum())))
    return QcTable("mapping", "Mapping", columns, tuple(rows))


def noise_table(result: QcResult) -> QcTable:
    """Noise of one frame: of the DIC points, and of one sample's field at the data set's points."""
    columns = (
        "noise",
        "x_mm",
        "y_mm",
        "z_mm",
        "correlation_length_mm",
        "smoothing_mm",
        "nugget",
        "reference_share",
        "frames",
    )
    noise = result.noise
    if noise is None:
        return QcTable("noise", "Noise", columns, ())
    floors = (
        ("static frames, DIC points", noise.at_points),
        ("static frames, field", noise.static),
        ("samples, field", noise.repeats),
    )
    rows: list[tuple[Cell, ...]] = [
        (
            name,
            *(float(v) for v in floor.std),
            floor.correlation_length,
            floor.smoothing,
            floor.nugget,
            floor.reference_share,
            floor.n_frames,
        )
        for name, floor in floors
        if floor is not None
    ]
    if noise.stated is not None:
        stated = (float(v) for v in noise.stated)
        length = "" if noise.stated_length is None else noise.stated_length
        rows.append(("stated by the DIC program, field", *stated, length, "", "", "", ""))
    return QcTable("noise", "Noise", columns, tuple(rows))


def requirements(result: QcResult) -> tuple[Outcome, ...]:
    """The design requirements of thesis 3.2.1 that an experiment has a figure for."""
    specimen = result.experiment.specimen
    figures = {
        "sample_width": specimen.width_mm,
        "sample_depth": specimen.depth_mm,
        "sample_height": specimen.height_mm,
        "force_levels": float(len(result.experiment.protocol.use)),
    }
    points = [row[-1] for row in placement_table(result).rows if row[1]]
    if points:
        figures["data_points"] = float(np.median(np.array(points, dtype=np.float64)))
    dataset = result.dataset
    if dataset is not None:
        mean, sd = dataset.force_mean.tolist(), dataset.force_sd.tolist()
        figures["force_deviation"] = force_deviation(mean, sd)
    return requirements_table(figures)
