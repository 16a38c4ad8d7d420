"""The thesis' lens tables come out to every printed digit, and what contradicts them is named."""

from __future__ import annotations

from dataclasses import replace

from calib.data.thesis import thesis_table
from calib.optics.published import Check, published_checks
from calib.optics.published_limits import published_limits
from calib.optics.tables import checks_table, warnings


def test_every_printed_digit_of_tables_3_3_3_4_and_a_2_is_reproduced() -> None:
    checks = published_checks()
    assert [(c.table, c.quantity) for c in checks if not c.is_reproduced] == []
    by_table = {name: [c for c in checks if c.table == name] for name in {c.table for c in checks}}
    assert len(by_table["Table 3.3"]) == 8
    assert len(by_table["Table 3.4"]) == len(thesis_table("Table 3.4").cells("property"))
    inputs = {"d", "FL", "OD", "F_stop", "AR"}
    computed = set(thesis_table("Appendix A.2").cells("symbol")) - inputs
    assert {c.quantity for c in by_table["Appendix A.2"]} == computed


def test_printed_values_that_their_formula_does_not_give_are_these() -> None:
    off = {(c.table, c.quantity): c for c in published_checks() if not c.follows}
    lenses = [f"lens set {i}, {x}" for i in (1, 3, 4) for x in ("depth of field", "field of view")]
    pixels = ["Pixel Width", "Number of Pixels in Width", "Number of Pixels in Height"]
    assert set(off) == {
        *(("Table 3.3", name) for name in lenses),
        *(("Appendix A.2", name) for name in ("phi", "A", "B", "P_x", "NP_x", "NP_y")),
        *(("Table 3.4", name) for name in ("phi", *pixels, "Depth of Sample in Undeformed State")),
    }
    assert all(check.remark for check in off.values())


def test_values_by_formula_are_those_in_the_notes_of_the_tables() -> None:
    def by_formula(table: str, quantity: str) -> float:
        checks = {(c.table, c.quantity): c.formula for c in published_checks()}
        return checks[table, quantity]

    notes = " ".join(thesis_table("Table 3.3").notes)
    for lens in (1, 3, 4):
        depth = by_formula("Table 3.3", f"lens set {lens}, depth of field")
        field = by_formula("Table 3.3", f"lens set {lens}, field of view")
        assert f"{depth:.2f} and {field:.2f} mm" in notes
    notes = " ".join(thesis_table("Table 3.4").notes)
    assert f"{by_formula('Table 3.4', 'Number of Pixels in Height'):.1f}" in notes
    assert f"{by_formula('Table 3.4', 'Number of Pixels in Width'):.1f}" in notes
    assert f"is {by_formula('Table 3.4', 'phi'):.1f} degrees" in notes
    assert f"gives {by_formula('Appendix A.2', 'B'):.1f} mm" in notes
    assert f"A = {by_formula('Appendix A.2', 'A'):.1f} mm" in thesis_table("Appendix A.2").notes[2]


def test_a_check_compares_printed_digits_and_cuts_where_the_thesis_cuts() -> None:
    check = Check("T", "q", "796", "pixels", formula=796.6, reproduced=796.4)
    assert not check.follows
    assert check.is_reproduced
    assert replace(check, is_cut=True).follows


def test_remarks_on_the_published_setup_carry_its_numbers() -> None:
    far, circle, diffraction = published_limits()
    assert "40.0 mm, the thin lens 34.0 mm" in far
    assert "11.02 mm" in circle
    assert "13.7 pixels" in diffraction  # 2.44 * 0.55 um * 30 * (1 + 75/425) / 3.45 um


def test_warnings_name_table_value_and_reason() -> None:
    checks = published_checks()
    said = list(warnings(checks))
    assert len(said) == sum(not check.follows for check in checks)
    assert any("lens set 3" in line and "180" in line and "108 mm" in line for line in said)
    assert len(checks_table(checks).splitlines()) == len(checks) + 1
