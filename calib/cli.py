"""The command `calib`: one verb a function; what is wrong with the input is said in one sentence.

Heavy modules are imported by the verb that needs them, so that `calib --help` answers at once.
Exit codes: 0 done, 1 simulations or diagnostics failed, 2 wrong input, 130 stopped by the user.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.study.summary import Summary

FAILED = 1
WRONG_INPUT = 2
STOPPED = 130  # 128 + SIGINT, as shells have it

# The matrices of one step are small: threads cost more than they give, and the order of a sum
# must not depend on the machine. Work is spread over processes instead.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def main(argv: Sequence[str] | None = None) -> int:
    """Carry out one command line (that of the process when None) and return its exit code."""
    arguments = _parser().parse_args(argv)
    for name in _ONE_THREAD:
        os.environ.setdefault(name, "1")
    try:
        code: int = arguments.verb(arguments)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print("\nstopped; run the same command again to go on", file=sys.stderr)
        return STOPPED
    except BrokenPipeError:  # the reader of a pipe, e.g. head, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ValueError, OSError) as error:
        if arguments.traceback:
            raise
        print(f"calib: {error}", file=sys.stderr)
        return WRONG_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="calib",
        description="Hyperelastic constants of soft materials, with uncertainty.",
        epilog="Start with `calib run thesis-forces`, or `calib init my-study` for own data.",
    )
    parser.add_argument(
        "--traceback", action="store_true", help="show where in the code wrong input was refused"
    )
    verbs = parser.add_subparsers(required=True, metavar="VERB")

    for name, text in (
        ("run", "carry out a study; what is up to date is not done again"),
        ("simulate", "run the simulations of a study's design; `run` and `train` go on from there"),
        ("train", "train the emulators on the simulations of the design and judge them"),
    ):
        verb = verbs.add_parser(name, help=text)
        _add_study(verb)
        verb.set_defaults(verb=_run, until=name)

    qc = verbs.add_parser(
        "qc", help="make a data set of a laboratory's files, and say what is in it"
    )
    qc.add_argument(
        "study",
        metavar="STUDY_OR_LAB",
        help="folder with experiment.toml, or a study that names it",
    )
    qc.add_argument("--out", type=Path, metavar="DIR", help="results (default: qc in that folder)")
    qc.set_defaults(verb=_qc)

    dic = verbs.add_parser(
        "dic", help="measure displacements in images, and write them as point files"
    )
    dic.add_argument("study", type=Path, metavar="STUDY.toml", help="images, region and scale")
    dic.add_argument("--out", type=Path, metavar="DIR", help="results (default: STUDY-dic)")
    dic.set_defaults(verb=_dic)

    summary = verbs.add_parser("summary", help="print the table of a posterior")
    summary.add_argument("path", type=Path, metavar="PATH", help="posterior.nc, or its folder")
    style = summary.add_mutually_exclusive_group()
    style.add_argument("--json", action="store_true", help="a list, one object per hypothesis")
    style.add_argument("--csv", action="store_true", help="one line per hypothesis and constant")
    summary.set_defaults(verb=_summary)

    init = verbs.add_parser("init", help="write a commented study and example data to start from")
    init.add_argument("folder", type=Path, metavar="DIR", help="folder to make")
    init.set_defaults(verb=_init)

    studies = verbs.add_parser("studies", help="list the embedded studies")
    studies.set_defaults(verb=_studies)

    lens = verbs.add_parser("lens", help="find lens and set-up for stereo images of a small face")
    lens.add_argument(
        "design",
        nargs="?",
        metavar="FILE",
        help="what is at hand and needed (default: the thesis' tables again, and a 4 mm sample)",
    )
    lens.add_argument("--figure", type=Path, metavar="PNG", help="field and depth over distance")
    lens.set_defaults(verb=_lens)
    _add_laboratory(verbs)
    return parser


def _add_laboratory(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    text = "make a synthetic experiment: files of test machine and DIC with a known truth"
    laboratory = verbs.add_parser("laboratory", help=text)
    laboratory.add_argument("folder", type=Path, metavar="DIR", help="folder to make")
    laboratory.add_argument(
        "--seed", type=_count, default=0, metavar="N", help="of all that is drawn (default: 0)"
    )
    laboratory.add_argument(
        "--samples", type=_count, default=24, metavar="N", help="number of samples (default: 24)"
    )
    laboratory.add_argument(
        "--format",
        default="davis-csv",
        metavar="NAME",
        help="of the DIC files: davis-csv (default), davis-tecplot, matchid-2023, matchid-2024, "
        "vic-3d, dice, softcal",
    )
    laboratory.add_argument(
        "--machine-format",
        default="bluehill-raw",
        metavar="NAME",
        help="of the test machine's files: bluehill-raw (default), bluehill-export, softcal",
    )
    laboratory.add_argument(
        "--runs",
        type=Path,
        default=Path("runs") / "laboratory",
        metavar="DIR",
        help="where the simulations of the truth are kept (default: runs/laboratory)",
    )
    laboratory.set_defaults(verb=_laboratory)


def _add_study(verb: argparse.ArgumentParser) -> None:
    """Arguments of the verbs that carry out a study, whole or in part."""
    verb.add_argument("study", metavar="STUDY", help="study file, or name of an embedded study")
    verb.add_argument("--out", type=Path, metavar="DIR", help="results (default: runs/<name>)")
    verb.add_argument(
        "--workers", type=_count, metavar="N", help="processes (default: as the study says; 0: all)"
    )
    verb.add_argument(
        "--executor",
        choices=("processes", "serial", "dask"),
        default="processes",
        help="where simulations run: in worker processes (default), here one by one, or in Dask",
    )
    verb.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="with --executor dask: tcp://HOST:PORT or scheduler file (default: workers here)",
    )


def _count(text: str) -> int:
    """Type of --workers."""
    if not (text.isascii() and text.isdigit()):
        raise argparse.ArgumentTypeError(f"found {text}, expected a whole number, 0 or more")
    return int(text)


def _say(line: str) -> None:
    print(line, flush=True)


def _run(arguments: argparse.Namespace) -> int:
    from calib.study.config import load_study

    _check_executor(arguments)
    study = load_study(arguments.study)
    out = arguments.out or Path("runs") / study.name

    if out.exists() and not out.is_dir():
        raise ValueError(f"--out: found the file {out}, expected a folder or a new name")

    from calib.study.stages import HowToRun, run_part, run_study
    from calib.study.train_report import EmulatorRefused
    from fe.campaign import CampaignFailed
    from fe.executors import WorkerDied

    how = HowToRun(
        workers=arguments.workers,
        executor=arguments.executor,
        scheduler=arguments.scheduler,
        echo=_say,
    )
    try:
        if arguments.until != "run":
            return _failed(run_part(study, out, arguments.until, **how))
        return _verdict(run_study(study, out, **how).summaries)
    except (CampaignFailed, EmulatorRefused, WorkerDied) as error:
        print(f"calib: {error}", file=sys.stderr)
        return FAILED


def _qc(arguments: argparse.Namespace) -> int:
    from calib.study.experiment_data import QC_FOLDER, experiment_folder, make_dataset, qc_lines

    folder = experiment_folder(arguments.study)
    result, paths = make_dataset(folder, arguments.out or folder / QC_FOLDER, with_figures=True)
    for line in qc_lines(result, paths):
        _say(line)
    if result.dataset is None:
        return _failed(["fewer than two samples meet the rules: there is no data set"])
    return 0


def _dic(arguments: argparse.Namespace) -> int:
    from calib.dic_study import run

    run(arguments.study, arguments.out, _say)
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


def _summary(arguments: argparse.Namespace) -> int:
    from calib.study.summary import format_table, load_summary, to_csv, to_json

    path = arguments.path / "posterior.nc" if arguments.path.is_dir() else arguments.path
    if not path.is_file():
        raise ValueError(f"{path}: found no such file, expected the posterior of a finished study")
    summaries = load_summary(path)
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


def _init(arguments: argparse.Namespace) -> int:
    from calib.study.template import write_template

    for path in write_template(arguments.folder):
        print(f"wrote {path}")
    study = shlex.quote(str(arguments.folder / "study.toml"))
    print(f"Put your data into it, then: calib run {study}")
    return 0


def _studies(_: argparse.Namespace) -> int:
    from calib.study.config import embedded_studies

    studies = embedded_studies()
    width = max(len(name) for name in studies)
    for name, title in studies.items():
        print(f"{name:{width}}  {title}")
    return 0


def _lens(arguments: argparse.Namespace) -> int:
    from calib.optics import load_design, published_checks, published_limits, search, tables

    figure: Path | None = arguments.figure
    if figure is not None and figure.suffix.lower() != ".png":
        raise ValueError(f"--figure: found {figure}, expected a file name that ends in .png")
    found = search(load_design(arguments.design or "sample-4mm"))
    remarks = list(tables.verdicts(found))
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


def _laboratory(arguments: argparse.Namespace) -> int:
    from calib.virtual.laboratory import check_new, make_laboratory
    from calib.virtual.laboratory_settings import chosen
    from calib.virtual.truth import BlockTruth, solve_truth

    settings = chosen(arguments.samples, arguments.format, arguments.machine_format)
    check_new(arguments.folder)
    _say("the simulations of the truth take minutes unless they are in " + str(arguments.runs))
    truth = solve_truth(BlockTruth(), arguments.runs)
    make_laboratory(arguments.folder, truth, settings, arguments.seed, _say)
    _say(f"wrote {arguments.folder}, synthetic; what is true of it stands in truth.json")
    return 0


if __name__ == "__main__":
    sys.exit(main())
