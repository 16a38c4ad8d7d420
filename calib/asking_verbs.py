"""What each verb does that asks a finished study; each returns an exit code.

Heavy modules are imported by the verb that needs them, as in `calib.verbs`.
"""

from __future__ import annotations

import argparse
import functools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from calib.folders import check_writable, held_alone
from calib.verbs import FAILED, POSTERIOR, say

Verb = Callable[[argparse.Namespace], int]

REPORT = "report.html"


def _asks(verb: Verb) -> Verb:
    """A verb that asks a finished study, and keeps runs out of its folder meanwhile.

    One that ended before the answer would have it taken for an answer to its own posterior.
    """

    @functools.wraps(verb)
    def alone(arguments: argparse.Namespace) -> int:
        check_writable("RUN", arguments.folder)
        if not (arguments.folder / POSTERIOR).is_file():
            return verb(arguments)  # which refuses it
        with held_alone("RUN", arguments.folder):
            return verb(arguments)

    return alone


@_asks
def ask_verb(arguments: argparse.Namespace) -> int:
    """Ask a finished study."""
    if arguments.question == "baseline":
        from calib.study.baseline import baseline

        truth = None if arguments.truth is None else tuple(arguments.truth)
        lines, paths = baseline(arguments.folder, arguments.hypothesis, truth)
    elif arguments.question == "identify":
        from calib.study.identify import identify

        lines, paths = identify(arguments.folder)
    else:
        from calib.study.evidence import evidence

        lines, paths = evidence(arguments.folder)
    _say_answer(arguments.folder, lines, paths)
    return 0


def _say_answer(folder: Path, lines: Sequence[str], paths: Sequence[Path]) -> None:
    """Print what a finished study was asked, and draw its report, where it has one, with it."""
    for line in [*lines, *_failures(folder)]:
        say(line)
    written = list(paths)
    if (folder / REPORT).is_file():
        from calib.study.finished import finished
        from calib.study.stages import report_again

        try:
            written += report_again(finished(folder))
        except ValueError as error:  # the answer stands
            say(f"report.html is not drawn again: {error}")
    for path in written:
        say(f"wrote {path}")


def _failures(folder: Path) -> list[str]:
    """What failed in the study that was asked, as its answers are of that posterior."""
    from calib.study.summary import load_summary

    path = folder / POSTERIOR
    if not path.is_file():
        return []
    try:
        summaries = load_summary(path)
    except ValueError as error:
        return [f"LOOK AT  whether the study's diagnostics held cannot be read: {error}"]
    return [
        f"LOOK AT  {summary.hypothesis}, whose posterior this is of: {failure}"
        for summary in summaries
        for failure in summary.failures
    ]


@_asks
def direct_chain_verb(arguments: argparse.Namespace) -> int:
    """Sample a posterior by the FE model itself."""
    from calib.study.direct_chain import direct_chain

    table, paths = direct_chain(
        arguments.folder, arguments.hypothesis, arguments.steps, arguments.inner, say
    )
    for line in (table.text(), *(f"wrote {path}" for path in paths)):
        say(line)
    return 0


@_asks
def validate_verb(arguments: argparse.Namespace) -> int:
    """Hold a finished study against a second test."""
    from calib.study.second_test import load_second_test
    from calib.study.validate import validate
    from calib.study.validation_tables import validation_tables, verdicts

    test, data_folder = load_second_test(arguments.second)
    if (arguments.folder / REPORT).is_file():
        from calib.study.finished import finished

        finished(arguments.folder)  # refuses what no report could be drawn of, before the solves
    shown = sys.stderr.isatty()
    found, paths = validate(arguments.folder, test, data_folder, say, show_progress=shown)
    tables = [f"\n{table.text()}" for table in validation_tables(found)]
    _say_answer(arguments.folder, [*tables, "", *verdicts(found)], paths)
    posteriors = [one for one in found["predictions"].values() if one["n_draws"] > 1]
    return 0 if all(one["passed"] for one in posteriors) else FAILED


@_asks
def design_next_verb(arguments: argparse.Namespace) -> int:
    """Rank what to measure next."""
    from calib.study.design_next import design_next, gains_table

    found, paths = design_next(
        arguments.folder, arguments.hypothesis, say, with_runs=not arguments.no_runs
    )
    _say_answer(arguments.folder, [gains_table(found).text()], paths)
    return 0
