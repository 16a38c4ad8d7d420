"""The stages of a study in order: what each depends on, and what it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path

from calib.code_hash import code_hash
from calib.data.qc.experiment_file import read_experiment
from calib.data.qc.lab_files import input_hash, sample_files
from calib.study import (
    check_stage,
    compare_stage,
    hierarchical_stage,
    map_stage,
    posterior_stage,
    predict_stage,
    prior_stage,
    refine_stage,
    report_stage,
    sample_stage,
    simulate_stage,
    train_stage,
    virtual_stage,
)
from calib.study.answers import answer_files
from calib.study.artifacts import CONTENT, hash_of, hash_of_file, plain
from calib.study.config import Study, StudyError
from calib.study.context import Context
from calib.study.findings import validation_files
from calib.study.run_identity import run_identity
from calib.study.unknowns import by_constants, design_box, design_points, parameters_of
from calib.study.work_sections import Compute
from fe.campaign_parameters import RATIOS

CODE = "surrogate", "calib.inference", "calib.study"
"""packages whose modules decide what stages after the FE runs write"""
Settings = Callable[[Context], dict[str, object]]


@dataclass(frozen=True)
class Stage:
    """One step of a study."""

    name: str
    title: str
    """what it does, for the terminal"""
    needs: tuple[str, ...]
    """earlier stages whose artifacts it reads"""
    settings: Settings
    """what it depends on besides: parts of the study file, the forward models"""
    run: Callable[[Context], list[Path]]
    """does the work and returns the files written"""
    code: tuple[str, ...] = CODE
    """packages whose change makes it run again, besides what `settings` counts of the FE code"""

    def inputs(self, context: Context) -> dict[str, str]:
        """Hash of each input by name, but for the artifacts of earlier stages."""
        inputs = {name: hash_of(value) for name, value in self.settings(context).items()}
        return inputs | {f"code of {package}": code_hash(package) for package in self.code}


def _sections(*names: str) -> Settings:
    """Inputs that are sections or keys of the study file."""

    def settings(context: Context) -> dict[str, object]:
        found = {name: plain(attrgetter(name)(context.study)) for name in names}
        if "noise" in found:  # but for a table of the stage `compare` alone
            found["noise"].pop("correlation_study")
        return found

    return settings


def _data(context: Context) -> dict[str, object]:
    """The data by what they are: files by their name and content, not by where they are."""
    settings = _sections("increments", "data", "virtual")(context)
    data, known = context.study.data, plain(context.study.data)
    source = Path(data.source)
    if data.is_file and source.is_file():
        known["source"] = source.name
        settings[CONTENT] = hash_of_file(source)
    if data.folder is not None:
        folder = Path(data.folder)
        known["folder"] = folder.name
        settings[CONTENT] = input_hash(folder, sample_files(folder, read_experiment(folder)))
    return settings | {"data": known}


def _training(context: Context) -> dict[str, object]:
    """The data too: errors are told as shares of their noise."""
    return {**_data(context), **_sections("design", "emulator", "seed")(context)}


def _models(*names: str) -> Settings:
    """The forward models on the sampling mesh by all their fields, and sections."""

    def settings(context: Context) -> dict[str, object]:
        hypotheses = context.study.hypotheses
        models = {h.name: run_identity(context.sampling_model(h)) for h in hypotheses}
        return {"forward model": models, **_sections(*names)(context)}

    return settings


def _refined(context: Context) -> dict[str, object]:
    """The finer meshes too: runs on them move the posterior, and with it the runs to come."""
    settings = _models("design", "emulator", "hypotheses", "noise", "prior", "seed")
    return {**settings(context), "check": _checked(context)["check"]}


def _checked(context: Context) -> dict[str, object]:
    """The forward models and the finer meshes that they are held against."""
    study = context.study
    cells = {h.name: plain(study.check_cells(h)) for h in study.hypotheses}
    check = {"cells": cells, "stiffening": study.mesh.check_stiffening}
    return {**_models()(context), "check": check}


def _check_of_posterior(context: Context) -> dict[str, object]:
    """What the posteriors are by, too: whether their boxes hold them is looked at."""
    return {**_checked(context), **_sections("hypotheses", "noise", "prior")(context)}


def _study(context: Context) -> dict[str, object]:
    """All of the study file that may change results: it is kept beside them."""
    return {"study": plain(replace(context.study, compute=Compute()))}


def _whole_study(context: Context) -> dict[str, object]:
    """What was asked of the study too, where something was: the report shows it."""
    found = {**_models()(context), **_study(context)}
    files = {"validations": validation_files(context.out), "answers": answer_files(context.out)}
    return found | {
        name: [hash_of_file(path) for path in paths] for name, paths in files.items() if paths
    }


def _design(context: Context) -> dict[str, object]:
    """The forward models, the design and the box that it is in."""
    found = _models("prior.r", "prior.s", "design", "seed")(context)
    study = context.study
    boxes = {
        h.name: plain(design_box(study, h))
        for h in study.hypotheses
        if parameters_of(study, h) != RATIOS or by_constants(study, h)
    }
    # What follows from priors other than the study's of r and s is told by the points themselves.
    points = {
        h.name: plain(design_points(study, h))
        for h in study.hypotheses
        if h.prior is not None or study.design.shape == "prior"
    }
    added = {"box": boxes, "points": points}
    return found | {name: own for name, own in added.items() if own}


STAGES = (
    Stage(
        "virtual",
        "make the synthetic experiment on a finer mesh",
        (),
        _models("virtual", "noise", "seed"),
        virtual_stage.run,
        ("calib.virtual", "calib.inference", "calib.study"),
    ),
    Stage(
        "data",
        "read the data",
        ("virtual",),
        _data,
        virtual_stage.run_data,
        ("calib.data", "calib.study"),
    ),
    Stage("simulate", "run the FE model", (), _design, simulate_stage.run_design, ()),
    Stage(
        "train",
        "train the emulators",
        ("simulate",),
        _training,
        train_stage.run,
        (*CODE, "calib.data"),
    ),
    Stage(
        "prior",
        "say what the priors expect of the forces",
        ("data", "train"),
        _sections("hypotheses", "noise", "prior", "material", "geometry", "seed"),
        prior_stage.run,
    ),
    Stage(
        "refine",
        "add FE runs where the posterior is",
        ("data", "simulate", "train"),
        _refined,
        refine_stage.run,
    ),
    Stage(
        "check",
        "measure the error of the mesh at the posterior",
        ("data", "refine"),
        _check_of_posterior,
        check_stage.run,
    ),
    Stage(
        "sample",
        "sample the posterior",
        ("data", "check", "refine"),
        _sections("hypotheses", "noise", "prior", "sampler", "seed"),
        sample_stage.run,
    ),
    Stage(
        "map",
        "find the maximum with emulator and FE model",
        ("data", "check", "refine", "sample"),
        _models("hypotheses", "noise", "prior", "seed"),
        map_stage.run,
    ),
    Stage(
        "compare",
        "compare the hypotheses",
        ("data", "check", "refine", "sample", "map"),
        _sections("noise", "noise.correlation_study", "prior", "hypotheses"),
        compare_stage.run,
    ),
    Stage(
        "posterior",
        "keep the posterior with its provenance",
        ("data", "check", "refine", "sample", "map", "compare"),
        _study,
        posterior_stage.run,
    ),
    Stage(
        "population",
        "sample the population and all its samples",
        ("data", "check", "refine", "sample"),
        _sections("hypotheses", "noise", "prior", "population", "sampler", "seed"),
        hierarchical_stage.run,
    ),
    Stage(
        "predict",
        "hold the data against their predictive distribution",
        ("data", "check", "refine", "sample"),
        _sections("geometry", "hypotheses", "seed"),
        predict_stage.run,
    ),
    Stage(
        "report",
        "draw the figures and write the report",
        ("posterior", "population", "compare", "predict", "check", "refine", "map", "prior"),
        _whole_study,
        report_stage.run,
    ),
)


def stages_of(study: Study, until: str = "report") -> tuple[Stage, ...]:
    """The stages that `until` needs and itself, in order; raises StudyError when unknown."""
    names = [stage.name for stage in STAGES]
    if until not in names:
        raise StudyError(f"stage: found {until!r}, expected one of {', '.join(names)}")
    needed = {until}
    for stage in reversed(STAGES):
        if stage.name in needed:
            needed |= set(stage.needs)
    wanted = {
        "virtual": study.virtual is not None,
        "population": hierarchical_stage.is_wanted(study),
    }
    return tuple(s for s in STAGES if s.name in needed and wanted.get(s.name, True))
