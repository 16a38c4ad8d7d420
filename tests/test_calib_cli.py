"""The command answers in one sentence and with the exit code that it documents."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib import resources
from pathlib import Path
from types import SimpleNamespace

import pytest

from calib import cli
from calib.folders import LOCK, held_alone
from calib.study import Study, embedded_studies, load_study
from calib.study.data_sections import EXPERIMENT, THESIS_TABLE, VIRTUAL
from calib.toml_file import Contradiction


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


class Recorder:
    """Stands for `run_study`: notes how it was called, and raises what it is told to."""

    def __init__(self, error: BaseException | None = None, failures: tuple[str, ...] = ()) -> None:
        self.summaries = (SimpleNamespace(hypothesis="stuck", failures=failures),)
        self.error = error
        self.calls: list[tuple[Study, Path, int | None]] = []
        self.executors: list[tuple[str, str | None]] = []

    def __call__(self, study, out, *, workers, executor, scheduler, echo):
        self.executors.append((executor, scheduler))
        self.calls.append((study, out, workers))
        if self.error is not None:
            raise self.error
        echo("done")
        return SimpleNamespace(summaries=self.summaries)


@pytest.fixture
def run_study(monkeypatch):
    def install(error: BaseException | None = None, failures: tuple[str, ...] = ()) -> Recorder:
        recorder = Recorder(error, failures)
        monkeypatch.setattr("calib.study.stages.run_study", recorder)
        return recorder

    return install


def test_help_is_given_without_loading_what_computes():
    result = run_python(
        "import sys; from calib import cli\n"
        "try: cli.main(['--help'])\n"
        "except SystemExit: print(sorted({'numpy', 'scipy', 'pydantic'} & set(sys.modules)))"
    )
    assert result.returncode == 0
    assert "VERB" in result.stdout
    assert result.stdout.rstrip().endswith("[]")


def test_the_package_is_the_command():
    command = [sys.executable, "-m", "calib", "studies"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
    assert "thesis-forces" in result.stdout


def test_without_a_verb_the_usage_is_shown(capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main([])
    assert caught.value.code == cli.WRONG_INPUT
    assert "usage: calib" in capsys.readouterr().err


def test_run_leaves_folder_and_workers_to_the_study(run_study, capsys):
    recorder = run_study()
    assert cli.main(["run", "thesis-forces"]) == 0
    study, out, workers = recorder.calls[0]
    assert study == load_study("thesis-forces")
    assert (out, workers) == (Path("runs/thesis-forces"), None)
    assert recorder.executors == [("processes", None)]
    assert capsys.readouterr().out == "done\n"


def test_run_takes_folder_and_workers_from_the_command_line(run_study, tmp_path):
    recorder = run_study()
    assert cli.main(["run", "virtual", "--out", str(tmp_path), "--workers", "2"]) == 0
    assert recorder.calls[0][1:] == (tmp_path, 2)


class PartRecorder:
    """Stands for `run_part`: notes how it was called."""

    def __init__(self, failures: tuple[str, ...] = ()) -> None:
        self.failures = failures
        self.calls: list[tuple[str, Path, str]] = []

    def __call__(self, study, out, until, *, workers, executor, scheduler, echo):
        self.calls.append((study.name, out, until))
        return self.failures


@pytest.mark.parametrize("verb", ["simulate", "train"])
def test_parts_of_a_study_are_verbs(verb, monkeypatch, capsys):
    recorder = PartRecorder()
    monkeypatch.setattr("calib.study.stages.run_part", recorder)
    assert cli.main([verb, "thesis-forces"]) == 0
    assert recorder.calls == [("thesis-forces", Path("runs/thesis-forces"), verb)]
    monkeypatch.setattr("calib.study.stages.run_part", PartRecorder(("stuck: force error",)))
    assert cli.main([verb, "thesis-forces"]) == cli.FAILED
    assert capsys.readouterr().err == "calib: stuck: force error\n"


@pytest.mark.parametrize("verb", ["run", "simulate", "train"])
def test_every_verb_refuses_a_wrong_study_in_one_sentence(verb, tmp_path, capsys):
    assert cli.main([verb, str(tmp_path / "none.toml")]) == cli.WRONG_INPUT
    captured = capsys.readouterr()
    assert "found no such file" in captured.err and captured.err.count("\n") == 1


def test_the_executor_is_chosen_on_the_command_line(run_study):
    recorder = run_study()
    address = "tcp://node7:8786"
    cli.main(["run", "virtual", "--executor", "dask", "--scheduler", address])
    cli.main(["run", "virtual", "--executor", "serial"])
    assert recorder.executors == [("dask", address), ("serial", None)]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--scheduler", "tcp://h:1"], "--scheduler: found tcp://h:1 with --executor processes"),
        (["--executor", "serial", "--workers", "2"], "--workers: found 2, expected none: serial"),
        (
            ["--executor", "dask", "--scheduler", "tcp://h:1", "--workers", "2"],
            "--workers: found 2, expected none: the cluster has its own",
        ),
    ],
)
def test_executors_that_contradict_themselves_are_refused(run_study, options, message, capsys):
    recorder = run_study()
    assert cli.main(["run", "virtual", *options]) == cli.WRONG_INPUT
    assert recorder.calls == []
    error = capsys.readouterr().err
    assert error.startswith(f"calib: {message}") and error.count("\n") == 1


def test_a_scheduler_that_does_not_answer_is_one_sentence(monkeypatch, tmp_path, capsys):
    pytest.importorskip("distributed")
    monkeypatch.setattr("fe.dask_executor.CONNECT_SECONDS", 0.3)
    options = ["--executor", "dask", "--scheduler", "tcp://127.0.0.1:9", "--out", str(tmp_path)]
    assert cli.main(["simulate", "thesis-forces", *options]) == cli.WRONG_INPUT
    error = capsys.readouterr().err
    assert error.startswith("calib: scheduler: found none that answers at 'tcp://127.0.0.1:9'")
    assert error.count("\n") == 1


@pytest.mark.parametrize("workers", ["-1", "two", "1.5", ""])
def test_impossible_workers_are_refused(workers, capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main(["run", "virtual", "--workers", workers])
    assert caught.value.code == cli.WRONG_INPUT
    expected = f"--workers: found {workers}, expected a whole number, 0 or more"
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--steps", "--inner"])
def test_a_chain_of_no_steps_is_refused(option, capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main(["direct-chain", "runs/virtual", option, "0"])
    assert caught.value.code == cli.WRONG_INPUT
    expected = f"{option}: found 0, expected a whole number, 1 or more"
    assert expected in capsys.readouterr().err


def test_a_wrong_study_is_one_sentence_and_exit_code_2(tmp_path, capsys):
    path = tmp_path / "own.toml"
    path.write_text('name = "own"\nseeed = 1\n')
    assert cli.main(["run", str(path)]) == cli.WRONG_INPUT
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"calib: {path}:2: seeed: found an unknown key")
    assert captured.err.count("\n") == 1


def test_the_place_in_the_code_is_shown_on_demand(tmp_path):
    with pytest.raises(ValueError, match="no such file"):
        cli.main(["--traceback", "run", str(tmp_path / "none.toml")])


@pytest.mark.parametrize(
    ("command", "place"),
    [
        (["init"], "DIR"),
        (["run", "virtual", "--out"], "--out"),
        (["dic", "images.toml", "--out"], "--out"),
    ],
)
def test_a_folder_below_a_file_is_one_sentence(command, place, run_study, tmp_path, capsys):
    recorder = run_study()
    (tmp_path / "file").write_text("")
    assert cli.main([*command, str(tmp_path / "file" / "a" / "b")]) == cli.WRONG_INPUT
    said = f"found the file {tmp_path / 'file'}, expected a folder or a new name"
    assert capsys.readouterr().err == f"calib: {place}: {said}\n"
    assert recorder.calls == []


@pytest.mark.parametrize("command", [["init"], ["qc", "LAB", "--out"]])
def test_a_folder_that_cannot_be_made_is_one_sentence(command, run_study, tmp_path, capsys):
    run_study()
    command = [str(tmp_path) if word == "LAB" else word for word in command]
    long = tmp_path / ("x" * 300)
    assert cli.main([*command, str(long)]) == cli.WRONG_INPUT
    error = capsys.readouterr().err
    assert f"{long} cannot be made (File name too long), expected a folder or a new name" in error
    assert error.count("\n") == 1


def test_an_interrupt_says_how_to_go_on(run_study, capsys):
    run_study(KeyboardInterrupt())
    assert cli.main(["run", "virtual"]) == cli.STOPPED
    assert "stopped; run the same command again to go on" in capsys.readouterr().err


def test_too_many_failed_simulations_are_one_sentence_and_exit_code_1(run_study, capsys):
    from fe.campaign import CampaignFailed

    run_study(CampaignFailed("9 of 20 runs failed", 9, 20, 20))
    assert cli.main(["run", "virtual"]) == cli.FAILED
    assert capsys.readouterr().err == "calib: 9 of 20 runs failed\n"


def test_a_worker_that_died_is_one_sentence_and_exit_code_1(run_study, capsys):
    from fe.executors import WorkerDied

    run_study(WorkerDied("a worker process ended (exit code -9)"))
    assert cli.main(["run", "virtual"]) == cli.FAILED
    assert capsys.readouterr().err == "calib: a worker process ended (exit code -9)\n"
    died = WorkerDied("a worker process ended (exit code -9)", 3)
    died.add_note("in run 3 of campaign/stuck: r = 0.1")
    run_study(died)
    assert cli.main(["run", "virtual"]) == cli.FAILED
    assert "exit code -9); in run 3 of campaign/stuck: r = 0.1\n" in capsys.readouterr().err


def test_run_says_which_diagnostics_failed_and_exits_with_1(run_study, capsys):
    run_study(failures=("R-hat of C10 1.2 above 1.01",))
    assert cli.main(["run", "virtual"]) == cli.FAILED
    captured = capsys.readouterr()
    assert captured.out == "done\n"
    assert captured.err == "calib: stuck: R-hat of C10 1.2 above 1.01\n"


def test_what_synthetic_data_exclude_is_named_by_file_and_line(run_study, tmp_path, capsys):
    run_study(Contradiction("noise.load_cell_sd", 0.0722, "less than 0.06 N"))
    text = (resources.files("calib.study") / "embedded" / "virtual.toml").read_text()
    (tmp_path / "own.toml").write_text("# mine\n" + text)
    line = text.splitlines().index("load_cell_sd = 0.0722  # N") + 1
    for study, place in (
        ("virtual", f"virtual.toml:{line}"),
        (str(tmp_path / "own.toml"), f"{tmp_path / 'own.toml'}:{line + 1}"),
    ):
        assert cli.main(["run", study, "--out", str(tmp_path / "out")]) == cli.WRONG_INPUT
        said = "noise.load_cell_sd: found 0.0722, expected less than 0.06 N"
        assert capsys.readouterr().err == f"calib: {place}: {said}\n"


def test_results_do_not_go_where_a_file_is(run_study, tmp_path, capsys):
    recorder = run_study()
    (tmp_path / "file").write_text("mine")
    assert cli.main(["run", "virtual", "--out", str(tmp_path / "file")]) == cli.WRONG_INPUT
    assert recorder.calls == []
    assert "expected a folder" in capsys.readouterr().err


def test_a_study_of_the_user_is_not_written_over(run_study, tmp_path, capsys):
    recorder = run_study()
    text = (resources.files("calib.study") / "embedded" / "virtual.toml").read_text()
    own = tmp_path / "study.toml"
    own.write_text(text)
    assert cli.main(["run", str(own), "--out", str(tmp_path)]) == cli.WRONG_INPUT
    assert recorder.calls == [] and own.read_text() == text
    assert "study.toml no run has written" in capsys.readouterr().err
    own.write_text(f"# Written by calib run: the study that made this folder.\n{text}")
    assert cli.main(["run", str(own), "--out", str(tmp_path)]) == 0
    assert len(recorder.calls) == 1


def test_results_of_another_study_are_not_written_over(run_study, tmp_path, capsys):
    recorder = run_study()
    text = (resources.files("calib.study") / "embedded" / "virtual.toml").read_text()
    (tmp_path / "study.toml").write_text(f"# Written by calib run\n{text}".replace("virtual", "x"))
    kept = (tmp_path / "study.toml").read_text()
    assert cli.main(["run", "virtual", "--out", str(tmp_path)]) == cli.WRONG_INPUT
    assert recorder.calls == [] and (tmp_path / "study.toml").read_text() == kept
    said = f'--out: found {tmp_path} of the study "x", whose results this one would write over, '
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["run", "identify", "validate", "design-next", "direct-chain"])
def test_folders_that_cannot_be_written_are_told_before_the_work(
    verb, run_study, tmp_path, monkeypatch, capsys
):
    recorder = run_study()
    monkeypatch.setattr("calib.folders.os.access", lambda *_: False)  # as for users other than root
    (tmp_path / "plate.toml").write_text("")
    words = {"run": ["virtual", "--out", str(tmp_path)]}.get(verb, [str(tmp_path)])
    words += ["plate.toml"] if verb == "validate" else []
    assert cli.main([verb, *words]) == cli.WRONG_INPUT
    assert recorder.calls == []
    error = capsys.readouterr().err
    assert f"found {tmp_path}, expected a folder that can be written to" in error


def test_errors_of_files_name_the_file_and_no_number(monkeypatch, tmp_path, capsys):
    def fails(_):
        raise PermissionError(13, "Permission denied", str(tmp_path / "a.csv"))

    monkeypatch.setattr("calib.cli.studies_verb", fails)
    assert cli.main(["studies"]) == cli.WRONG_INPUT
    expected = "Permission denied; expected a place that can be read and written"
    assert capsys.readouterr().err == f"calib: {tmp_path / 'a.csv'}: {expected}\n"


@pytest.mark.parametrize(("verb", "goes_on"), [("dic", True), ("lens", False), ("studies", False)])
def test_what_was_stopped_is_said_to_go_on_only_where_it_does(verb, goes_on, monkeypatch, capsys):
    def stops(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"calib.cli.{verb}_verb", stops)
    assert cli.main([verb, *(["a.toml"] if verb == "dic" else [])]) == cli.STOPPED
    words = "stopped; run the same command again to go on" if goes_on else "stopped"
    assert capsys.readouterr().err == f"\n{words}\n"


def test_studies_lists_every_embedded_study(capsys):
    assert cli.main(["studies"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(embedded_studies())
    assert all(len(line.split()) > 1 for line in lines)


def test_init_writes_a_study_that_is_valid_and_named_after_its_folder(tmp_path, capsys):
    folder = tmp_path / "Prüfstand 3"
    assert cli.main(["init", str(folder)]) == 0
    study = load_study(folder / "study.toml")
    assert study.name == "Pr-fstand-3"
    assert Path(study.data.source) == folder / "forces.csv"
    assert "EXAMPLE" in (folder / "forces.csv").read_text().splitlines()[0]
    assert str(folder / "study.toml") in capsys.readouterr().out


@pytest.mark.parametrize("present", ["study.toml", "forces.csv"])
def test_init_overwrites_nothing(tmp_path, present, capsys):
    (tmp_path / present).write_text("mine")
    assert cli.main(["init", str(tmp_path)]) == cli.WRONG_INPUT
    assert [path.name for path in tmp_path.iterdir()] == [present]
    assert (tmp_path / present).read_text() == "mine"
    assert present in capsys.readouterr().err


@pytest.mark.slow
def test_what_init_writes_runs_to_a_report(tmp_path, capsys):
    assert cli.main(["init", str(tmp_path / "own")]) == 0
    path = tmp_path / "own" / "study.toml"
    text = path.read_text()  # as written but for cost: coarse meshes, few runs, short chains
    for old, new in {
        "[12, 4, 2]": "[3, 2, 3]",
        "[12, 5, 3]": "[3, 2, 3]",
        "[18, 6, 4]": "[5, 3, 4]",
        "[20, 14, 5]": "[5, 3, 4]",
        "n_runs = 20": "n_runs = 8",
        "n_held_out = 4": "n_held_out = 2",
        "n_refine = 8": "n_refine = 3",
        "max_force_error = 0.02": "max_force_error = 1.0",
        "max_steps = 20000": "max_steps = 500",
    }.items():
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    out = tmp_path / "out"
    code = cli.main(["run", str(path), "--out", str(out), "--workers", "2"])
    assert code in {0, cli.FAILED}  # a cheap study need not pass its diagnostics
    assert str(out / "report.html") in capsys.readouterr().out
    assert (out / "report.html").stat().st_size > 0
    assert cli.main(["summary", str(out), "--json"]) == code
    found = json.loads(capsys.readouterr().out)
    assert [entry["hypothesis"] for entry in found] == ["stuck", "sliding"]


def test_the_template_writes_out_every_section_of_a_study():
    text = (Path(cli.__file__).parent / "study/template/study.toml").read_text()
    for name, field in Study.__pydantic_fields__.items():
        key = "hypothesis" if name == "hypotheses" else name
        assert f"{key} = " in text or f"[{key}" in text or name == "virtual", field


def test_the_template_names_every_source_of_data():
    text = (Path(cli.__file__).parent / "study/template/study.toml").read_text()
    assert all(f'"{source}"' in text for source in (THESIS_TABLE, VIRTUAL, EXPERIMENT))
    assert "Keys that are not here are refused" not in text  # there are more, and they are read


@pytest.fixture
def saved(monkeypatch, tmp_path):
    """A folder with a posterior whose summaries are those given."""

    def install(*summaries: SimpleNamespace) -> Path:
        (tmp_path / "posterior.nc").write_bytes(b"")
        module = "calib.study.summary"
        monkeypatch.setattr(f"{module}.load_summary", lambda path: list(summaries))
        styles = {"format_table": "", "to_json": "_files", "to_csv": "_files"}
        for name, where in styles.items():
            monkeypatch.setattr(f"{module}{where}.{name}", lambda found, name=name: f"{name}\n")
        return tmp_path

    return install


@pytest.mark.parametrize(
    ("option", "style"), [([], "format_table"), (["--json"], "to_json"), (["--csv"], "to_csv")]
)
def test_summary_prints_in_the_style_asked_for(saved, option, style, capsys):
    folder = saved(SimpleNamespace(hypothesis="stuck", failures=()))
    assert cli.main(["summary", str(folder), *option]) == 0
    assert capsys.readouterr().out == f"{style}\n"
    assert cli.main(["summary", str(folder / "posterior.nc"), *option]) == 0


def test_summary_says_which_diagnostics_failed_and_exits_with_1(saved, capsys):
    folder = saved(
        SimpleNamespace(hypothesis="stuck", failures=("R-hat of C10 1.2 above 1.01",)),
        SimpleNamespace(hypothesis="sliding", failures=()),
    )
    assert cli.main(["summary", str(folder), "--json"]) == cli.FAILED
    captured = capsys.readouterr()
    assert captured.out == "to_json\n"
    assert captured.err == "calib: stuck: R-hat of C10 1.2 above 1.01\n"


def test_summary_of_nothing_is_refused(tmp_path, capsys):
    assert cli.main(["summary", str(tmp_path)]) == cli.WRONG_INPUT
    assert "posterior.nc: found no such file" in capsys.readouterr().err


@pytest.mark.lasting
def test_a_reader_that_has_had_enough_is_no_error():
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "calib.cli", "studies"]
    result = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (result.returncode, result.stderr) == (0, "")


def test_a_folder_in_which_a_run_is_at_work_is_refused_and_free_after_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    out.mkdir()
    with held_alone("--out", out):
        assert cli.main(["run", "thesis-forces", "--out", str(out)]) == 2
        said = capsys.readouterr().err
        assert f"--out: found {out}, in which another `calib` is at work" in said
        assert [path.name for path in out.iterdir()] == [LOCK]
    with pytest.raises(KeyboardInterrupt), held_alone("--out", out):
        raise KeyboardInterrupt
    with held_alone("--out", out):  # free again, however the run before ended
        assert (out / LOCK).read_bytes() == b""
