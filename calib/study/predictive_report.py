"""What the report shows of the posterior predictive checks of a field."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calib.study.artifacts import read_npz
from calib.study.config import Study
from calib.study.predict_stage import maps_path
from calib.study.predictive_figures import face_maps, region_checks


def predictive_figures(
    predictive: Mapping[str, Any], study: Study, out: Path
) -> dict[str, tuple[Figure, str]]:
    """Figure and caption by name: maps and checks of the field under every hypothesis, if any.

    `predictive` is predictive.json of the study in `out`.
    """
    drawn: dict[str, tuple[Figure, str]] = {}
    travel = np.asarray(predictive["travel"])
    for hypothesis in study.hypotheses:
        name = hypothesis.name
        checks = predictive["hypotheses"][name]
        if "field" not in checks:
            continue
        maps = read_npz(maps_path(out, hypothesis))
        drawn[f"predictive_face_{name}"] = (
            face_maps(name, maps),
            f"Front face under {name}: correlation R over the increments and RMS error of the "
            "posterior mean at each point (thesis, Figures 5.9 to 5.12, appendices D and E).",
        )
        drawn[f"predictive_regions_{name}"] = (
            region_checks(name, travel, checks["field"]),
            f"Predictive p-value and coverage of the field under {name}, by increment and region; "
            "grey: errors unexplained (below) or stated too large (above).",
        )
    return drawn
