"""What is refused of a study for the data that it has, each in one sentence."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import chi2

from calib.study.data_sections import VIRTUAL
from calib.study.data_source import measured_dataset
from calib.study.population_checks import SAMPLES, check_level
from calib.study.unknown_checks import section_of
from calib.study.unknowns import given, least_height
from calib.toml_file.refusal import Contradiction
from fe.response import Array

if TYPE_CHECKING:
    from calib.study.config import Study

SAME_TRAVEL = 1e-6  # mm, within which an increment and a measured travel are the same
CHANCE = 0.01
"""of refusing noise of the load cell that is as stated"""
OTHER_SIZE = 0.2
"""share by which a block may be of another size than that of the experiment, whose 2.5 mm may well
have been 2.7"""


def check_against_data(study: Study) -> None:
    """Raise Contradiction for increments that were not measured and noise that the data exclude.

    Synthetic data come later. Raises ValueError for a data file that cannot be read.
    """
    if study.data.source == VIRTUAL:
        return
    measured = measured_dataset(study.data)
    check_level(study.data, measured)
    if study.data.folder is not None:
        _check_specimen(study, Path(study.data.folder))
    if measured.field is not None:
        _check_places(study, measured.field.points)
    spread = []
    for index, travel in enumerate(study.increments):
        nearest = int(np.argmin(np.abs(measured.travel - travel)))
        if abs(measured.travel[nearest] - travel) > SAME_TRAVEL:
            known = ", ".join(f"{value:g}" for value in measured.travel)
            expected = f"a travel that was measured: {known} mm"
            raise Contradiction(f"increments.{index}", travel, expected)
        spread.append(float(measured.force_sd[nearest]))
    if measured.force_covariance is not None:
        if study.noise.correlation_study:
            expected = "no values: the correlation of the forces is measured"
            found = list(study.noise.correlation_study)
            raise Contradiction("noise.correlation_study", found, expected)
        if study.data.level == SAMPLES:
            _check_each_sample(study, min(spread), measured.n_samples)
        return
    check_load_cell(study, min(spread))


def check_load_cell(study: Study, least: float) -> None:
    """Raise Contradiction for noise of the load cell not below the `least` SD between samples, N.

    That SD contains the noise, and what is left of it is the samples' own.
    """
    if study.noise.load_cell_sd >= least:
        expected = f"less than the smallest SD between samples, {least:g} N in the data (if these "
        expected += "are in N), a part of it"
        raise Contradiction("noise.load_cell_sd", study.noise.load_cell_sd, expected)


def _check_each_sample(study: Study, least: float, n: int) -> None:
    """Raise Contradiction for noise of one sample's force that their scatter makes unlikely.

    `least` is the smallest SD [N] of n samples over the increments; noise alone is as small by
    chance in `CHANCE` of all sets.
    """
    p = CHANCE / len(study.increments)
    most = least * math.sqrt((n - 1) / float(chi2.ppf(p, n - 1)))
    if study.noise.load_cell_sd > most:
        expected = f"at most {most:.3g} N, of which the smallest SD between {n} samples, {least:g} "
        expected += "N (if forces are in N), might be a part by chance"
        raise Contradiction("noise.load_cell_sd", study.noise.load_cell_sd, expected)


def _check_specimen(study: Study, folder: Path) -> None:
    """Refuse a block that is not about as large as the one that the experiment says."""
    from calib.data.qc import FILE, read_experiment  # readers are loaded where they are needed only

    block = read_experiment(folder).specimen
    sizes = [
        ("geometry.width", study.geometry.width, "width_mm"),
        ("geometry.depth", study.geometry.depth, "depth_mm"),
    ]
    for index, hypothesis in enumerate(study.hypotheses):
        if given(study, hypothesis, "height") is None:
            key = "geometry.height" if hypothesis.height is None else f"hypothesis.{index}.height"
            sizes.append((key, study.height(hypothesis), "height_mm"))
    for key, size, name in sizes:
        measured = getattr(block, name)
        if not abs(size / measured - 1.0) <= OTHER_SIZE:
            expected = f"about {measured:g} mm, specimen.{name} of {folder / FILE}"
            raise Contradiction(key, size, expected)


def _check_places(study: Study, points: Array) -> None:
    """Refuse a block that does not reach as far as the points that were measured on it.

    And a pin off the centre: the measured field is the mean of both halves, counted from the pin.
    """
    expected = "{} beside a measured field, whose halves are averaged about the pin"
    for index, hypothesis in enumerate(study.hypotheses):
        if given(study, hypothesis, "pin_shift") is not None:
            raise Contradiction(section_of(study, index, "pin_shift"), {}, expected.format("none"))
    if study.geometry.pin_shift != 0.0:
        shift = study.geometry.pin_shift
        raise Contradiction("geometry.pin_shift", shift, expected.format("0"))
    right, top = points.max(axis=0)
    if right > study.geometry.width / 2:
        expected = f"{2 * right:g} mm or more, as wide as the points that were measured"
        raise Contradiction("geometry.width", study.geometry.width, expected)
    for index, hypothesis in enumerate(study.hypotheses):
        lowest = least_height(study, hypothesis)
        if top > lowest:
            key = "geometry.height" if hypothesis.height is None else f"hypothesis.{index}.height"
            if lowest != study.height(hypothesis):
                key = f"{section_of(study, index, 'height')}.low"
            expected = f"{top:g} mm or more, as high as the points that were measured"
            raise Contradiction(key, lowest, expected)
