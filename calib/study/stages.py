"""A study from data to report: stages in order, each skipped when its artifacts are up to date."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path

from calib import __version__
from calib.study import (
    check_stage,
    compare_stage,
    map_stage,
    posterior_stage,
    refine_stage,
    report_stage,
    sample_stage,
    simulate_stage,
    train_stage,
    virtual_stage,
)
from calib.study.artifacts import (
    StageRecord,
    hash_of,
    hash_of_file,
    plain,
    why_stale,
    write_record,
)
from calib.study.config import Study, StudyError
from calib.study.context import Context, SimulateFactory, block_pin_model, fingerprint
from calib.study.sections import Compute
from calib.study.study_file import write_study
from calib.study.summary import Summary, load_summary
from fe.executors import MapFn, process_map

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


@dataclass(frozen=True)
class StudyResult:
    """Where a finished study is, and what it found."""

    out: Path
    posterior: Path
    report: Path
    figures: tuple[Path, ...]
    summaries: tuple[Summary, ...]
    """one for each hypothesis"""
    ran: tuple[str, ...]
    """stages that had to run; the others were up to date"""

    @property
    def passed(self) -> bool:
        """Whether the diagnostics of every hypothesis are within the limits of the study."""
        return all(summary.passed for summary in self.summaries)


def _sections(*names: str) -> Settings:
    """Inputs that are sections or keys of the study file."""

    def settings(context: Context) -> dict[str, object]:
        return {name: plain(attrgetter(name)(context.study)) for name in names}

    return settings


def _data(context: Context) -> dict[str, object]:
    """The data by what they are: a file by its content, not its name."""
    settings = _sections("increments", "data", "virtual")(context)
    source = Path(context.study.data.source)
    if context.study.data.is_file and source.is_file():
        settings["content"] = hash_of_file(source)
    return settings


def _models(*names: str) -> Settings:
    """The forward models on the sampling mesh by all their fields, and sections."""

    def settings(context: Context) -> dict[str, object]:
        hypotheses = context.study.hypotheses
        models = {h.name: fingerprint(context.sampling_model(h)) for h in hypotheses}
        return {"forward model": models, **_sections(*names)(context)}

    return settings


def _whole_study(context: Context) -> dict[str, object]:
    return {**_models()(context), "study": plain(replace(context.study, compute=Compute()))}


_DESIGN = ("prior.r", "prior.s", "design", "seed")

STAGES = (
    Stage(
        "virtual",
        "make the synthetic experiment on a finer mesh",
        (),
        _models("virtual", "noise", "seed"),
        virtual_stage.run,
    ),
    Stage("data", "read the data", ("virtual",), _data, virtual_stage.run_data),
    Stage("simulate", "run the FE model", (), _models(*_DESIGN), simulate_stage.run_design),
    Stage(
        "train",
        "train the emulators",
        ("simulate",),
        _sections("design", "emulator", "seed"),
        train_stage.run,
    ),
    Stage(
        "refine",
        "add FE runs where the posterior is",
        ("data", "simulate", "train"),
        _models("design", "emulator", "noise", "prior", "seed"),
        refine_stage.run,
    ),
    Stage(
        "check",
        "measure the error of the mesh at the posterior",
        ("refine",),
        _models("mesh.check"),
        check_stage.run,
    ),
    Stage(
        "sample",
        "sample the posterior",
        ("data", "check", "refine"),
        _sections("noise", "prior", "sampler", "seed"),
        sample_stage.run,
    ),
    Stage(
        "map",
        "find the maximum with emulator and FE model",
        ("data", "check", "refine", "sample"),
        _models("noise", "prior", "seed"),
        map_stage.run,
    ),
    Stage(
        "posterior",
        "keep the posterior with its provenance",
        ("data", "check", "refine", "sample", "map"),
        _sections("name", "seed", "sampler", "emulator"),
        posterior_stage.run,
    ),
    Stage(
        "compare",
        "compare the hypotheses",
        ("data", "check", "refine", "sample", "map"),
        _sections("noise", "prior", "hypotheses"),
        compare_stage.run,
    ),
    Stage(
        "report",
        "draw the figures and write the report",
        ("posterior", "compare", "check", "refine", "map"),
        _whole_study,
        report_stage.run,
    ),
)


def stages_of(study: Study, until: str = "report") -> tuple[Stage, ...]:
    """The stages of a study in order, up to and with `until`; raises StudyError when unknown."""
    names = [stage.name for stage in STAGES]
    if until not in names:
        raise StudyError(f"stage: found {until!r}, expected one of {', '.join(names)}")
    chosen = STAGES[: names.index(until) + 1]
    return tuple(s for s in chosen if s.name != "virtual" or study.virtual is not None)


def run_stages(context: Context, until: str = "report") -> tuple[str, ...]:
    """Run what is not up to date, up to the stage `until`; returns the names of those that ran.

    Raises StudyError for a study that cannot be run.
    """
    write_study(context.out / "study.toml", context.study)
    digests: dict[str, str] = {}
    ran = []
    for stage in stages_of(context.study, until):
        inputs = {name: hash_of(v) for name, v in stage.settings(context).items()}
        inputs |= {f"stage {name}": digests[name] for name in stage.needs if name in digests}
        record, reason = why_stale(context.out, stage.name, inputs, __version__)
        if record is not None and not reason:
            context.echo(f"{stage.name:<10} up to date")
        else:
            context.echo(f"{stage.name:<10} {stage.title} ({reason})")
            record = _run_stage(context, stage, inputs)
            ran.append(stage.name)
        digests[stage.name] = record.digest()
    return tuple(ran)


def _run_stage(context: Context, stage: Stage, inputs: dict[str, str]) -> StageRecord:
    start = time.perf_counter()
    paths = stage.run(context)
    record = StageRecord(
        stage=stage.name,
        version=__version__,
        seed=context.study.seed,
        inputs=inputs,
        outputs={
            path.relative_to(context.out).as_posix(): hash_of_file(path) for path in sorted(paths)
        },
        seconds=time.perf_counter() - start,
    )
    write_record(context.out, record)
    return record


def run_study(
    study: Study,
    out: Path,
    *,
    workers: int | None = None,
    echo: Callable[[str], None] = print,
    show_progress: bool = True,
    simulate_factory: SimulateFactory = block_pin_model,
    map_fn: MapFn | None = None,
) -> StudyResult:
    """Run a study into the folder `out`, going on where an earlier run stopped.

    `workers` processes run the simulations (default: as the study says; 0: one a core); results do
    not depend on it. `simulate_factory` builds the forward model of a hypothesis on a mesh, and
    `map_fn` replaces the processes; both are for other models and for tests.
    Raises StudyError for a study that cannot be run, `fe.campaign.CampaignFailed` when too many
    simulations fail.
    """
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    n_workers = study.compute.workers if workers is None else workers
    context = Context(
        study=study,
        out=out,
        simulate_factory=simulate_factory,
        map_fn=map_fn or process_map(n_workers),
        echo=echo,
        show_progress=show_progress,
    )
    ran = run_stages(context)
    summaries = load_summary(out / "posterior.nc")
    for line in report_stage.closing_lines(out, study, summaries):
        echo(line)
    return StudyResult(
        out=out,
        posterior=out / "posterior.nc",
        report=out / "report.html",
        figures=tuple(sorted((out / "figures").glob("*.png"))),
        summaries=tuple(summaries),
        ran=ran,
    )
