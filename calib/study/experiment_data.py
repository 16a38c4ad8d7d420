"""The data set that a study makes of a laboratory's files, kept in that folder."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

from pydantic.dataclasses import dataclass

from calib import __version__
from calib.code_hash import code_hash
from calib.data import Dataset
from calib.data.dataset_file import load_dataset
from calib.data.qc import FILE, QcResult, analyse, read_experiment
from calib.data.qc.doubts import doubts
from calib.data.qc.lab_files import input_hash, sample_files
from calib.data.qc.results import DATASET, FIGURES, REPORT, key_of, write_results
from calib.data.qc.rules import Rules, inputs_under
from calib.data.qc.statistics import (
    eligibility_table,
    force_table,
    noise_table,
    requirements,
)
from calib.data.qc.table import table_text
from calib.data.requirements import requirements_text
from calib.study.artifacts import read_json
from calib.study.figure_style import save_png
from calib.study.sections import DataSource
from calib.toml_file import read_document, read_file
from calib.toml_file.strict import STRICT
from fe.progress_bar import progress_bar

QC_FOLDER = "qc"
"""within the laboratory's folder: what was found, and the data set"""
MEASURED = "calib.data"
"""package of readers, quality control and data set"""


def experiment_folder(study: str | Path) -> Path:
    """The laboratory's folder: itself, that of its experiment.toml, or the one that a study names.

    Raises ValueError of one sentence where there is none.
    """
    path = Path(study)
    if path.is_dir():
        return path
    if path.name == FILE:
        return path.parent
    if not path.is_file():
        raise ValueError(
            f"{path}: found no such file, expected a folder with {FILE} or a study that names one"
        )
    folder = _data_of(path).folder
    if folder is None:
        expected = 'the folder of an experiment, with data.source = "experiment"'
        raise ValueError(f"{path}: data.folder: found none, expected {expected}")
    return path.parent / folder


@dataclass(frozen=True, kw_only=True, config=STRICT)
class _Named:
    """What a study says of its data."""

    data: DataSource
    """a section [data]"""


def _data_of(path: Path) -> DataSource:
    """The section [data] of a study file. Raises ValueError of one sentence."""
    document = read_document(read_file(path, "study file"), str(path), "study file")
    data = {key: value for key, value in document.values.items() if key == "data"}
    return replace(document, values=data).checked(_Named).data


def study_rules(study: str | Path) -> Rules | None:
    """The rules in [data.quality] of a study file; None of a folder, which has its own alone.

    Raises ValueError of one sentence with file, line and key.
    """
    path = Path(study)
    if path.is_dir() or path.name == FILE:
        return None
    return _data_of(path).quality


def make_dataset(
    folder: Path,
    out: Path,
    *,
    with_figures: bool,
    show_progress: bool = True,
    rules: Rules | None = None,
) -> tuple[QcResult, list[Path]]:
    """Analyse the files in `folder` and write the results to `out`; returns what was written.

    Figures of an older analysis in `out` are removed, and drawn anew `with_figures`.

    `rules` of a study go before those of the folder's experiment.toml.

    Raises ValueError of one sentence for files that cannot be read.
    """
    with progress_bar("qc", "sample", shown=show_progress) as progress:
        result = analyse(folder, progress, rules)
    try:
        return result, _written(result, out, with_figures)
    except OSError as error:  # a folder where a file is meant, a full disk
        name = error.filename2 or error.filename or out
        raise ValueError(
            f"{name}: cannot be written ({error.strerror}), expected a place for the results"
        ) from error


def _written(result: QcResult, out: Path, with_figures: bool) -> list[Path]:
    paths = write_results(result, out, __version__, code_hash(MEASURED))
    if with_figures:
        from calib.data.qc.figures import all_figures

        for name, figure in all_figures(result).items():
            save_png(figure, out / FIGURES / f"{name}.png")
            paths.append(out / FIGURES / f"{name}.png")
    return paths


def qc_lines(result: QcResult, paths: list[Path]) -> list[str]:
    """What `calib qc` prints: each rejection, doubts, tables, and where the results are."""
    tables = (eligibility_table, force_table, noise_table)
    lines = [rejection.text() for rejection in result.rejections]
    lines += [f"warning: {doubt}" for doubt in doubts(result)]
    lines += ["", *(f"{table_text(table(result))}\n" for table in tables)]
    lines += [requirements_text(requirements(result)), ""]
    if result.experiment.synthetic:
        lines.append("synthetic: the files were made by a model")
    n = len(result.samples)
    lines.append(f"{n} sample{'s' * (n != 1)} in {result.seconds:.1f} s")
    return [*lines, *(f"wrote {path}" for path in paths if path.suffix != ".csv")]


def experiment_dataset(folder: str | Path, rules: Rules | None = None) -> Dataset:
    """The data set of a laboratory's files: from its qc folder when up to date, else made anew.

    Raises ValueError of one sentence when files cannot be read or fewer than two samples are kept.
    """
    folder = Path(folder)
    inputs = input_hash(folder, sample_files(folder, read_experiment(folder)))
    return _dataset(folder.resolve(), inputs_under(inputs, rules), code_hash(MEASURED), rules)


def rejections_kept(folder: str | Path) -> tuple[str, ...]:
    """One sentence for each rule that a sample breaks, as kept beside the data set."""
    path = Path(folder) / QC_FOLDER / REPORT
    if not path.is_file():
        return ()
    samples = read_json(path, ("samples",))["samples"]
    return tuple(own["sentence"] for sample in samples for own in sample["rejections"])


def warnings_kept(folder: str | Path) -> tuple[str, ...]:
    """What to look at of samples that meet all rules, as kept beside the data set."""
    path = Path(folder) / QC_FOLDER / REPORT
    return tuple(read_json(path).get("warnings", ())) if path.is_file() else ()


@cache
def _dataset(folder: Path, inputs: str, code: str, rules: Rules | None) -> Dataset:
    kept = folder / QC_FOLDER / DATASET
    if kept.is_file():
        try:
            dataset, made_from = load_dataset(kept)
        except ValueError:
            made_from = ""  # damaged, or of another layout: made anew
        if made_from == key_of(inputs, code):
            return dataset
    result, _ = make_dataset(
        folder,
        folder / QC_FOLDER,
        with_figures=False,
        show_progress=sys.stderr.isatty(),
        rules=rules,
    )
    if result.dataset is None:
        report = os.path.join(QC_FOLDER, REPORT)
        raise ValueError(
            f"{folder}: found fewer than two samples that meet the rules, expected two or more; "
            f"see {report}"
        )
    return result.dataset
