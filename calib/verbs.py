"""What each verb of the command does; each returns an exit code.

Heavy modules are imported by the verb that needs them, so that `calib --help` answers at once.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calib.folders import check_folder, check_writable, held_alone, make_folder

if TYPE_CHECKING:
    from calib.study.summary import Summary

FAILED = 1
POSTERIOR = "posterior.nc"


def say(line: str) -> None:
    """Print a line at once, also into a pipe."""
    print(line, flush=True)


def _check_own_file(out: Path, name: str) -> None:
    """Raise ValueError where a run would write over a file of the user or over another study."""
    from calib.study.study_file import OWN, STUDY_FILE, name_in

    copy = out / STUDY_FILE
    if not copy.is_file():
        return
    if not copy.read_bytes().startswith(OWN.encode()):
        raise ValueError(
            f"--out: found {out}, whose {STUDY_FILE} no run has written and this one would write "
            "over, expected another folder"
        )
    other = name_in(copy)
    if other not in (None, name):
        raise ValueError(
            f'--out: found {out} of the study "{other}", whose results this one would write over, '
            f'expected a new folder or one of the study "{name}"'
        )


def run_verb(arguments: argparse.Namespace) -> int:
    """Carry out a study, whole or up to a stage."""
    from calib.study.config import load_study, refused

    _check_executor(arguments)
    study = load_study(arguments.study)
    out = arguments.out or Path("runs") / study.name

    _check_own_file(out, study.name)
    make_folder("--out", out)

    from calib.study.stages import HowToRun, run_part, run_study
    from calib.study.train_report import EmulatorRefused
    from calib.toml_file import Contradiction
    from fe.campaign import CampaignFailed
    from fe.executors import WorkerDied

    how = HowToRun(
        workers=arguments.workers,
        executor=arguments.executor,
        scheduler=arguments.scheduler,
        echo=say,
    )
    try:
        with held_alone("--out", out):
            if arguments.until != "run":
                return _failed(run_part(study, out, arguments.until, **how))
            return _verdict(run_study(study, out, **how).summaries)
    except Contradiction as error:
        raise refused(arguments.study, error) from error
    except (CampaignFailed, EmulatorRefused, WorkerDied) as error:
        print(
            f"calib: {'; '.join([str(error), *getattr(error, '__notes__', [])])}", file=sys.stderr
        )
        return FAILED


def qc_verb(arguments: argparse.Namespace) -> int:
    """Make a data set of a laboratory's files."""
    from calib.study.experiment_data import (
        QC_FOLDER,
        experiment_folder,
        make_dataset,
        qc_lines,
        study_rules,
    )

    folder = experiment_folder(arguments.study)
    rules = study_rules(arguments.study)
    out = arguments.out or folder / QC_FOLDER
    make_folder("--out", out)
    bar = sys.stderr.isatty()
    result, paths = make_dataset(folder, out, with_figures=True, rules=rules, show_progress=bar)
    for line in qc_lines(result, paths):
        say(line)
    if result.dataset is None:
        return _failed(["fewer than two samples meet the rules: there is no data set"])
    return 0


def dic_verb(arguments: argparse.Namespace) -> int:
    """Correlate images."""
    from functools import partial

    from calib.dic_study import run
    from fe.progress_bar import progress_bar

    if arguments.out is not None:
        check_folder("--out", arguments.out)
        check_writable("--out", arguments.out)
    bars = partial(progress_bar, unit="point", shown=sys.stderr.isatty(), leave=False)
    run(arguments.study, arguments.out, say, bars)
    return 0


def _check_executor(arguments: argparse.Namespace) -> None:
    """Refuse options that contradict one another."""
    if arguments.scheduler is not None and arguments.executor != "dask":
        raise ValueError(
            f"--scheduler: found {arguments.scheduler} with --executor {arguments.executor}, "
            "expected --executor dask with it"
        )
    fixed = "serial is one process" if arguments.scheduler is None else "the cluster has its own"
    if arguments.workers is not None and (arguments.executor == "serial" or arguments.scheduler):
        raise ValueError(f"--workers: found {arguments.workers}, expected none: {fixed}")


def summary_verb(arguments: argparse.Namespace) -> int:
    """Print the constants of a finished study."""
    from calib import __version__
    from calib.study.finished import changed_since
    from calib.study.summary import format_table, load_summary
    from calib.study.summary_files import to_csv, to_json

    path = arguments.path / POSTERIOR if arguments.path.is_dir() else arguments.path
    if not path.is_file():
        raise ValueError(f"{path}: found no such file, expected the posterior of a finished study")
    summaries = load_summary(path)
    changed = changed_since(path)
    if changed and summaries[0].version != __version__:  # whose study files had other keys
        print(f"calib: {changed}", file=sys.stderr)
    elif changed:
        summaries = [replace(s, failures=(*s.failures, changed)) for s in summaries]
    style = to_json if arguments.json else to_csv if arguments.csv else format_table
    print(style(summaries).rstrip("\n"))
    return _verdict(summaries)


def _verdict(summaries: Sequence[Summary]) -> int:
    """Say which diagnostics are outside their limits; returns the exit code."""
    return _failed([f"{s.hypothesis}: {failure}" for s in summaries for failure in s.failures])


def _failed(failures: Sequence[str]) -> int:
    """Say what is outside the limits of the study; returns the exit code."""
    for failure in failures:
        print(f"calib: {failure}", file=sys.stderr)
    return FAILED if failures else 0


def init_verb(arguments: argparse.Namespace) -> int:
    """Write a study to start from."""
    from calib.study.template import write_template

    make_folder("DIR", arguments.folder)
    for path in write_template(arguments.folder):
        print(f"wrote {path}")
    study = shlex.quote(str(arguments.folder / "study.toml"))
    print(f"Put your data into it, then: calib run {study}")
    return 0


def studies_verb(_: argparse.Namespace) -> int:
    """List the embedded studies."""
    from calib.study.config import embedded_studies

    studies = embedded_studies()
    width = max(len(name) for name in studies)
    for name, title in studies.items():
        print(f"{name:{width}}  {title}")
    return 0


def lens_verb(arguments: argparse.Namespace) -> int:
    """Find lens and set-up of stereo images."""
    from calib.optics import (
        load_design,
        out_of_reach,
        published_checks,
        published_limits,
        search,
        tables,
    )

    figure: Path | None = arguments.figure
    if figure is not None and figure.suffix.lower() != ".png":
        raise ValueError(f"--figure: found {figure}, expected a file name that ends in .png")
    if figure is not None:
        make_folder("--figure", figure.parent)
    design = load_design(arguments.design or "sample-4mm")
    found = search(design)
    remarks = [f"{text}; it is left out" for text in out_of_reach(design)]
    remarks += tables.verdicts(found)
    if arguments.design is None:
        checks = published_checks()
        print(tables.checks_table(checks), end="\n\n")
        remarks = [*tables.warnings(checks), *published_limits(), *remarks]
    print(tables.found_table(found), flush=True)
    for remark in remarks:
        print(f"calib: {remark}", file=sys.stderr)
    if figure is not None:
        from calib.optics.figures import distance_figure
        from calib.study.figure_style import save_png

        save_png(distance_figure(found), figure)
        print(f"wrote {figure}")
    return 0 if found[0].is_feasible else FAILED


def laboratory_verb(arguments: argparse.Namespace) -> int:
    """Write a synthetic experiment."""
    from calib.virtual.laboratory import check_new, make_laboratory
    from calib.virtual.laboratory_settings import chosen
    from calib.virtual.truth import BlockTruth, solve_truth

    settings = chosen(arguments.samples, arguments.format, arguments.machine_format)
    check_new(arguments.folder)
    if arguments.folder.resolve() in (runs := arguments.runs.resolve(), *runs.parents):
        raise ValueError(
            f"--runs: found {arguments.runs} within {arguments.folder}, which the laboratory is to "
            "have for itself, expected a folder beside it"
        )
    # before minutes of simulations
    make_folder("DIR", arguments.folder)
    make_folder("--runs", arguments.runs)
    say(f"each simulation of the truth takes minutes, and is then kept in {arguments.runs}")
    truth = solve_truth(BlockTruth(), arguments.runs, say)
    make_laboratory(arguments.folder, truth, settings, arguments.seed, say)
    say(f"wrote {arguments.folder}, synthetic; what is true of it stands in truth.json")
    return 0
