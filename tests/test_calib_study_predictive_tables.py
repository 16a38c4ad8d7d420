"""Tables of the predictive checks."""

from __future__ import annotations

from typing import Any

from calib.study.predictive_tables import force_checks_table


def _checks(p_value: float) -> dict[str, Any]:
    return {"p_value": p_value, "relative": 0.01, "coverage": {"0.94": 1.0}}


def test_what_is_known_of_a_force_left_out_stands_beside_its_own_check() -> None:
    found = {
        "travel": [0.4, 0.8],
        "hypotheses": {
            "stuck": {"force": [_checks(0.6), _checks(0.5)], "force_left_out_p": [0.0123, None]},
            "allowing": {"force": [_checks(0.4), _checks(0.3)], "force_left_out_p": None},
            "before": {"force": [_checks(0.2), _checks(0.1)]},
        },
    }
    table = force_checks_table(found)
    assert [column for column in table.columns if column == "p left out"] == ["p left out"]
    place = table.columns.index("p left out")
    assert [row[place] for row in table.rows] == ["0.012", "-"]
    assert all(len(row) == len(table.columns) for row in table.rows)
    assert table.columns[place + 1] == "allowing: p" and table.rows[0][place + 1] == "0.40"
