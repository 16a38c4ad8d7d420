"""The table of laws in the document of the thesis is the file that its command made."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LAWS = json.loads((ROOT / "docs/verification/thesis_laws.json").read_text())["laws"]
NAMES = {
    "neo-Hookean": "neo-hookean",
    "Ogden (1)": "ogden-1",
    "Mooney-Rivlin 2": "mooney-rivlin-2",
    "Mooney-Rivlin 3": "mooney-rivlin-3",
    "Yeoh": "yeoh",
}


def rows() -> dict[str, list[str]]:
    """Cells of the table's rows by hypothesis."""
    text = (ROOT / "docs/the-thesis-revisited.md").read_text()
    section = text[text.index("## Which law") :]
    lines = [line.strip("| ").split(" | ") for line in section.splitlines() if line[:2] == "| "]
    found = {}
    for cells in lines[1 : 1 + len(LAWS)]:
        law, contact = cells[0].split(", ")
        found[f"{contact}-{NAMES[law]}"] = cells[1:]
    return found


def test_the_table_has_the_laws_of_the_study_in_the_order_of_their_evidence() -> None:
    study = tomllib.loads((ROOT / "benchmarks/thesis_laws.toml").read_text())
    assert list(rows()) == list(LAWS)
    assert {hypothesis["name"] for hypothesis in study["hypothesis"]} == set(LAWS)


@pytest.mark.parametrize("name", list(LAWS))
def test_each_row_says_what_the_file_says(name: str) -> None:
    evidence, nested, best, p, _, mu, too_stiff, _ = rows()[name]
    found = LAWS[name]
    assert evidence == f"{found['ln_evidence'][0]:.2f}"
    assert nested == f"{found['ln_evidence_nested'][0]:.2f} ± {found['ln_evidence_nested'][1]:.2f}"
    assert float(best) == pytest.approx(found["ln_likelihood_at_best"], rel=0.02, abs=0.06)
    assert float(p) == pytest.approx(found["predictive_p"], rel=0.1)
    assert mu == f"{found['mu_MPa'][0]:.4f} ± {found['mu_MPa'][1]:.4f}"
    assert too_stiff == f"{found['too_stiff'][0]:.1f} ± {found['too_stiff'][1]:.1f}"
    # Two ways to the evidence, the one with its error.
    off = found["ln_evidence"][0] - found["ln_evidence_nested"][0]
    assert abs(off) < 4.0 * found["ln_evidence_nested"][1]
