"""The report: self-contained, escapes what it is given, says failures and synthetic data aloud."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.study.report import Picture, Section, render, versions_table
from calib.study.tables import Table, number, percent, share_errors

PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de"
    "0000000c4944415408d763f8ffff3f0005fe02fea72d1e0b0000000049454e44ae426082"
)


def _render(tmp_path: Path, **changes: object) -> str:
    (tmp_path / "a.png").write_bytes(PIXEL)
    table = Table("Forces <N>", ("travel [mm]", "force [N]"), (("0.6", "0.9"),), "a note")
    content: dict[str, object] = {
        "study": "tried",
        "seed": 7,
        "synthetic": "",
        "failures": [],
        "unverified": [],
        "verdict": ["Both contact hypotheses describe the forces."],
        "sections": [
            Section("Forces", ("Text & more",), (table,), (Picture(tmp_path / "a.png", "c"),))
        ],
        "study_text": 'name = "tried"',
    }
    return render(**{**content, **changes})  # type: ignore[arg-type]


def test_the_report_refers_to_no_other_file(tmp_path: Path) -> None:
    html = _render(tmp_path)
    sources = re.findall(r'(?:src|href)="([^"]*)"', html)
    assert sources and all(source.startswith("data:image/png;base64,") for source in sources)


def test_text_is_escaped(tmp_path: Path) -> None:
    html = _render(tmp_path)
    assert "Forces &lt;N&gt;" in html and "Text &amp; more" in html and "<N>" not in html


def test_failures_replace_the_statement_that_all_is_well(tmp_path: Path) -> None:
    good, bad = _render(tmp_path), _render(tmp_path, failures=["stuck C10: R-hat 1.2 > 1.01"])
    assert "All diagnostics are within" in good and "do not rely" not in good
    assert "All diagnostics are within" not in bad and "R-hat 1.2 &gt; 1.01" in bad


def test_a_maximum_that_is_not_verified_takes_the_good_banner_away(tmp_path: Path) -> None:
    html = _render(tmp_path, unverified=["stuck: they lie 0.3 SD apart"])
    assert "<li>stuck: they lie 0.3 SD apart</li>" in html and "banner bad" in html
    assert "All diagnostics are within" not in html
    both = _render(tmp_path, failures=["R-hat"], unverified=["stuck: apart"])
    assert "do not rely" in both and "<li>stuck: apart</li>" in both


def test_synthetic_data_are_named_and_measured_data_are_not_called_so(tmp_path: Path) -> None:
    assert "synthetic data" not in _render(tmp_path).lower()
    assert "synthetic data" in _render(tmp_path, synthetic="Made on a finer mesh.").lower()


def test_versions_name_every_package_that_can_change_the_numbers() -> None:
    names = [row[0] for row in versions_table().rows]
    assert {"softcal", "Python", "numpy", "scikit-fem", "emcee"} <= set(names)


def test_a_table_refuses_rows_of_another_length() -> None:
    with pytest.raises(ValueError, match="expected 2 cells"):
        Table("t", ("a", "b"), (("1",),))


def test_a_table_in_text_is_aligned() -> None:
    lines = Table("t", ("name", "x"), (("a", "1.0"), ("long one", "10.0"))).text().splitlines()
    assert lines[4].endswith("1.0") and len(lines[4]) == len(lines[5])


def test_numbers_keep_their_digits_and_absent_ones_are_dashes() -> None:
    assert number(0.00123456, 3) == "0.00123"
    assert number(None) == number(float("nan")) == percent(None) == "-"
    assert number(0.0) == "0"
    assert percent(-0.0123) == "-1.23"


def test_errors_of_shares_of_evidence_are_those_of_drawn_evidences() -> None:
    """Two shares that add up to one have one error, whichever of the evidences it comes from."""
    log_evidence, errors = np.log([0.55, 0.3, 0.15]), np.array([1e-3, 0.02, 0.05])
    drawn = log_evidence + errors * np.random.default_rng(1).standard_normal((20_000, 3))
    shares = np.exp(drawn) / np.exp(drawn).sum(axis=1, keepdims=True)
    facts = [
        {"probability": p, "log_evidence_error": e}
        for p, e in zip(np.exp(log_evidence), errors, strict=True)
    ]
    assert share_errors(facts) == pytest.approx(shares.std(axis=0), rel=0.02)
    first, second = share_errors(
        [{"probability": p, "log_evidence_error": e} for p, e in ((0.6, 1e-3), (0.4, 0.3))]
    )
    assert first == pytest.approx(second) and first > 0.07
