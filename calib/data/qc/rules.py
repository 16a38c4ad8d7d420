"""Rules of a study that go before those of the laboratory's own `experiment.toml`."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from typing import Any

from pydantic.dataclasses import dataclass

from calib.data.qc.experiment_file import Count, Experiment, Positive, Share
from calib.toml_file.strict import STRICT


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Rules:
    """[data.quality] of a study: each key given replaces that of [quality] in experiment.toml."""

    max_angle_deg: Positive | None = None
    """largest angle of the face about the height (top view), degrees"""
    max_x_shift_mm: Positive | None = None
    """largest distance of pin and sample's centre along x, mm"""
    max_tilt_deg: Positive | None = None
    """largest angle of the face about its width, degrees"""
    max_roll_deg: Positive | None = None
    """largest angle of the face about its normal, degrees"""
    max_slack_mm: Positive | None = None
    """largest travel before contact, mm"""
    max_force_deviation: Positive | None = None
    """largest deviation of a force from the median of the samples, in robust SDs"""
    max_cycle_change_percent: Positive | None = None
    """largest change of peak force over the last preconditioning cycle, percent"""
    max_outlier_share: Share | None = None
    """largest share of points that are outliers"""
    min_points: Count | None = None
    """smallest number of points with a displacement in every frame used, a whole number"""
    min_points_share: Share | None = None
    """smallest number of points of half the face, as a share of the median of the samples"""

    def given(self) -> dict[str, Any]:
        """Those that the study has."""
        return {key: value for key, value in dataclasses.asdict(self).items() if value is not None}


def under_rules(experiment: Experiment, rules: Rules | None) -> Experiment:
    """The experiment with a study's rules in place of its own."""
    if rules is None:
        return experiment
    quality = dataclasses.replace(experiment.quality, **rules.given())
    return dataclasses.replace(experiment, quality=quality)


def inputs_under(inputs: str, rules: Rules | None) -> str:
    """Hash of the files and of a study's rules; without rules that of the files."""
    given = {} if rules is None else rules.given()
    if not given:
        return inputs
    return hashlib.sha256(f"{inputs} {json.dumps(given, sort_keys=True)}".encode()).hexdigest()
