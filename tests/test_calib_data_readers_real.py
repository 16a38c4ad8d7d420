"""Readers on real files, which are no part of softcal: SOFTCAL_DATA names their folder.

What is expected comes from the README files beside the data: their upstream readers' tests, the
numbers of rows, and checks of one column against another.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.verify_data import FORMATS, data_folder, real_files
from calib.data.readers import WrongFile, read_dic, read_machine
from calib.data.readers.matchid import VOLTS

DATA = data_folder()
EXPORTS = DATA / "dic_exports"
pytestmark = pytest.mark.skipif(
    not EXPORTS.exists(), reason=f"no real files in {DATA}; set SOFTCAL_DATA"
)


def test_each_real_file_is_recognised_by_one_reader_and_refused_by_the_others():
    files = real_files(DATA)
    expected = {
        "DaVis csv": 2, "MatchID 2023 csv": 2, "MatchID 2024 csv": 2, "DICe text": 6,
        "DuoDIC mat": 1, "Instron Bluehill csv": 5, "phantom cylinder csv": 8,
        "DaVis load csv": 1, "MatchID load csv": 2,
    }  # fmt: skip
    assert {name: len(paths) for name, paths in files.items() if paths} == expected
    for name, paths in files.items():
        for form in FORMATS:
            if form.name != name and paths:
                with pytest.raises(WrongFile):
                    form.read_file(paths[0])


def test_davis_points_differ_from_frame_to_frame_and_positions_are_of_the_reference():
    series = read_dic(EXPORTS / "davis")
    assert [frame.valid.size for frame in series.frames] == [4053, 3855]
    assert [frame.n_valid for frame in series.frames] == [4053, 3855]
    assert any("davis_load.csv" in note for note in series.notes)
    first, last = ({tuple(p[:2]): p[2] for p in frame.position.tolist()} for frame in series.frames)
    assert set(last) < set(first)
    assert all(first[place] == z for place, z in last.items())
    np.testing.assert_allclose(series.frames[1].displacement[0], [-0.771192, 0.079523, -0.050573])


@pytest.mark.parametrize("generation", ["matchid_2023", "matchid_2024"])
def test_matchid_points_have_the_same_reference_in_all_frames(generation):
    first, last = read_dic(EXPORTS / generation).frames
    assert first.n_valid == first.valid.size  # zeros of the reference frame are measured
    # as written, positions of the two frames differ by up to 0.75 mm in 2023
    gap = np.abs(first.position[:, None, :2] - last.position[None, :, :2]).sum(axis=2)
    match = gap.argmin(axis=1)
    np.testing.assert_allclose(first.position, last.position[match], atol=2e-4)


def test_forces_are_those_that_the_upstream_readers_expect():
    load = read_machine(EXPORTS / "davis" / "davis_load.csv")
    assert load.force[load.frame == 1].tolist() == [197.614]
    assert np.any(np.abs(load.force - 1086.025) < 1e-9)
    assert load.time[0] == pytest.approx(0.34872615)


def test_matchid_load_has_newtons_where_the_frames_repeat_the_volts():
    load = read_machine(EXPORTS / "matchid_2024" / "Image.csv")
    assert load.force[load.frame == 0][0] == pytest.approx(70.4518668780285)
    series = read_dic(EXPORTS / "matchid_2024")
    assert VOLTS in series.notes
    assert [frame.time for frame in series.frames] == [0.0, 6.99997]
    with pytest.raises(WrongFile, match="unit of force"):
        read_machine(EXPORTS / "matchid_2023" / "matchid_load.csv")


def test_dice_results_of_all_kinds_are_read():
    full = read_dic(EXPORTS / "dice" / "full_field_DICe_solution_0.txt", 0.01).frames[0]
    assert full.valid.size == full.n_valid == 972
    np.testing.assert_allclose(full.position[0], [0.46, -3.66, 0])
    np.testing.assert_allclose(full.displacement[0], [-8.6941e-4, 6.9080e-3, 0])
    np.testing.assert_allclose(full.sigma[0, :2], 1.1284e-4)
    stereo = read_dic(EXPORTS / "dice" / "stereo_dogbone_DICe_solution_2.txt", 0.01).frames[0]
    assert (stereo.valid.size, stereo.n_valid) == (412, 408)
    single = read_dic(EXPORTS / "dice" / "single_speckled_shift_1.txt", 0.01)
    np.testing.assert_allclose(single.frames[0].displacement[0], [3.97e-3, -4.1771e-3, 0])


def test_a_folder_with_a_calibration_among_results_is_refused():
    with pytest.raises(WrongFile, match=r"cal_a\.txt:1"):
        read_dic(EXPORTS / "dice", 0.01)


def test_dice_at_rest_has_the_noise_that_its_readme_states():
    moved = read_dic(DATA / "stereo_static_pair" / "gold" / "DICe_solution_auto_1.txt", 1.0)
    rms = np.sqrt(np.nanmean(moved.frames[0].displacement[:, :2] ** 2))
    assert 0.002 < rms < 0.02  # some 0.01 px


def test_duodic_pair_is_read_as_one_camera():
    series = read_dic(EXPORTS / "ncorr_mat" / "DIC2DpairResults.mat", 0.02)
    assert len(series.frames) == 20
    assert {frame.valid.size for frame in series.frames} == {435}
    np.testing.assert_allclose(series.frames[0].position[0], [573 * 0.02, -1354 * 0.02, 0])
    # the second image of the first camera is the third array: cameras follow one another
    assert np.nanmax(np.abs(series.frames[0].displacement)) == 0
    steps = [np.nanmean(frame.displacement[:, 0]) for frame in series.frames]
    assert np.all(np.abs(np.diff(steps)) < 1)


@pytest.mark.parametrize("number", [1, 3])
def test_bluehill_stress_is_load_by_the_area_of_its_head(number):
    path = DATA / "utm_exports/instron_bluehill3" / f"No_IDs_Specimen_RawData_{number}.csv"
    record = read_machine(path)
    thickness, width = (float(record.metadata[name].split()[0]) for name in ("Thickness", "Width"))
    stress = [
        float(line.split('"')[-2].replace(",", "")) for line in path.read_text().splitlines()[11:]
    ]
    np.testing.assert_allclose(record.force / (thickness * width), stress, atol=6e-5)
    assert record.positive == "tension"


def test_cylinders_have_the_stresses_of_the_readme():
    stresses = []
    for number in range(1, 6):
        folder = DATA / "ecoflex_compression_cylinders"
        record = read_machine(folder / f"EF30_0T_A{number}.csv")
        assert record.positive == "compression"
        assert record.metadata["Cylinder Diameter"] == "50mm"
        stretch = 1 - record.travel / 30
        stress = -record.force / (np.pi * 25**2) * 1e3
        wanted = [0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4]
        stresses.append(np.interp(wanted, stretch[::-1], stress[::-1]))
    stated = [-5.06, -11.02, -24.08, -40.21, -63.53, -107.5, -213.2]
    np.testing.assert_allclose(np.mean(stresses, axis=0), stated, rtol=2e-3)


def test_torsion_is_refused_and_kilonewtons_are_converted():
    samples = DATA / "utm_exports" / "matmech_samples"
    assert read_machine(samples / "sample_bluehill.csv").force.min() == -1500.0
    with pytest.raises(WrongFile, match="column 'Load'"):
        read_machine(samples / "sample_wavematrix_torsion.csv")


def test_other_files_of_the_collection_are_refused_by_the_door():
    others = ["rubber_multiaxial", "soft_robotics_tension", "stereo_calibration_dots"]
    paths = [path for name in others for path in (DATA / name).glob("*") if path.is_file()]
    assert len(paths) > 20
    for path in paths:
        for read in (read_dic, read_machine):
            with pytest.raises(WrongFile, match="expected"):
                read(path)
