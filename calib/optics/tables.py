"""Lens calculations as text for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from calib.optics.published import Check
from calib.optics.search import Found


def checks_table(checks: Sequence[Check]) -> str:
    """Printed values beside those of their formulas and those reproduced."""
    head = ("table", "quantity", "printed", "by formula", "reproduced", "unit")
    rows = [
        (c.table, c.quantity, c.printed, c.shown(c.formula), c.shown(c.reproduced), c.unit)
        for c in checks
    ]
    return _aligned([head, *rows])


def warnings(checks: Sequence[Check]) -> Iterator[str]:
    """One sentence for every printed value that its formula does not give."""
    for check in checks:
        if not check.follows:
            value = f"{check.table}, {check.quantity}: printed {check.printed}, the formula with "
            value += f"the inputs as printed gives {check.shown(check.formula)}"
            yield f"{value} ({'not explained' if not check.is_reproduced else check.remark})"


def found_table(found: Sequence[Found]) -> str:
    """The best set-up of every lens, one line each."""
    head = (
        *("lens", "f mm", "tube mm", "distance mm", "f/", "half angle", "m"),
        *("field mm", "depth mm", "needed mm", "speckle mm", "points", "noise um", "usable"),
    )
    return _aligned([head, *(_row(one) for one in found)])


def verdicts(found: Sequence[Found]) -> Iterator[str]:
    """What each lens that meets not all limits is short of."""
    for one in found:
        if one.is_feasible:
            continue
        worst = ", ".join(f"{name} (need/have {ratio:.2f})" for name, ratio in one.misses)
        yield f"{one.lens}: none of {one.n_tried} set-ups is usable; the closest lacks {worst}"


def _row(found: Found) -> tuple[str, ...]:
    setup, seen = found.setup, found.seen
    return (
        found.lens,
        f"{setup.focal_length:g}",
        f"{found.tube:g}",
        f"{setup.object_distance:.0f}",
        f"{setup.f_stop:g}",
        f"{setup.half_angle:g}",
        f"{seen.magnification:.2f}",
        f"{seen.field_width:.1f} x {seen.field_height:.1f}",
        f"{seen.depth_of_field:.2f}",
        f"{seen.depth_needed:.2f}",
        f"{seen.speckle:.3f}",
        f"{seen.points:.0f}",
        f"{1000 * seen.in_plane_noise:.1f}, {1000 * seen.out_of_plane_noise:.1f}",
        "yes" if found.is_feasible else "no",
    )


def _aligned(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join(lines)
