"""`calib dic`: image files, quality, point files that the readers read, going on, wrong input."""

import json
import sys
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
import tifffile
from PIL import Image
from scipy.ndimage import gaussian_filter
from skimage import io

from benchmarks.exact_speckle import exposed, speckle
from calib.cli import main
from calib.data.readers import read_dic
from calib.dic import (
    Correlation,
    GreyImage,
    State,
    grid_points,
    image_noise,
    next_state,
    polygon_mask,
    quality,
    read_image,
    rectangle_mask,
)
from calib.dic.follow import Base
from calib.dic.quality import period
from calib.dic_study import frame_store, run
from calib.dic_study.config import DicStudy, read_study
from calib.dic_study.exposure import weak_frame
from calib.dic_study.named_files import named_files
from calib.dic_study.point_frame import point_frame
from calib.dic_study.run import _write_strain

W, H = 160, 110
X, Y = np.arange(float(W)), np.arange(float(H))
CORNERS = "[[20.0, 20.0], [140.0, 20.0], [140.0, 90.0], [20.0, 90.0]]"
STUDY = """
[images]
reference = "a.tif"
repeat = "r.png"
deformed = ["d*.bmp"]
times_s = [1.0, 2.0]
[region]
polygon_px = [[20.0, 20.0], [140.0, 20.0], [140.0, 90.0], [20.0, 90.0]]
[correlation]
subset_px = 21
step_px = 10
[scale]
mm_per_px = 0.02
origin_px = [20.0, 90.0]
[strain]
radius_px = 25.0
"""


STRANGE = np.random.default_rng(8).integers(20, 200, (H, W)).astype(np.uint8)
# 12 bit, aligned to the left: white is 65520
CLIPPED = np.where(STRANGE < 80, 16 * 1000, 16 * 4095).astype(np.uint16)


@pytest.fixture(scope="module")
def pattern():
    return speckle(W, H, np.random.default_rng(4))


def flat(level, width=W, height=H):
    return np.full((height, width), level, np.uint8)


def grey(pattern, seed, x=X, y=Y):
    image = exposed(pattern(x, y), np.random.default_rng(seed), spread=1.7)
    return image.astype(np.uint8)


@pytest.fixture
def folder(pattern, tmp_path):
    io.imsave(tmp_path / "a.tif", grey(pattern, 0), check_contrast=False)
    io.imsave(tmp_path / "r.png", grey(pattern, 1), check_contrast=False)
    for k in (1, 2):
        image = grey(pattern, 1 + k, X / (1 + 0.02 * k), Y + 0.5 * k)
        io.imsave(tmp_path / f"d{k}.bmp", image, check_contrast=False)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def test_point_files_are_read_back_in_mm_with_y_up(folder, capsys):
    assert main(["dic", str(folder / "study.toml")]) == 0
    out = folder / "study-dic"
    (frame,) = read_dic(out / "points" / "d2.csv").frames
    assert frame.is_planar
    assert frame.time == 2.0
    assert frame.grid_shape == (8, 13)
    assert frame.n_valid == 104
    x_px = frame.position[:, 0] / 0.02 + 20
    truth = np.column_stack([0.04 * x_px, np.full(104, 1.0)]) * 0.02
    error = frame.displacement[:, :2] - truth
    assert np.abs(error).max() < 0.1 * 0.02
    assert frame.correlation_length == pytest.approx(0.02 * 21 / np.sqrt(2 * np.pi))
    assert np.std(error / frame.sigma[:, :2]) == pytest.approx(1.0, abs=0.25)
    assert frame.position[:, 1].min() == pytest.approx(0.0, abs=0.02 * 5)
    assert frame.position[:, 1].max() > 1.2
    table = np.loadtxt(out / "d2-strain.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(np.median(table[:, 2:], axis=0), [0.0408, 0, 0], atol=3e-3)
    report = json.loads((out / "dic.json").read_text())
    assert [entry["valid"] for entry in report["frames"]] == [104, 104]
    assert report["quality"]["noise"] == pytest.approx(2.55, rel=0.1)
    assert sorted(p.name for p in (out / "pictures").iterdir()) == [
        "d1-lost.png", "d1.png", "d2-lost.png", "d2.png",
    ]  # fmt: skip


@pytest.mark.lasting
def test_series_goes_on_with_the_same_bits_and_starts_again_when_images_change(
    folder, pattern, capsys
):
    study = str(folder / "study.toml")
    assert main(["dic", study]) == 0
    points = folder / "study-dic" / "points"
    whole = (points / "d2.csv").read_bytes()
    (folder / "study-dic" / "frames" / "d2.npz").write_bytes(b"torn")
    (points / "d2.csv").unlink()
    assert main(["dic", study]) == 0
    assert "d1.bmp: 104 of 104" in capsys.readouterr().out
    assert (points / "d2.csv").read_bytes() == whole
    # what is written in mm follows the scale, though nothing is measured again
    (folder / "study.toml").write_text(STUDY.replace("= 0.02", "= 0.04"))
    assert main(["dic", study]) == 0
    assert capsys.readouterr().out.count("(kept)") == 2
    (twice,) = read_dic(points / "d2.csv").frames
    assert np.ptp(twice.position[:, 0]) == pytest.approx(0.04 * 120, rel=1e-6)
    io.imsave(folder / "d1.bmp", grey(pattern, 9, X + 1.0), check_contrast=False)
    assert main(["dic", study]) == 0
    last = capsys.readouterr().out
    assert last.count("(measured)") == 2


@pytest.mark.parametrize("renewed", [None, 2, 3])
def test_a_stored_frame_brings_back_the_state_with_its_renewed_reference(tmp_path, renewed):
    rng = np.random.default_rng(1)
    image = GreyImage("x", rng.random((9, 8)), 255.0)

    def base(number):
        n = 3
        found = Correlation(
            rng.random((n, 2)), rng.random((n, 2, 2)), rng.random(n), rng.random((n, 2)),
            rng.random((n, 2)),
            np.arange(n), np.arange(n), rng.random((n, 6)),
        )  # fmt: skip
        return Base(number, image.grey, found)

    before = State(base(3), base(2))
    known = {None: None, 2: before.base, 3: before.last}[renewed]
    after = State(base(4), known)
    frame_store.save(tmp_path / "f.npz", "key", [after])
    assert frame_store.load(tmp_path / "f.npz", "other", [before], [image]) is None
    (state,) = frame_store.load(tmp_path / "f.npz", "key", [before], [image])
    assert state.base is known
    assert state.last.number == 4
    for name, value in vars(after.last.found).items():
        np.testing.assert_array_equal(getattr(state.last.found, name), value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("a.tif", "b.tif"), "b.tif: found no such file, expected an image"),
        (("d*.bmp", "e*.bmp"), 'study.toml:5: images.deformed: found "e*.bmp", expected the patt'),
        (('["d*.bmp"]', '["d1.bmp", "d1.tif"]'), "images.deformed: found \"d1\", expected each na"),
        (("[1.0, 2.0]", "[1.0]"), "study.toml:6: images.times_s: found [1.0], expected 2 times"),
        (("= 21", "= 20"), "subset_px: found 20, expected an odd number of px"),
        (
            (CORNERS, "[[20.0, 20.0], [950.0, 20.0], [950.0, 90.0]]"),
            "study.toml:8: region.polygon_px: found [[20.0, 20.0], [950.0, 20.0], [950.0, 90.0]], "
            "expected a place within a.tif, x from 0 to 160 and y from 0 to 110 px",
        ),
        (
            ("polygon_px = " + CORNERS, "rectangle_px = [20, 20, 161, 90]"),
            "study.toml:8: region.rectangle_px: found [20.0, 20.0, 161.0, 90.0], expected a place",
        ),
        (
            ("[region]", "[region]\nrectangle_px = [0, 0, 15, 15]"),
            "region: expected a pixel that rectangle_px and polygon_px have in common, found none",
        ),
        (("mm_per_px = 0.02", "mm_per_px = 0.0"), "mm_per_px: found 0"),
        (("a.tif", "more"), "more: found a folder, expected an image"),
        (
            ("polygon_px = " + CORNERS, "rectangle_px = [20, 20, 21, 21]"),
            "region: expected room for 25% of a subset of 21 px about a point, found at most 0.2% "
            "in 1 x 1 px",
        ),
        (
            (CORNERS, "[[20, 20], [20, 20], [20, 20]]"),
            "region.polygon_px: found [[20.0, 20.0], [20.0, 20.0], [20.0, 20.0]], expected corners",
        ),
        (
            (CORNERS, "[[20, 20], [140, 90], [140, 20], [20, 90]]"),
            "expected corners one after the other around an area, whose sides do not cross",
        ),
        (
            ("[1.0, 2.0]", "[2.0, 1.0]"),
            "study.toml:6: images.times_s: found [2.0, 1.0], expected times that go on",
        ),
        (
            ("polygon_px = " + CORNERS, "rectangle_px = [20, 20, 140, 22]"),
            "found at most 9.5% in 120 x 2 px; it needs a larger region or smaller subsets",
        ),
    ],
)  # fmt: skip
def test_wrong_studies_are_refused_in_one_sentence(folder, capsys, change, message):
    (folder / "more").mkdir()
    text = (folder / "study.toml").read_text()
    assert change[0] in text
    (folder / "study.toml").write_text(text.replace(*change))
    assert main(["dic", str(folder / "study.toml")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert "Traceback" not in error


@pytest.mark.parametrize(
    ("name", "image", "message"),
    [
        ("d2.bmp", flat(7, 60, 50), "d2.bmp: expected 160 x 110 px as in a.tif, found 60 x 50"),
        ("a.tif", flat(255), "a.tif: expected an exposed image, found more than 50% of the region"),
        ("a.tif", flat(99), "a.tif: expected speckle in the region, found grey levels of 99"),
        ("a.tif", CLIPPED, "an exposed image, found more than 50% of the region clipped"),
        ("r.png", flat(7), "r.png: expected speckle in the region, found grey levels of 7"),
        ("r.png", STRANGE, "r.png: expected a second image of what a.tif shows, found"),
        ("a.tif", np.zeros((H, W), np.float32), "expected 8 to 16 bit grey levels, found float32"),
    ],
)  # fmt: skip
def test_wrong_images_are_refused_in_one_sentence(folder, capsys, name, image, message):
    io.imsave(folder / name, image, check_contrast=False)
    assert main(["dic", str(folder / "study.toml")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.lasting
def test_a_frame_without_points_is_told_and_a_series_without_any_is_refused(folder, capsys):
    io.imsave(folder / "d2.bmp", flat(255), check_contrast=False)
    assert main(["dic", str(folder / "study.toml")]) == 0
    out = capsys.readouterr().out
    assert "warning: no point was found in d2.bmp: expected an exposed image" in out
    io.imsave(folder / "d1.bmp", speckle(W, H, np.random.default_rng(9))(X, Y).astype(np.uint8))
    assert main(["dic", str(folder / "study.toml")]) == 2
    seen = capsys.readouterr()
    assert "no point was found in d1.bmp: expected the speckle of the reference image" in seen.out
    assert "images of the speckle of a.tif, found none of its points in any" in seen.err
    assert seen.err.count("\n") == 1
    assert (folder / "study-dic" / "dic.json").exists()


@pytest.mark.lasting
def test_frames_that_a_study_no_longer_names_leave_no_points_behind(folder, capsys):
    assert main(["dic", str(folder / "study.toml")]) == 0
    points = folder / "study-dic" / "points"
    assert (points / "d2.csv").exists()
    text = (folder / "study.toml").read_text().replace("d*.bmp", "d1.bmp")
    (folder / "study.toml").write_text(text.replace("[1.0, 2.0]", "[1.0]"))
    assert main(["dic", str(folder / "study.toml")]) == 0
    assert "removed the results of d2, which the study no longer names" in capsys.readouterr().out
    assert [path.name for path in points.iterdir()] == ["d1.csv"]


def test_frames_of_a_run_that_was_stopped_leave_no_points_behind_either(folder, monkeypatch):
    points, measured = folder / "study-dic" / "points", []

    def stopped_at_the_second(*given):
        if measured:
            raise KeyboardInterrupt
        measured.append(given)
        return next_state(*given)

    with monkeypatch.context() as patch:
        patch.setattr(sys.modules["calib.dic_study.run"], "next_state", stopped_at_the_second)
        assert main(["dic", str(folder / "study.toml")]) != 0
    assert [path.name for path in points.iterdir()] == ["d1.csv"]
    text = (folder / "study.toml").read_text().replace("d*.bmp", "d2.bmp")
    (folder / "study.toml").write_text(text.replace("[1.0, 2.0]", "[2.0]"))
    assert main(["dic", str(folder / "study.toml")]) == 0
    assert [path.name for path in points.iterdir()] == ["d2.csv"]
    (folder / "study.toml").write_text(text.replace("[1.0, 2.0]", "[2.0]").replace("= 21", "= 25"))
    with monkeypatch.context() as patch:
        patch.setattr(sys.modules["calib.dic_study.run"], "next_state", stopped_at_the_second)
        assert main(["dic", str(folder / "study.toml")]) != 0
    assert not list(points.iterdir()), "points of other settings"


def test_frames_after_one_whose_image_changed_are_gone_when_the_run_is_stopped(
    folder, pattern, monkeypatch
):
    assert main(["dic", str(folder / "study.toml")]) == 0
    points = folder / "study-dic" / "points"
    io.imsave(folder / "d1.bmp", grey(pattern, 9, X + 1.0), check_contrast=False)

    def stopped(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["calib.dic_study.run"], "next_state", stopped)
    assert main(["dic", str(folder / "study.toml")]) != 0
    assert not list(points.iterdir()), "d2 was followed from the d1 of before"


def test_strains_and_points_of_a_sheared_field_are_with_y_up(folder, tmp_path):
    """U = 0.03 y and v = 0.01 x with y down are shears of the other sign with y up."""
    study = read_study(folder / "study.toml").checked(DicStudy)
    along = np.arange(0.0, 60, 10)
    x, y = (places.ravel() for places in np.meshgrid(along, along))
    points, n = np.column_stack([x, y]), 36
    found = Correlation(
        displacement=np.column_stack([0.03 * y, 0.01 * x]),
        gradient=np.zeros((n, 2, 2)),
        zncc=np.ones(n),
        sigma=np.full((n, 2), [0.03, 0.06]),
        interpolation=np.full((n, 2), [0.04, 0.08]),
        reason=np.zeros(n, dtype=np.int64),
        iterations=np.ones(n, dtype=np.int64),
        parameters=np.zeros((n, 6)),
    )
    assert _write_strain(tmp_path / "s.csv", found, points, study)
    table = np.loadtxt(tmp_path / "s.csv", delimiter=",", skiprows=1)
    up = np.array([[0.0, -0.03], [-0.01, 0.0]])
    E = 0.5 * (up + up.T + up.T @ up)
    np.testing.assert_allclose(table[:, 2:], [[E[0, 0], E[1, 1], E[0, 1]]] * n, atol=1e-8)
    frame = point_frame("s", points, found, study.scale, (6, 6))
    # by noise and by interpolation
    np.testing.assert_allclose(frame.sigma[:, :2], [[0.02 * 0.05, 0.02 * 0.10]] * n)
    np.testing.assert_allclose(frame.displacement[:, 1], -0.02 * 0.01 * x)


def test_a_jpeg_is_refused_whatever_its_name(tmp_path):
    io.imsave(tmp_path / "a.jpg", STRANGE, check_contrast=False)
    (tmp_path / "a.jpg").rename(tmp_path / "a.png")
    with pytest.raises(ValueError, match=r"a\.png: expected .* without losses .*found a JPEG"):
        read_image(tmp_path / "a.png")


@pytest.mark.parametrize(
    ("kind", "options", "found"),
    [
        ("TIFF", {"compression": "jpeg"}, "a TIFF that holds a JPEG"),
        ("WEBP", {"quality": 75}, "one that starts with b'RIFF"),
    ],
)
def test_pictures_with_losses_are_refused_in_other_files_too(tmp_path, kind, options, found):
    Image.fromarray(STRANGE).save(tmp_path / "a.tif", kind, **options)
    with pytest.raises(ValueError, match=rf"a\.tif: expected .*TIFF, PNG or BMP.* found {found}"):
        read_image(tmp_path / "a.tif")


def test_transparent_pictures_are_refused(tmp_path):
    """A mask may be drawn by what is transparent, whose colours say nothing."""
    colours = np.stack([STRANGE, STRANGE, STRANGE, np.full_like(STRANGE, 255)], axis=2)
    io.imsave(tmp_path / "a.png", colours, check_contrast=False)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png").grey, STRANGE)
    colours[:20, :, 3] = 0
    io.imsave(tmp_path / "a.png", colours, check_contrast=False)
    with pytest.raises(ValueError, match=r"a\.png: expected an opaque image, found pixels that"):
        read_image(tmp_path / "a.png")


@pytest.mark.filterwarnings("error")
def test_of_a_damaged_file_decoders_say_nothing_of_their_own(tmp_path, capfd, caplog):
    Image.fromarray(STRANGE).save(tmp_path / "a.tif")
    whole = (tmp_path / "a.tif").read_bytes()
    for content in (whole[:8] + b"\xff" * 200, whole[: len(whole) * 6 // 10], b"II*\0"):
        (tmp_path / "a.tif").write_bytes(content)
        with pytest.raises(ValueError, match="expected a whole TIFF, PNG or BMP file, found"):
            read_image(tmp_path / "a.tif")
    assert capfd.readouterr() == ("", "") and not caplog.records


def test_a_picture_that_is_there_twice_is_told(folder, pattern, capsys):
    for name in ("d1.bmp", "d2.bmp"):
        io.imsave(folder / name, io.imread(folder / "a.tif"), check_contrast=False)
    assert main(["dic", str(folder / "study.toml")]) == 0
    out = capsys.readouterr().out
    for name in ("d1.bmp", "d2.bmp"):
        assert f"warning: {name} is pixel for pixel a.tif, expected a picture with noise" in out
    io.imsave(folder / "d1.bmp", grey(pattern, 11), check_contrast=False)
    io.imsave(folder / "d2.bmp", grey(pattern, 12), check_contrast=False)
    assert main(["dic", str(folder / "study.toml")]) == 0
    assert "pixel for pixel" not in capsys.readouterr().out
    io.imsave(folder / "d2.bmp", grey(pattern, 11), check_contrast=False)
    assert main(["dic", str(folder / "study.toml")]) == 0
    assert "d2.bmp is pixel for pixel d1.bmp" in capsys.readouterr().out


def test_frames_that_correlate_poorly_are_told():
    image, valid = GreyImage("d.tif", np.ones((2, 2)), 255.0), np.array([True, True, True, False])

    def of(*zncc):
        return weak_frame(image, SimpleNamespace(zncc=np.array(zncc), valid=valid))

    assert of(0.95, 0.91, 0.3, 0.1) is None
    assert "is 0.89, expected 0.9 or more: standard deviations may be a third too small" in of(
        0.95, 0.89, 0.3, 1.0
    )
    assert "may be half of what they should be" in of(0.95, 0.82, 0.3, 1.0)


def test_strains_that_a_study_no_longer_asks_for_do_not_stay(folder):
    assert main(["dic", str(folder / "study.toml")]) == 0
    assert (folder / "study-dic" / "d1-strain.csv").exists()
    (folder / "study.toml").write_text(STUDY[: STUDY.index("[strain]")])
    assert main(["dic", str(folder / "study.toml")]) == 0
    assert not list((folder / "study-dic").glob("*-strain.csv"))


def test_a_link_to_nothing_among_images_is_refused(tmp_path):
    (tmp_path / "d1.bmp").touch()
    (tmp_path / "d2.bmp").symlink_to(tmp_path / "gone.bmp")
    with pytest.raises(ValueError, match=r"d2\.bmp: expected an image, found a link to nothing"):
        named_files(("d*.bmp",), tmp_path, "images.deformed", set())


@pytest.mark.parametrize("side", [8, 14])
def test_a_pattern_that_repeats_itself_is_told(side):
    x, y = np.arange(160), np.arange(110)[:, None]
    mask = np.ones((110, 160), dtype=bool)
    board = 100.0 + 60.0 * ((x // side + y // side) % 2)
    board += np.random.default_rng(1).normal(0, 3, board.shape) + 2.0 * x  # uneven light
    text = " ".join(quality(GreyImage("x", board, 255.0), mask, 31).warnings)
    assert f"the pattern repeats itself every {side * np.sqrt(2):.0f} px" in text
    stripes = np.where(x // side % 2 + 0 * y, 60.0, 160.0)
    assert period(stripes, mask, 31) == pytest.approx(2 * side, abs=1)


def test_few_speckles_at_random_are_no_pattern():
    """Of 40 pictures with some 20 speckles each none is taken for one."""
    rng, mask = np.random.default_rng(2), np.ones((35, 45), dtype=bool)
    for _ in range(40):
        image = 120.0 + 40.0 * gaussian_filter(rng.standard_normal(mask.shape), 3.0) * 10.0
        assert np.isnan(period(image, mask, 21))


def test_a_noisy_frame_is_told_by_the_command(folder, pattern, capsys):
    noisy = exposed(pattern(X, Y), np.random.default_rng(3), noise=32.0, spread=1.7)
    io.imsave(folder / "d2.bmp", noisy.astype(np.uint8), check_contrast=False)
    assert main(["dic", str(folder / "study.toml")]) == 0
    said = [line for line in capsys.readouterr().out.splitlines() if "median correlation" in line]
    assert len(said) == 1 and said[0].startswith("warning: d2.bmp: the median correlation of its")


def test_patterns_are_of_the_study_s_folder_or_absolute(tmp_path):
    folder = tmp_path / "run [1]"
    folder.mkdir()
    for name in ("d2.bmp", "d1.bmp", "a.bmp"):
        (folder / name).touch()
    expected = (folder / "d1.bmp", folder / "d2.bmp")
    assert named_files(("d*.bmp",), folder, "images.deformed", set()) == expected
    found = named_files(("*.bmp",), folder, "images.deformed", {"../run [1]/a.bmp"})
    assert found == expected
    plain = tmp_path / "plain"
    folder.rename(plain)
    found = named_files((str(plain / "*.bmp"),), tmp_path, "images.deformed", {"plain/a.bmp"})
    assert found == (plain / "d1.bmp", plain / "d2.bmp")


def test_images_of_a_pattern_come_by_their_numbers_as_frames_are_read(tmp_path):
    numbers = (1, 2, 9, 10, 11, 100)
    for number in numbers:
        (tmp_path / f"img_{number}.tif").touch()
    found = named_files(("img_*.tif",), tmp_path, "images.deformed", set())
    assert [path.name for path in found] == [f"img_{number}.tif" for number in numbers]


def test_file_that_is_no_image_is_refused(tmp_path):
    (tmp_path / "x.tif").write_text("no image")
    words = (
        r"x\.tif: expected a whole TIFF, PNG or BMP file, found one that starts with b'no image'"
    )
    with pytest.raises(ValueError, match=words):
        read_image(tmp_path / "x.tif")


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_a_tiff_file_in_which_0_is_white_is_read_as_it_is_shown(tmp_path, kind):
    most = np.iinfo(kind).max
    shown = np.random.default_rng(0).integers(0, most, (20, 30), dtype=kind, endpoint=True)
    tifffile.imwrite(tmp_path / "x.tif", most - shown, photometric="miniswhite")
    np.testing.assert_array_equal(read_image(tmp_path / "x.tif").grey, shown)
    # a tag of orientation turns no image, inverted or not
    turned = [(274, "H", 1, 6, True)]
    tifffile.imwrite(tmp_path / "x.tif", most - shown, photometric="miniswhite", extratags=turned)
    np.testing.assert_array_equal(read_image(tmp_path / "x.tif").grey, shown)


def test_tiff_files_that_are_not_one_picture_of_levels_are_refused(tmp_path):
    pages = np.random.default_rng(0).integers(0, 255, (3, 20, 30), dtype=np.uint8)
    path = tmp_path / "x.tif"

    def save(*frames, **options):
        first, *later = (Image.fromarray(frame, **options) for frame in frames)
        first.save(path, save_all=True, append_images=later)

    for frames in (pages[:2], pages):
        save(*frames)
        with pytest.raises(ValueError, match=f"expected a file of one image, found {len(frames)}"):
            read_image(path)
    tifffile.imwrite(path, pages, photometric="minisblack")  # read as three colours otherwise
    with pytest.raises(ValueError, match="found 3 pages of one size"):
        read_image(path)
    Image.fromarray(pages[0]).convert("P").save(path)  # greys in their order
    np.testing.assert_array_equal(read_image(path).grey, pages[0])
    turned = Image.fromarray(pages[0]).convert("P")
    turned.putpalette([level for grey in range(255, -1, -1) for level in (grey, grey, grey)])
    turned.save(path)
    with pytest.raises(ValueError, match="expected grey levels or RGB colours, found a palette"):
        read_image(path)
    Image.fromarray(np.moveaxis(pages, 0, 2)).convert("CMYK").save(path)
    with pytest.raises(ValueError, match=r"found four printing inks \(CMYK\)"):
        read_image(path)
    save(pages[0], pages[1][::4, ::4])  # with a thumbnail
    np.testing.assert_array_equal(read_image(path).grey, pages[0])


def test_images_of_16_bit_keep_their_grey_levels_and_find_their_scale(tmp_path):
    values = np.arange(4000, dtype=np.uint16).reshape(50, 80)
    io.imsave(tmp_path / "x.png", values, check_contrast=False)
    image = read_image(tmp_path / "x.png")
    np.testing.assert_array_equal(image.grey, values)
    assert image.full_scale == 4095
    colour = np.stack([values.astype(np.uint8)] * 3, axis=-1)
    io.imsave(tmp_path / "y.bmp", colour, check_contrast=False)
    np.testing.assert_array_equal(read_image(tmp_path / "y.bmp").grey, values.astype(np.uint8))


def test_quality_finds_speckle_size_noise_and_gradient_of_a_known_pattern(pattern):
    mask = np.ones((H, W), dtype=bool)
    clean = 127.5 + pattern(X, Y) * 45 / 1.7
    rng = np.random.default_rng(0)
    a, b = (GreyImage("x", clean + rng.normal(0, 3, (H, W)), 255.0) for _ in range(2))
    found = quality(a, mask, 31, b)
    # the autocorrelation of Gaussian spots of SD r is a Gaussian of SD r sqrt 2
    assert found.speckle == pytest.approx(1.5 * np.sqrt(2) * 2.3548, rel=0.12)
    assert found.noise == pytest.approx(3, rel=0.03)
    other = 0.8 * clean + 5 + rng.normal(0, 3, (H, W))
    assert image_noise(a.grey, other, mask) == pytest.approx(3, rel=0.03)
    slopes = np.gradient(clean)
    assert found.mean_gradient == pytest.approx(np.mean(np.hypot(*slopes)), rel=0.15)
    assert found.warnings == ()
    dull = GreyImage("x", np.clip(250 + (a.grey - 127.5) / 4, 0, 255), 255.0)
    text = " ".join(quality(dull, mask, 11).warnings)
    assert "saturated" in text
    assert "a subset of 11 px has few speckles" in text


def test_a_repeat_that_is_the_reference_itself_and_a_strain_without_neighbours_are_told(
    folder, capsys
):
    text = STUDY.replace("radius_px = 25.0", "radius_px = 5.0").replace("r.png", "same.png")
    (folder / "same.png").write_bytes((folder / "a.tif").read_bytes())
    (folder / "study.toml").write_text(text)
    assert main(["dic", str(folder / "study.toml")]) == 0
    said = capsys.readouterr().out
    assert "warning: same.png is pixel for pixel a.tif, so it shows no noise" in said
    assert "warning: strain.radius_px: found no point with enough neighbours within it" in said


def test_progress_within_an_image_begins_at_nothing_and_ends_with_all_points(folder):
    told, labels = {}, []

    @contextmanager
    def bars(label):
        labels.append(label)
        yield lambda done, total: told.setdefault(label, []).append((done, total))

    run(folder / "study.toml", None, lambda line: None, bars)
    assert labels == ["d1.bmp", "d2.bmp"]
    for steps in told.values():
        assert steps[0] == (0, 104) and steps[-1] == (104, 104)
        assert steps == sorted(steps)
    told.clear()
    run(folder / "study.toml", None, lambda line: None, bars)
    assert not told


def test_region_and_grid_are_in_px_of_the_image():
    box = rectangle_mask((40, 60), (10, 5, 31, 26))
    assert box.sum() == 21 * 21
    assert (box == polygon_mask((40, 60), [(10, 5), (30, 5), (30, 25), (10, 25)])).mean() > 0.98
    points, shape = grid_points(box, 10)
    assert shape == (3, 3)
    np.testing.assert_array_equal(points[:4], [[10, 5], [20, 5], [30, 5], [10, 15]])
    with pytest.raises(ValueError, match="rectangle: expected a region in the image of 60 x 40 px"):
        rectangle_mask((40, 60), (100, 5, 200, 26))
