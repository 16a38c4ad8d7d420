"""Tables of emulators: errors, coverage, worst runs, runs that ended early, the loop of refinement.

`diagnostics` maps a hypothesis to its part of diagnostics.json, `refinement` to that of
refinement.json.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from calib.study.local_design import MOST_LOST
from calib.study.tables import Table, number, percent

KINDS = {"leave_one_out": "leave-one-out", "held_out": "held-out"}
PARAMETERS = ("ln kappa", "r", "s")
INPUTS = ("r [-]", "s [-]")
PARTS_OF_SHIFT = {"by_processes": "processes", "by_stated": "stated", "by_runs": "left out"}
"""what makes up how far a mean may move, and the heads of their columns"""


def emulator_tables(
    diagnostics: Mapping[str, Any], limits: Mapping[str, float]
) -> list[Table | None]:
    """All that is known of the emulators' errors, in the order in which it is read."""
    return [
        emulator_table(diagnostics, limits),
        coverage_table(diagnostics),
        *(runs_table(name, found) for name, found in diagnostics.items()),
        partial_table(diagnostics),
    ]


def emulator_table(diagnostics: Mapping[str, Any], limits: Mapping[str, float]) -> Table:
    """Errors of the emulators on runs that they were not trained on."""
    rows = []
    for name, found in diagnostics.items():
        share = found["share_of_noise"]
        for kind, errors in _kinds(found):
            judged = kind == "held_out" or found["held_out"] is None
            rows.append(
                (
                    name,
                    f"{found['n_train']} ({found['n_with_gradients']}, {found['n_excluded']})",
                    f"{errors['n_runs']} ({KINDS[kind]})",
                    f"{100 * max(errors['force_rms']):.3f}",
                    f"{100 * errors['force_max']:.3f}",
                    "-" if errors["field_rms"] is None else number(max(errors["field_rms"]), 2),
                    number(errors["force_rms_z"], 3),
                    number(share["force"], 2) if judged else "",
                    number(share["field"], 2) if judged else "",
                )
            )
    return Table(
        "Emulator against FE runs that it was not trained on",
        (
            "hypothesis",
            "trained on [runs]",
            "judged on [runs]",
            "force [%]",
            "largest [%]",
            "field [mm]",
            "z [-]",
            "force/noise",
            "field/noise",
        ),
        tuple(rows),
        "trained: complete runs (those with derivatives, those besides that did not reach the last "
        "increment); force and field: RMS over runs at the worst increment; z: RMS of error over "
        "stated SD; force/noise: force error over the standard error of the measured mean; "
        "field/noise: over the SD of a displacement. Limits of the study, for held-out runs: force "
        f"{100 * limits['max_force_error']:g} %, field {limits['max_field_error']:g} mm (where the "
        "data have one).",
    )


def coverage_table(diagnostics: Mapping[str, Any]) -> Table:
    """How often the stated central intervals hold the FE value."""
    rows = []
    for name, found in diagnostics.items():
        for kind, errors in _kinds(found):
            for what in ("force", "field"):
                coverage = errors[f"{what}_coverage"]
                if coverage is None:
                    continue
                joint, stated = coverage["joint"], coverage["joint_as_stated"]
                # Runs left out tell the width of others, where there are enough of them.
                told = any((found.get("scales") or {}).get(what, {}).values())
                widened = kind == "held_out" and joint is not None and told
                rows.append(
                    (
                        f"{name}, {what}",
                        f"{errors['n_runs']} ({KINDS[kind]})",
                        *(f"{100 * share:.0f}" for share in coverage["overall"]),
                        "-" if stated is None else f"{100 * stated[-1]:.0f}",
                        f"{100 * joint[-1]:.0f}" if widened else "-",
                    )
                )
    return Table(
        "Share of FE values within the intervals that the emulator states [%]",
        ("hypothesis", "runs", "of 50 %", "of 80 %", "of 95 %", "of 95 %, joint", "widened"),
        tuple(rows),
        "Over all increments (and points); joint: runs within the region of all increments "
        "together (force), or with every value within the band that holds 95 % of whole fields, as "
        "stated and as wide as training runs left out in turn ask for (-: of these themselves, and "
        "where fewer than 16 of them lie away from the edge of the design). Values of a run are "
        "alike, so that few runs say little.",
    )


def runs_table(name: str, found: Mapping[str, Any]) -> Table:
    """Errors of every run of one hypothesis by an emulator that had not seen it, worst first."""
    rows = []
    for kind, _ in _kinds(found):
        runs = found["runs"][kind]
        for index, ratios in enumerate(runs["ratios"]):
            error = np.array(runs["relative_force_error"][index])
            z = np.abs(runs["standardised_error"][index])
            worst = int(np.argmax(np.abs(error)))
            field = runs["field_rms"]
            rows.append(
                (
                    abs(error[worst]),
                    (
                        KINDS[kind],
                        *(f"{value:.4g}" for value in ratios),
                        percent(float(error[worst]), 3),
                        str(worst + 1),
                        number(float(z.max()), 3),
                        "-" if field is None else number(max(field[index]), 2),
                    ),
                )
            )
    ordered = sorted(rows, key=lambda row: (-row[0], row[1]))
    return Table(
        f"{name}: runs left out or held out, worst first",
        (
            "run",
            *found.get("inputs", INPUTS),
            "force [%]",
            "at increment",
            "largest z [-]",
            "field [mm]",
        ),
        tuple(row for _, row in ordered),
        "force: largest error of the run, emulator over FE; field: RMS at its worst increment.",
    )


def partial_table(diagnostics: Mapping[str, Any]) -> Table | None:
    """Runs that ended early, held against the emulator up to the travel reached."""
    rows = []
    for name, found in diagnostics.items():
        runs = found["partial_runs"]
        for index, ratios in enumerate(runs["ratios"]):
            relative = [value for value in runs["relative"][index] if value is not None]
            z = [abs(value) for value in runs["standardised"][index] if value is not None]
            by_step = runs.get("field_rms") or [[]] * len(runs["ratios"])
            field = [value for value in by_step[index] if value is not None]
            rows.append(
                (
                    name,
                    ", ".join(f"{value:.4g}" for value in ratios),
                    f"{runs['reached'][index]:.4g}",
                    str(len(relative)),
                    percent(max(relative, key=abs), 3) if relative else "-",
                    number(max(z), 3) if z else "-",
                    number(max(field), 2) if field else "-",
                )
            )
    if not rows:
        return None
    return Table(
        "Runs that ended before the last increment, against the emulator up to where they are good",
        ("hypothesis", "at", "good to [mm]", "increments", "force [%]", "largest z", "field [mm]"),
        tuple(rows),
        "By the emulator of the complete runs alone, to which these are an extrapolation; that in "
        "use has learnt from those that trained it up to the travel reached, if they lie in the "
        "box of the complete runs, at no other run's place, and the less the further their z is "
        "beyond what it states. Force, field (RMS): largest errors up to there. At: "
        + "; ".join(
            f"{name}: {', '.join(found.get('inputs', INPUTS))}"
            for name, found in diagnostics.items()
        )
        + ".",
    )


def refinement_table(
    refinement: Mapping[str, Any], beyond: Mapping[str, float] | None = None
) -> Table:
    """Rounds of the loop: runs, how far the posterior mean may move, error at the new runs.

    `beyond`: which share of posteriors lies beyond their boxes, where that is known better than by
    the last look.
    """
    rows = []
    notes: list[str] = []
    sets = [
        entry.get("x", PARAMETERS) for found in refinement.values() for entry in found["rounds"]
    ]
    names = list(dict.fromkeys(name for own in sets for name in own))
    for name, found in refinement.items():
        rows += [_round_row(name, entry, names) for entry in found["rounds"]]
        notes += _box_note(name, found, (beyond or {}).get(name))
        last = max(found["rounds"][-1]["predicted_shift"])
        if last > found["limit"]:
            notes.append(
                f"{name}: the largest number of runs was reached while the mean may still move by "
                f"{number(last, 2)} SD; raise design.n_refine."
            )
    limit = next(iter(refinement.values()))["limit"]
    return Table(
        "Refinement: runs added where the posterior is",
        (
            "hypothesis",
            "trained on [runs]",
            *(f"{column} may move [SD]" for column in names),
            *PARTS_OF_SHIFT.values(),
            "SD ratio",
            "added [runs]",
            "force there [%]",
            "z [-]",
        ),
        tuple(rows),
        f"The loop stops when no mean would move by more than {limit:g} posterior SD if the "
        "emulator had no error; the last run is at the mean. May move: the larger of what its "
        "processes do not know, and of the errors that it states (without them) and was seen to "
        "make at runs left out where the posterior is, both together; SD ratio: SD over what it "
        "were without the errors stated, the largest. In its box: by the runs of a second design "
        "where the posterior is, zero outside. force there: RMS error, worst "
        "increment, of the emulator at the runs then added, which it had not seen. "
        + " ".join(notes),
    )


def _round_row(name: str, entry: Mapping[str, Any], names: Sequence[str]) -> tuple[str, ...]:
    """One round of the loop; `names` are the columns of parameters, this hypothesis' or not."""
    shift = dict(zip(entry.get("x", PARAMETERS), entry["predicted_shift"], strict=True))
    error = [value for value in entry["force_error"] if value is not None]
    return (
        name if entry.get("box") is None else f"{name} in its box",
        str(entry["n_train"]),
        *(number(shift.get(column), 2) for column in names),
        *(_largest(entry.get(part, ())) for part in PARTS_OF_SHIFT),
        _largest(entry.get("sd_ratio", ()), 3),
        str(entry["n_added"]),
        f"{100 * max(error):.3f}" if error else "-",
        number(entry["rms_z"], 2),
    )


def _box_note(name: str, found: Mapping[str, Any], beyond: float | None) -> Iterator[str]:
    """By which emulator a hypothesis with a second design is sampled; `beyond` None: not known."""
    if found.get("box") is None:
        if found.get("local"):
            yield (
                f"{name}: no box of a second design held the posterior; it is sampled with the "
                "emulator of the prior's."
            )
        return
    share = found["mass_beyond"] if beyond is None else beyond
    if beyond is not None and beyond > MOST_LOST:
        yield (
            f"{name}: the last check of the mesh left {share:.1g} of the posterior outside the box "
            "of its second design; it is sampled with the emulator of the prior's."
        )
    else:
        yield (
            f"{name}: sampled in the box of its posterior, which leaves {share:.1g} of it outside."
        )


def _largest(values: Iterable[float | None], digits: int = 2) -> str:
    """Of what is known; studies of before have no parts of the shift."""
    known = [value for value in values if value is not None]
    return number(max(known), digits) if known else "-"


def _kinds(found: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for kind in KINDS:
        if found[kind] is not None:
            yield kind, found[kind]
