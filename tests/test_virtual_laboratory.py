"""A virtual laboratory's files say what is true but for the stated errors."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from virtual_blocks import analytic_truth

from calib.cli import main
from calib.data.readers import read_dic, read_machine
from calib.virtual import (
    BlockTruth,
    Cameras,
    LaboratorySettings,
    Placing,
    VirtualNoise,
    make_laboratory,
)
from calib.virtual.cameras import CameraPair
from calib.virtual.correlated_noise import correlated_noise, torus_amplitudes
from calib.virtual.dic_frames import dic_frames
from calib.virtual.front_view import grid_spacing, view
from calib.virtual.laboratory_settings import (
    MACHINE_FORMATS,
    POINT_FORMATS,
    Protocol,
    Rubber,
)
from calib.virtual.photographs import Studio, photograph
from calib.virtual.placement import Placement, place
from calib.virtual.point_files import POINT_WRITERS, write_frames
from calib.virtual.sensor import Sensor
from fe import BlockPin

SMALL = Cameras(grid=(60, 16))
STRAIGHT = Placement(0.0, 0.0, 0.0, 0.0, (0.4, -1.1, 2.0), 1.0, "")
TURNED = Placement(0.1, 0.8, -0.4, 0.2, (0.4, -1.1, 2.0), 1.1, "")
TRAVEL = np.array([0.0, 0.4, 0.8, 1.2])


def frames_of(placement, cameras, seed=1):
    seen = view(analytic_truth(), placement, TRAVEL, cameras)
    spacing = grid_spacing(cameras, 10.0, 2.5)
    rng = np.random.default_rng(seed)
    return seen, dic_frames(seen, cameras, spacing, np.arange(4.0), rng)


def files_of(folder):
    return {p.relative_to(folder).as_posix(): p for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("name", POINT_FORMATS)
def test_readers_find_the_frames_that_were_written(name, tmp_path) -> None:
    writer = POINT_WRITERS[name]
    _, frames = frames_of(TURNED, SMALL)
    write_frames(tmp_path / "dic", frames, writer)
    series = read_dic(tmp_path / "dic")
    signs = np.array([1.0 if axis[0] == "+" else -1.0 for axis in writer.axes])
    assert len(series.frames) == len(frames)
    for made, read in zip(frames[1:], series.frames[1:], strict=True):
        held = slice(None) if read.valid.size == made.valid.size else made.valid
        assert np.array_equal(read.valid, made.valid[held])
        there = read.valid
        assert read.position[there] * signs == pytest.approx(made.position[held][there], abs=2.1e-5)
        assert read.displacement[there] * signs == pytest.approx(
            made.displacement[held][there], abs=1e-5
        )
    assert np.all(series.frames[0].displacement[series.frames[0].valid] == 0.0)


@pytest.mark.parametrize("name", ["davis-tecplot", "vic-3d", "dice", "softcal"])
def test_files_with_room_for_it_say_that_they_are_synthetic(name, tmp_path) -> None:
    _, frames = frames_of(STRAIGHT, SMALL)
    write_frames(tmp_path / "dic", frames, POINT_WRITERS[name])
    assert all("synthetic" in path.read_text() for path in (tmp_path / "dic").iterdir())


def test_the_same_seed_gives_the_same_bytes_and_another_one_others(tmp_path) -> None:
    settings = LaboratorySettings(samples=2, cameras=SMALL, placing=Placing(misplaced=1))
    for folder, seed in (("a", 1), ("b", 1), ("c", 2)):
        make_laboratory(tmp_path / folder, analytic_truth(), settings, seed)
    a, b, c = (files_of(tmp_path / folder) for folder in "abc")
    assert a.keys() == b.keys()
    assert all(a[name].read_bytes() == b[name].read_bytes() for name in a)
    assert sum(a[name].read_bytes() != c[name].read_bytes() for name in a) == len(a) - 1


@pytest.mark.parametrize("machine", MACHINE_FORMATS)
def test_layout_and_truth_are_as_documented(machine, tmp_path) -> None:
    settings = LaboratorySettings(
        samples=2, cameras=SMALL, placing=Placing(misplaced=0), machine_format=machine
    )
    samples = make_laboratory(tmp_path, analytic_truth(), settings, 3)
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert [sample["name"] for sample in truth["samples"]] == ["S01", "S02"]
    assert len(read_dic(tmp_path / "static").frames) == 6
    for sample in samples:
        record = read_machine(tmp_path / sample.name / "machine.csv").in_compression()
        assert record.travel is not None
        assert len(read_dic(tmp_path / sample.name / "dic").frames) == 10
        last = (record.time > sample.frame_time[9]) & (record.time < sample.frame_time[9] + 2)
        zero = record.force[record.travel < 0.45].mean()
        found = record.force[last].mean() - zero
        assert found == pytest.approx(sample.force_at_rest[8], abs=0.05)
        lines = (tmp_path / sample.name / "frames.csv").read_text().splitlines()
        stated = np.array([float(line.split(",")[1]) for line in lines[2:]])
        assert stated - sample.frame_time == pytest.approx(sample.clock_offset, abs=0.006)


def test_an_experiment_that_is_there_is_not_written_over(tmp_path) -> None:
    settings = LaboratorySettings(samples=1, cameras=SMALL, placing=Placing(misplaced=0))
    make_laboratory(tmp_path, analytic_truth(), settings, 1)
    with pytest.raises(ValueError, match="expected a new or empty folder"):
        make_laboratory(tmp_path, analytic_truth(), settings, 1)


def test_a_laboratory_that_fails_half_way_leaves_nothing(tmp_path, monkeypatch) -> None:
    """Else quality control would take the part for a whole one."""
    settings = LaboratorySettings(samples=2, cameras=SMALL, placing=Placing(misplaced=0))
    said = []

    def stopped(line: str) -> None:
        said.append(line)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_laboratory(tmp_path, analytic_truth(), settings, 1, stopped)
    assert said == ["S01 written"] and not list(tmp_path.iterdir())
    assert len(make_laboratory(tmp_path, analytic_truth(), settings, 1)) == 2


def test_photographs_replace_the_files_of_softcal_alone(tmp_path) -> None:
    cameras = replace(SMALL, format="matchid-2024")
    settings = LaboratorySettings(samples=1, cameras=cameras, placing=Placing(misplaced=0))
    samples = make_laboratory(tmp_path, analytic_truth(), settings, 1)
    before = {name: path.read_bytes() for name, path in files_of(tmp_path).items()}
    with pytest.raises(
        ValueError, match="static: expected frames of softcal points csv, found Mat"
    ):
        photograph(tmp_path, analytic_truth(), samples, Studio(), 1)
    assert {name: path.read_bytes() for name, path in files_of(tmp_path).items()} == before


def test_the_command_makes_a_laboratory_and_refuses_in_one_sentence(
    tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.setattr("calib.virtual.truth.solve_truth", lambda *_: analytic_truth())
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "lab"
    asked = ["laboratory", str(folder), "--samples", "1", "--format", "vic-3d", "--seed", "5"]
    assert main(asked) == 0
    assert json.loads((folder / "truth.json").read_text())["seed"] == 5
    assert read_dic(folder / "S01" / "dic").format == "VIC-3D csv"
    assert main(asked) == 2
    assert main(["laboratory", str(tmp_path / "new"), "--format", "vic"]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[0].endswith("expected a new or empty folder")
    assert said[1].startswith("calib: format: expected one of davis-csv, ")


def test_folders_of_a_laboratory_are_refused_before_the_truth_is_solved(
    tmp_path, monkeypatch, capsys
) -> None:
    def solved(*_: object) -> None:
        raise AssertionError("solved")

    monkeypatch.setattr("calib.virtual.truth.solve_truth", solved)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    within = Path("file") / "sub"
    for options, sentence in (
        (["lab", "--runs", "file"], "--runs: found the file file, expected a folder or a new name"),
        (["lab", "--runs", str(within)], "--runs: found the file file, expected a folder or a new"),
        ([str(within)], "DIR: found the file file, expected a folder or a new name"),
        (["file"], "file: found something there, expected a new or empty folder"),
        (["lab", "--runs", "lab/runs"], "--runs: found lab/runs within lab, which the laboratory"),
    ):
        assert main(["laboratory", *options]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"calib: {sentence}") and said.count("\n") == 1
    for number in ("0", "-1", "1.5", "two"):
        with pytest.raises(SystemExit, match="2"):
            main(["laboratory", "lab", "--samples", number])
        said = capsys.readouterr().err
        assert f"argument --samples: found {number}, expected a whole number, 1 or more" in said


def test_without_errors_the_files_hold_the_truth() -> None:
    exact = replace(SMALL, noise_mm=(0.0, 0.0, 0.0), lost_share=0.0, outlier_share=0.0)
    seen, frames = frames_of(TURNED, exact)
    for frame, moved in zip(frames[1:], seen.displacement[1:], strict=True):
        assert np.array_equal(frame.displacement[frame.valid], moved[frame.valid])
    turn = TURNED.rotation
    back = (seen.position - np.array(TURNED.origin)) @ turn
    assert back[:, 2] == pytest.approx(0.0, abs=1e-12)
    assert back[:, :2] == pytest.approx(seen.material)
    field = analytic_truth().field_at(seen.material, TRAVEL, TURNED.x_shift)
    assert seen.displacement @ turn == pytest.approx(field)


def test_angle_is_the_slope_of_z_along_x_and_roll_that_of_y() -> None:
    for placement, axis, degrees in (
        (replace(STRAIGHT, angle=1.5), 2, -1.5),
        (replace(STRAIGHT, roll=0.7), 1, 0.7),
    ):
        along = placement.rotation[:, 0]
        assert np.degrees(np.arctan2(along[axis], along[0])) == pytest.approx(degrees)


def test_points_behind_the_pin_and_beside_the_face_are_hidden() -> None:
    seen, _ = frames_of(STRAIGHT, replace(SMALL, edge_mm=0.12))
    x, y = seen.material.T
    beside = (np.abs(x) > 4.88) | (y < 0.12) | (y > 2.38)
    assert not seen.seen[:, beside].any()
    assert seen.seen[0, ~beside].all()
    deformed = seen.position + seen.displacement[3] - np.array(STRAIGHT.origin)
    behind = (np.abs(deformed[:, 0]) < 2.0) & (deformed[:, 1] > 2.5 - TRAVEL[3])
    assert behind.any()
    assert not seen.seen[3, behind].any()


@pytest.mark.parametrize("length", [0.3, 2.5])
def test_noise_of_any_length_has_unit_variance_and_its_correlation(length) -> None:
    """By the spectrum, without draws; e^-8 is cut off of short lengths, 1 % of long ones."""
    grid, spacing = (200, 50), (0.052, 0.058)
    spectrum = torus_amplitudes(grid, spacing, length) ** 2
    found = np.fft.fft2(spectrum).real[:200, :50]
    away = np.hypot(spacing[0] * np.arange(200)[:, None], spacing[1] * np.arange(50))
    assert found[0, 0] == pytest.approx(1.0, abs=1e-12)
    assert np.abs(found - np.exp(-away / length)).max() < (0.01 if length > 1.0 else np.exp(-8.0))


def test_noise_has_the_stated_size_correlation_and_common_part() -> None:
    """Over 300 draws of a pair of frames; false alarms below 1e-4 at these margins (fixed seed)."""
    cameras = replace(SMALL, lost_share=0.0, outlier_share=0.0)
    grid, spacing = cameras.grid, grid_spacing(cameras, 10.0, 2.5)
    amplitudes = torus_amplitudes(grid, spacing, cameras.correlation_mm)
    fields = correlated_noise(amplitudes, grid, 300, np.random.default_rng(0))
    assert fields.var() == pytest.approx(1.0, abs=0.02)
    for step in (1, 2, 5):
        along = np.mean(fields[:, step:] * fields[:, :-step])
        across = np.mean(fields[:, :, step:] * fields[:, :, :-step])
        assert along == pytest.approx(np.exp(-step * spacing[0] / 0.3), abs=0.02)
        assert across == pytest.approx(np.exp(-step * spacing[1] / 0.3), abs=0.02)
    errors = []
    for seed in range(30):
        seen, frames = frames_of(STRAIGHT, cameras, seed)
        for_all = seen.seen.all(axis=0)
        errors.append(
            [
                frame.displacement[for_all] - moved[for_all]
                for frame, moved in zip(frames[1:], seen.displacement[1:], strict=True)
            ]
        )
    error = np.array(errors)
    assert error.std(axis=(0, 1, 2)) == pytest.approx(cameras.noise_mm, rel=0.05)
    common = np.mean(error[:, 0] * error[:, 1], axis=(0, 1)) / np.square(cameras.noise_mm)
    assert common == pytest.approx([0.5] * 3, abs=0.05)


def test_as_many_samples_as_asked_are_clearly_beyond_a_limit_and_the_others_clearly_within() -> (
    None
):
    placing = Placing()
    for seed in range(20):
        samples = place(placing, 24, np.random.default_rng(seed))
        beyond = [abs(s.angle) > 1.0 or abs(s.x_shift) > 0.25 for s in samples]
        assert beyond == [s.beyond != "" for s in samples]
        assert sum(beyond) == placing.misplaced
        for s in samples:
            assert not 0.85 < abs(s.angle) < 1.15
            assert not 0.85 < abs(s.x_shift) / 0.25 < 1.15
    assert {s.beyond for s in samples} >= {"angle", "x_shift"}


def test_a_shift_that_leaves_no_room_beside_the_pin_is_refused() -> None:
    truth, points = analytic_truth(), np.array([[3.0, 2.0]])
    assert np.isfinite(truth.field_at(points, TRAVEL, 2.4)).all()
    with pytest.raises(ValueError, match=r"shift: expected less than 2\.5 mm, half the width"):
        truth.field_at(points, TRAVEL, -2.6)
    narrow = BlockTruth(specimen=BlockPin(width=5.0, pin_width=2.0), shift_cells=None)
    assert narrow.shift_models() == ()


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Cameras(format="vic"), "format: expected one of davis-csv"),  # type: ignore[arg-type]
        (lambda: Cameras(grid=(2, 50)), "grid: expected 4 points"),
        (lambda: Cameras(reference_share=1.0), r"reference_share: expected in \[0, 1\)"),
        (lambda: Cameras(grid=(30.5, 8)), "grid: expected 4 points"),  # type: ignore[arg-type]
        (lambda: Cameras(lost_share=2.0), r"expected shares in \[0, 1\]"),
        (lambda: Cameras(static_frames=1), "static_frames: expected 2 or more"),
        (lambda: Placing(angle_sd_deg=float("nan")), "angle_sd_deg: expected 0 or more"),
        (lambda: Rubber(relaxing_shares=(float("nan"), 0.1)), "relaxing_shares: expected shares"),
        (lambda: Protocol(increments=2.5), "increments: expected a whole number"),  # type: ignore[arg-type]
        (
            lambda: LaboratorySettings(protocol=Protocol(hold_s=10.0)),
            "trigger_s: expected between 1.2 and hold_s less that .8.8 s.",
        ),
        (lambda: LaboratorySettings(protocol=Protocol(rest_s=0.0)), "rest_s: expected more than"),
        (lambda: LaboratorySettings(samples=3), "misplaced: expected at most the 3 samples"),
        (lambda: LaboratorySettings(use=(9, 10)), "use: expected two or more increments of 1 to 9"),
        (lambda: LaboratorySettings(use=(7, 3, 3)), "use: expected two or more .* ascending"),
        (lambda: LaboratorySettings(use=(4,)), "use: expected two or more"),
        (lambda: LaboratorySettings(samples=2.5), "samples: expected a whole number"),  # type: ignore[arg-type]
        (lambda: Protocol(preconditioning_travel_mm=0.0), "preconditioning_travel_mm: expected a"),
        (lambda: Protocol(hold_s=float("inf")), "hold_s: expected a number above 0, found inf"),
        (lambda: Cameras(noise_mm=(0.005, 0.005)), "noise_mm: expected three SDs"),  # type: ignore[arg-type]
        (lambda: Cameras(noise_mm=(float("nan"), 0.0, 0.0)), "noise_mm: expected three SDs"),
        (lambda: Placing(safe_share=3.0), "safe_share: expected a share"),
        (lambda: Sensor(read_noise=float("nan")), "read_noise, gain_drift, tilt_drift: expected 0"),
        (lambda: CameraPair(pixel_mm=float("nan")), "columns, rows, pixel_mm, f_stop: expected"),
        (lambda: VirtualNoise(field_noise_std=(-1.0, 0.0, 0.0)), "field_noise_std: expected three"),
        (lambda: VirtualNoise(field_correlation_length=-1.0), "field_correlation_length: expected"),
        (
            lambda: VirtualNoise(field_reference_share=2.0),
            "field_reference_share: expected",
        ),
        (lambda: BlockTruth(specimen=BlockPin(pin="round")), "specimen: expected a straight bar"),
        (lambda: BlockTruth(specimen=BlockPin(pin_shift=(0.3, 0.0))), "specimen: expected a str"),
        (
            lambda: BlockTruth(specimen=BlockPin(width=5.0)),
            "shift_solved: .* the width of 5 mm",
        ),
        (lambda: LaboratorySettings(machine_format="x"), "machine_format: expected one of"),  # type: ignore[arg-type]
    ],
)
def test_impossible_settings_are_refused(make, text) -> None:
    with pytest.raises(ValueError, match=text):
        make()
