"""Stage `report`: figures and report from the artifacts of all stages before, and closing words."""

from __future__ import annotations

from pathlib import Path

from calib.study.artifacts import write_bytes
from calib.study.context import Context
from calib.study.findings import read_findings, sections, synthetic_sentence
from calib.study.report import render
from calib.study.report_figures import draw
from calib.study.sample_stage import load_samples
from calib.study.study_file import study_text
from calib.study.summary import load_summary, unverified


def run(context: Context) -> list[Path]:
    """Draw the figures and write report.html; returns their paths."""
    study, out = context.study, context.out
    findings = read_findings(out, study, load_summary(out / "posterior.nc"))
    samples = {h.name: load_samples(out, h) for h in study.hypotheses}
    pictures = draw(findings, samples, study, out)
    html = render(
        study=study.name,
        seed=study.seed,
        synthetic=synthetic_sentence(findings.data),
        failures=findings.failures,
        unverified=unverified(findings.summaries),
        verdict=findings.comparison["verdict"],
        sections=sections(findings, pictures, study),
        study_text=study_text(study),
    )
    write_bytes(out / "report.html", html.encode())
    figures = out / "figures"
    drawn = [picture.path for picture in pictures.values() if picture.path.parent == figures]
    return [*drawn, out / "report.html"]
