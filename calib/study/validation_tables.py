"""Tables of a validation; `found` is validation.json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calib.study.tables import Table, number

OTHER = (
    "This second test is synthetic, of a material of its own, and the study's forces were "
    "measured: PASS and FAIL say how near the two materials are, and nothing of the study."
)


def validation_tables(found: Mapping[str, Any]) -> list[Table]:
    """What every prediction reached, and its error by increment."""
    return [_overall(found), _by_step(found)]


def verdicts(found: Mapping[str, Any]) -> list[str]:
    """One sentence a prediction: pass or fail against the requirement, and by what."""
    lines = []
    for name, one in found["predictions"].items():
        failed = [q for q in one["judged"] if not one["quantities"][q]["passed"]]
        word = "PASS" if one["passed"] else f"FAIL ({', '.join(failed)})"
        off = ", ".join(
            f"{q} {_per_cent(one['quantities'][q]['error'])} %, "
            f"R2 {number(one['quantities'][q]['r2'], 4)}"
            for q in one["judged"]
        )
        lines.append(f"{word}  {name}: {off}")
        lines += _left_out(one)
        lines += [line for q in one["judged"] for line in _near(one, q, found["requirement"])]
    if found.get("of_another_material"):
        lines.append(OTHER)
    return lines


def _left_out(prediction: Mapping[str, Any]) -> list[str]:
    """What the verdict is not of; files of before 0.3 say nothing of it."""
    lines = []
    absent = [f"u_{name}" for name in prediction.get("not_measured", [])]
    if absent:
        what = ", ".join(absent)
        lines.append(f"LOOK AT  {what}: not measured, so the verdict is of the answer alone")
    failed = prediction.get("n_failed", 0)
    if failed:
        lines.append(
            f"LOOK AT  {failed} of {failed + prediction['n_draws']} draws could not be solved "
            f"({prediction.get('why_failed', '')}) and are left out: the verdict is of the others, "
            "which need not be a fair sample of the posterior"
        )
    return lines


def _near(prediction: Mapping[str, Any], quantity: str, need: Mapping[str, Any]) -> list[str]:
    """A sentence where other draws of the posterior might find another verdict."""
    found = prediction["quantities"][quantity]
    told = (
        ("error", 100.0, " %", found["error"], found.get("error_sd"), need["max_error"]),
        ("R2", 1.0, "", found["r2"], found.get("r2_sd"), need["min_r2"]),
    )
    if any(value is None or sd is None for _, _, _, value, sd, _ in told):
        return []
    beyond = (found["error"] - need["max_error"], need["min_r2"] - found["r2"])
    sds = (found["error_sd"], found["r2_sd"])
    if any(far >= 2.0 * sd > 0.0 for far, sd in zip(beyond, sds, strict=True)):
        return []  # fails whatever the other says
    return [
        f"LOOK AT  {quantity}: its {name} is {number(times * abs(value - limit), 1)}{unit} from "
        f"the limit of {times * limit:g}{unit}, less than two Monte Carlo SDs "
        f"({number(times * sd, 1)}{unit}): other draws might turn the verdict, ask for more `draws`"
        for name, times, unit, value, sd, limit in told
        if abs(value - limit) < 2.0 * sd
    ]


def _overall(found: Mapping[str, Any]) -> Table:
    rows = []
    for name, one in found["predictions"].items():
        for quantity, q in one["quantities"].items():
            judged = quantity in one["judged"]
            rows.append(
                (
                    name,
                    found["quantity"] if quantity == "answer" else f"u_{quantity} [mm]",
                    _error(q),
                    number(q["ratio"], 4),
                    number(q["r2"], 4),
                    number(q["r2_of_noise"], 4),
                    number(q["correlation"], 4),
                    number(100 * q["coverage"]["0.94"], 3),
                    number(q["area"], 3),
                    number(q["pooled_area"], 2),
                    ("pass" if q["passed"] else "FAIL") if judged else "not judged",
                )
            )
    kind = "SYNTHETIC" if found["synthetic"] else "measured"
    need = found["requirement"]
    return Table(
        f"Validation on {found['data']} ({kind}, {found['n_samples']} samples)",
        (
            "by",
            "quantity",
            "error [%]",
            "ratio [-]",
            "R2 [-]",
            "of noise",
            "R [-]",
            "in 94 % [%]",
            "area",
            "u-area [-]",
            "result",
        ),
        tuple(rows),
        f"Requirement 8: error below {100 * need['max_error']:g} % and R2 of at least "
        f"{need['min_r2']:g}. error: RMS of prediction minus measurement over RMS of the "
        "measurement, in brackets its Monte Carlo SD; the prediction is the mean over draws (the "
        "figure shows the median, which lies elsewhere where they are skewed). ratio: what the "
        "prediction must be multiplied by. "
        "R2: coefficient of determination; of noise: what noise alone would leave of it. R: "
        "correlation over increments, mean of points (the thesis' R^2, which does not see a "
        "scale). area: between predicted and measured distribution functions, in the quantity's "
        "unit; u-area: of the pooled u-values, 0 (perfect) to 0.5.",
    )


def _error(quantity: Mapping[str, Any]) -> str:
    """Error in per cent, and its SD where there is one (files of before 0.3 have none)."""
    found, sd = quantity["error"], quantity.get("error_sd")
    error = number(None if found is None else 100 * found, 3)
    return error if sd is None else f"{error} ({number(100 * sd, 1)})"


def _per_cent(share: float | None) -> str:
    """Per cent of a share; a dash where what was measured is zero throughout."""
    return "-" if share is None else f"{100 * share:.1f}"


def _by_step(found: Mapping[str, Any]) -> Table:
    unit = "N" if found["control"] == "force" else "mm"
    columns = ("by", "quantity", *(f"{number(level, 3)} {unit}" for level in found["levels"]))
    rows = [
        (
            name,
            found["quantity"] if quantity == "answer" else f"u_{quantity} [mm]",
            *(
                f"{_per_cent(e)} ({number(a, 2)})"
                for e, a in zip(q["error_by_step"], q["area_by_step"], strict=True)
            ),
        )
        for name, one in found["predictions"].items()
        for quantity, q in one["quantities"].items()
    ]
    return Table(
        "Error in per cent by increment (in brackets: area metric in the quantity's unit)",
        columns,
        tuple(rows),
    )
