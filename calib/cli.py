"""The command `calib`: its verbs and their arguments; wrong input is answered by one sentence.

Exit codes: 0 done, 1 simulations or diagnostics failed, 2 wrong input, 130 stopped by the user.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from calib.asking_verbs import ask_verb, design_next_verb, direct_chain_verb, validate_verb
from calib.disk_full import DiskFullError
from calib.interrupts import interrupts_kept
from calib.verbs import (
    FAILED,
    dic_verb,
    init_verb,
    laboratory_verb,
    lens_verb,
    qc_verb,
    run_verb,
    studies_verb,
    summary_verb,
)

__all__ = ["FAILED", "STOPPED", "WRONG_INPUT", "main"]

_Verbs: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"

WRONG_INPUT = 2
STOPPED = 130  # 128 + SIGINT, as shells have it

# The matrices of one step are small: threads cost more than they give, and the order of a sum
# must not depend on the machine. Work is spread over processes instead.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def main(argv: Sequence[str] | None = None) -> int:
    """Carry out one command line (that of the process when None) and return its exit code."""
    code = _carried_out(argv)
    if argv is None:  # nothing is left that a Ctrl-C could stop
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    return code


def _carried_out(argv: Sequence[str] | None) -> int:
    arguments = _parser().parse_args(argv)
    for name in _ONE_THREAD:
        os.environ[name] = "1"
    try:
        with interrupts_kept():
            code: int = arguments.verb(arguments)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        way = "; run the same command again to go on" if arguments.goes_on else ""
        print(f"\nstopped{way}", file=sys.stderr)
        return STOPPED
    except BrokenPipeError:  # the reader of a pipe, e.g. head, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ValueError, OSError) as error:
        if arguments.traceback:
            raise
        print(f"calib: {_sentence(error)}", file=sys.stderr)
        if isinstance(error, DiskFullError) and argv is None:  # HDF5 would crash at the end
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(WRONG_INPUT)
        return WRONG_INPUT


def _sentence(error: ValueError | OSError) -> str:
    """What was wrong, in one sentence."""
    if not isinstance(error, OSError) or error.strerror is None or error.filename is None:
        return str(error)
    if isinstance(error, FileExistsError):
        return f"{error.filename}: found a file, expected a folder or nothing"
    if isinstance(error, NotADirectoryError):
        return f"{error.filename}: found a file on the way there, expected folders"
    return f"{error.filename}: {error.strerror}; expected a place that can be read and written"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="calib",
        description="Hyperelastic constants of soft materials, with uncertainty.",
        epilog="Start with `calib run thesis-forces`, or `calib init my-study` for own data.",
    )
    parser.add_argument(
        "--traceback", action="store_true", help="show where in the code wrong input was refused"
    )
    parser.set_defaults(goes_on=False)
    verbs = parser.add_subparsers(required=True, metavar="VERB")

    _add_running(verbs)
    _add_measured(verbs)
    _add_beginnings(verbs)
    _add_summary(verbs)
    _add_lens(verbs)
    _add_laboratory(verbs)
    _add_questions(verbs)
    _add_direct_chain(verbs)
    _add_predictions(verbs)
    return parser


def _add_running(verbs: _Verbs) -> None:
    """Verbs that carry out a study, whole or in part."""
    for name, text in (
        ("run", "carry out a study; what is up to date is not done again"),
        ("simulate", "run the simulations of a study's design; `run` and `train` go on from there"),
        ("train", "train the emulators on the simulations of the design and judge them"),
    ):
        verb = verbs.add_parser(name, help=text)
        _add_study(verb)
        verb.set_defaults(verb=run_verb, until=name, goes_on=True)


def _add_measured(verbs: _Verbs) -> None:
    """Verbs from instruments to data."""
    qc = verbs.add_parser(
        "qc", help="make a data set of a laboratory's files, and say what is in it"
    )
    qc.add_argument(
        "study",
        metavar="STUDY_OR_LAB",
        help="folder with experiment.toml, or a study that names it",
    )
    qc.add_argument("--out", type=Path, metavar="DIR", help="results (default: qc in that folder)")
    qc.set_defaults(verb=qc_verb)

    dic = verbs.add_parser(
        "dic", help="measure displacements in images, and write them as point files"
    )
    dic.add_argument("study", type=Path, metavar="STUDY.toml", help="images, region and scale")
    dic.add_argument("--out", type=Path, metavar="DIR", help="results (default: STUDY-dic)")
    dic.set_defaults(verb=dic_verb, goes_on=True)


def _add_beginnings(verbs: _Verbs) -> None:
    """Verbs to start with."""
    init = verbs.add_parser("init", help="write a commented study and example data to start from")
    init.add_argument("folder", type=Path, metavar="DIR", help="folder to make")
    init.set_defaults(verb=init_verb)

    studies = verbs.add_parser("studies", help="list the embedded studies")
    studies.set_defaults(verb=studies_verb)


def _add_summary(verbs: _Verbs) -> None:
    summary = verbs.add_parser("summary", help="print the table of a posterior")
    summary.add_argument("path", type=Path, metavar="PATH", help="posterior.nc, or its folder")
    style = summary.add_mutually_exclusive_group()
    style.add_argument("--json", action="store_true", help="a list, one object per hypothesis")
    style.add_argument("--csv", action="store_true", help="one line per hypothesis and constant")
    summary.set_defaults(verb=summary_verb)


def _add_lens(verbs: _Verbs) -> None:
    lens = verbs.add_parser("lens", help="find lens and set-up for stereo images of a small face")
    lens.add_argument(
        "design",
        nargs="?",
        metavar="FILE",
        help="what is at hand and needed (default: the thesis' tables again, and a 4 mm sample)",
    )
    lens.add_argument("--figure", type=Path, metavar="PNG", help="field and depth over distance")
    lens.set_defaults(verb=lens_verb)


def _add_questions(verbs: _Verbs) -> None:
    """Verbs that ask a finished study."""
    for name, text in (
        ("identify", "say what the data of a finished study know of each constant"),
        ("evidence", "rank the hypotheses of a finished study, every number with its error"),
        ("baseline", "the thesis' own method, nine starts, on the field of a finished study"),
    ):
        verb = verbs.add_parser(name, help=text)
        verb.add_argument("folder", type=Path, metavar="RUN", help="folder of a finished study")
        verb.set_defaults(verb=ask_verb, question=name)
    _add_hypothesis(verb)
    verb.add_argument(
        "--truth",
        type=float,
        nargs=3,
        metavar=("C10", "C01", "C11"),
        help="constants (MPa) of a synthetic field where the study has none (default: published)",
    )


def _add_direct_chain(verbs: _Verbs) -> None:
    verb = verbs.add_parser("direct-chain", help="sample a posterior by the FE model, few steps")
    verb.add_argument("folder", type=Path, metavar="RUN", help="folder of a finished study")
    _add_hypothesis(verb)
    verb.add_argument(
        "--steps", type=_some, default=50, metavar="N", help="in all, one FE solve each (50)"
    )
    verb.add_argument(
        "--inner", type=_some, default=20, metavar="N", help="by the emulator between them (20)"
    )
    verb.set_defaults(verb=direct_chain_verb, goes_on=True)


def _add_predictions(verbs: _Verbs) -> None:
    text = "hold a finished study against a second test: other geometry, other loading"
    validate = verbs.add_parser("validate", help=text)
    validate.add_argument("folder", type=Path, metavar="RUN", help="folder of a finished study")
    validate.add_argument("second", metavar="SECOND", help="file of the test, or notched-plate")
    validate.set_defaults(verb=validate_verb)

    text = "rank what to measure next by the information it is expected to give"
    following = verbs.add_parser("design-next", help=text)
    following.add_argument("folder", type=Path, metavar="RUN", help="folder of a finished study")
    _add_hypothesis(following)
    following.add_argument(
        "--no-runs", action="store_true", help="increments and instruments only, without FE runs"
    )
    following.set_defaults(verb=design_next_verb, goes_on=True)


def _add_laboratory(verbs: _Verbs) -> None:
    text = "make a synthetic experiment: files of test machine and DIC with a known truth"
    laboratory = verbs.add_parser("laboratory", help=text)
    laboratory.add_argument("folder", type=Path, metavar="DIR", help="folder to make")
    laboratory.add_argument(
        "--seed", type=_count, default=0, metavar="N", help="of all that is drawn (default: 0)"
    )
    laboratory.add_argument(
        "--samples", type=_some, default=24, metavar="N", help="number of samples (default: 24)"
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
    laboratory.set_defaults(verb=laboratory_verb, goes_on=True)


def _add_hypothesis(verb: argparse.ArgumentParser) -> None:
    """Argument of the verbs that ask one hypothesis of a finished study."""
    verb.add_argument(
        "--hypothesis", metavar="NAME", help="whose posterior is asked (needed if several)"
    )


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


def _count(text: str, least: int = 0) -> int:
    """Type of --workers and --seed."""
    if not (text.isascii() and text.isdigit() and int(text) >= least):
        raise argparse.ArgumentTypeError(f"found {text}, expected a whole number, {least} or more")
    return int(text)


def _some(text: str) -> int:
    """Type of --samples, --steps and --inner: a chain of no steps says nothing."""
    return _count(text, least=1)


if __name__ == "__main__":
    sys.exit(main())
