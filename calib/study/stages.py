"""A study from data to report: stages in order, each skipped when its artifacts are up to date."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypedDict, Unpack

from threadpoolctl import threadpool_limits

from calib import __version__
from calib.study import findings, map_stage, simulate_stage, train_report, verification
from calib.study.artifacts import (
    NEEDED,
    StageRecord,
    clear_begun,
    hash_of,
    hash_of_file,
    mark_begun,
    outdated,
    read_record,
    why_stale,
    write_record,
)
from calib.study.config import Study
from calib.study.context import Context, SimulateFactory, block_pin_model
from calib.study.executor_choice import chosen_map
from calib.study.stage_list import STAGES, Stage, stages_of
from calib.study.study_file import STUDY_FILE, write_study
from calib.study.summary import Summary, load_summary
from fe.executors import MapFn


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


class HowToRun(TypedDict, total=False):
    """How the work of a study is done; results depend on `simulate_factory` alone."""

    workers: int | None
    """processes for the simulations (default: as the study says; 0: one a core)"""
    executor: str
    """one of `calib.study.executor_choice.EXECUTORS`; processes where it is not given"""
    scheduler: str | None
    """address or file of a Dask scheduler"""
    echo: Callable[[str], None]
    """is told every line; default `print`"""
    show_progress: bool
    """whether bars are drawn on the terminal; default True"""
    simulate_factory: SimulateFactory
    """builds the forward model of a hypothesis on a mesh; for other models and for tests"""
    map_fn: MapFn | None
    """replaces the executor; for tests"""


def run_stages(context: Context, until: str = "report") -> tuple[str, ...]:
    """Run what is not up to date of what `until` needs; returns the names of those that ran.

    Where direct FE contradicts an emulator's maximum, the stages from `refine` on run again, as
    `calib.study.verification` says.
    Raises StudyError for a study that cannot be run, Contradiction where synthetic data exclude it.
    """
    write_study(context.out / STUDY_FILE, context.study)
    stages = stages_of(context.study, until)
    names = [stage.name for stage in stages]
    digests: dict[str, str] = {}
    ran: dict[str, None] = {}
    base = ""
    index = 0
    while index < len(stages):
        stage = stages[index]
        inputs = stage.inputs(context)
        inputs |= {f"{NEEDED}{name}": digests[name] for name in stage.needs if name in digests}
        if stage.name == "refine":
            base = _base(context, inputs)
            verification.drop_foreign(context, base)
            inputs |= {name: hash_of(v) for name, v in verification.inputs(context).items()}
        record, reason = why_stale(context.out, stage.name, inputs, __version__)
        if record is not None and not reason:
            context.echo(f"{stage.name:<10} up to date")
            clear_begun(context.out, stage.name)
        else:
            context.echo(f"{stage.name:<10} {stage.title} ({reason})")
            record = _run_stage(context, stage, inputs)
            ran[stage.name] = None
        digests[stage.name] = record.digest()
        index += 1
        if stage.name == "map" and map_stage.add_round(context, base):
            index = names.index("refine")
    return tuple(ran)


def _base(context: Context, inputs: dict[str, str]) -> str:
    """Hash of all that the first maximum is made from: `inputs` of refine, and what comes after."""
    after = {s.name: s.inputs(context) for s in STAGES if s.name in ("check", "sample", "map")}
    return hash_of([inputs, after])


def _run_stage(context: Context, stage: Stage, inputs: dict[str, str]) -> StageRecord:
    start = time.perf_counter()
    mark_begun(context.out, stage.name)
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


def report_again(context: Context) -> list[Path]:
    """Draw the report once more, with what was asked since; returns its path, if there was one.

    Not where a part of it is another run's, as of a run that was stopped after the posterior.
    """
    record = read_record(context.out, "report")
    if record is None:
        return []
    [stage] = [stage for stage in STAGES if stage.name == "report"]
    wanted = {one.name for one in stages_of(context.study)}
    for name in (name for name in stage.needs if name in wanted):
        if changed := outdated(context.out, name):
            file, out = (shlex.quote(str(path)) for path in (context.out / STUDY_FILE, context.out))
            state = (
                "begun again and not finished" if changed == name else f"before the last {changed}"
            )
            context.echo(
                f"report.html is not drawn again: stage {name} was {state}; "
                f"`calib run {file} --out {out}` makes both anew"
            )
            return []
    found = stage.settings(context)
    added = {name: hash_of(found[name]) for name in ("validations", "answers") if name in found}
    _run_stage(context, stage, record.inputs | added)
    return [context.out / "report.html"]


def run_study(study: Study, out: Path, **how: Unpack[HowToRun]) -> StudyResult:
    """Run a study into the folder `out`, going on where an earlier run stopped.

    Raises StudyError for a study that cannot be run, `calib.toml_file.Contradiction` for one that
    its synthetic data exclude, ValueError for an executor that there is not,
    `fe.campaign.CampaignFailed` when too many simulations fail, `fe.executors.WorkerDied` when a
    worker does, `calib.study.train_report.EmulatorRefused` when an emulator violates the limits.
    """
    with _context(study, Path(out), how) as context:
        ran = run_stages(context)
        out = context.out
    summaries = load_summary(out / "posterior.nc")
    for line in findings.closing_lines(out, study, summaries):
        context.echo(line)
    return StudyResult(
        out=out,
        posterior=out / "posterior.nc",
        report=out / "report.html",
        figures=tuple(sorted((out / "figures").glob("*.png"))),
        summaries=tuple(summaries),
        ran=ran,
    )


def run_part(
    study: Study, out: Path, until: Literal["simulate", "train"], **how: Unpack[HowToRun]
) -> tuple[str, ...]:
    """Run one stage and what it needs, and say what came out: tables and the paths of plots.

    Returns the limits of the study that are violated, one sentence each. `run_study` goes on from
    here. Raises what `run_study` raises.
    """
    with _context(study, Path(out), how) as context:
        ran = run_stages(context, until)
    failures: tuple[str, ...] = ()
    if until == "simulate":
        lines = simulate_stage.closing_lines(context, until in ran)
    else:
        lines, failures = train_report.closing_lines(context.out, study)
    for line in lines:
        context.echo(line)
    return failures


@contextmanager
def _context(study: Study, out: Path, how: HowToRun) -> Iterator[Context]:
    out.mkdir(parents=True, exist_ok=True)
    workers = how.get("workers")
    with ExitStack() as stack:
        # Threads of BLAS share the cores with the workers, and sums of more come in another order.
        stack.enter_context(threadpool_limits(limits=1))
        map_fn = how.get("map_fn") or stack.enter_context(
            chosen_map(
                how.get("executor", "processes"),
                study.compute.workers if workers is None else workers,
                how.get("scheduler"),
            )
        )
        yield Context(
            study=study,
            out=out,
            simulate_factory=how.get("simulate_factory", block_pin_model),
            map_fn=map_fn,
            echo=how.get("echo", print),
            show_progress=how.get("show_progress", True),
        )
