"""What the report shows, as read from the artifacts of a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.study.artifacts import read_json
from calib.study.config import Study
from calib.study.mesh_error import check_folder
from calib.study.predict_stage import CHECKS
from calib.study.prior_stage import FACTS
from calib.study.refine_stage import REFINEMENT
from calib.study.summary import Summary
from calib.study.train_stage import DIAGNOSTICS


@dataclass(frozen=True)
class Findings:
    """Everything that is shown, as read from the artifacts of a study."""

    data: dict[str, Any]
    mesh: dict[str, Any]
    """hypothesis -> mesh_error.json"""
    diagnostics: dict[str, Any]
    """hypothesis -> its part of diagnostics.json"""
    refinement: dict[str, Any]
    """hypothesis -> its part of refinement.json"""
    maps: dict[str, Any]
    comparison: dict[str, Any]
    predictive: dict[str, Any]
    """predictive.json"""
    prior: dict[str, Any]
    """hypothesis -> its part of prior_predictive.json"""
    summaries: tuple[Summary, ...]

    @property
    def failures(self) -> list[str]:
        """Diagnostics outside the limits of the study, one sentence each."""
        return [f"{s.hypothesis}: {failure}" for s in self.summaries for failure in s.failures]


def read_findings(out: Path, study: Study, summaries: Sequence[Summary]) -> Findings:
    """Read the artifacts of a finished study; raises ValueError naming a damaged one."""
    return Findings(
        data=read_json(out / "data.json"),
        mesh={
            h.name: read_json(check_folder(out, h) / "mesh_error.json") for h in study.hypotheses
        },
        diagnostics=read_json(out / DIAGNOSTICS),
        refinement=read_json(out / REFINEMENT),
        maps=read_json(out / "map.json"),
        comparison=read_json(out / "comparison.json"),
        predictive=read_json(out / CHECKS),
        prior=read_json(out / FACTS),
        summaries=tuple(summaries),
    )
