"""One small file of each format the readers know, written by hand as the programs write them.

They are the seeds that `reader_mutants` damages, and what the tests read without the real files.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import scipy.io

from calib.data.readers import MachineRecord, PointFrame, write_machine, write_points

N_ROWS, N_COLUMNS = 4, 5
MM_PER_PX = 0.01


def grid() -> tuple[np.ndarray, np.ndarray]:
    """Positions (20, 3) and displacements (20, 3) of a small field, mm, row after row upwards."""
    y, x = np.indices((N_ROWS, N_COLUMNS)).reshape(2, -1) * 0.5
    position = np.column_stack([x + 0.25, y + 0.25, 0.125 * x])
    displacement = np.column_stack([0.01 * x + 0.001, -0.02 * y - 0.002, 0.003 + 0.001 * x * y])
    return position, displacement


def _rows(separator: str, *columns: np.ndarray, form: str = "{:.6f}") -> list[str]:
    return [
        separator.join(form.format(value) for value in row)
        for row in np.column_stack(columns).tolist()
    ]


def _text(lines: list[str], end: str = "\n", encoding: str = "utf-8") -> bytes:
    return (end.join(lines) + end).encode(encoding)


def davis_tecplot() -> bytes:
    """The second row of points is hidden: isValid 0 and false zeros."""
    position, displacement = grid()
    valid = np.repeat([1, 0, 1, 1], N_COLUMNS)
    displacement = displacement * valid[:, None]
    names = ["x [mm]", "y [mm]", "z [mm]"]
    names += [f"{axis}-displacement [mm]" for axis in "XYZ"] + ["isValid"]
    quoted = ", ".join(f'"{name}"' for name in names)
    head = [
        'TITLE = "B0003"',
        f"VARIABLES = {quoted}",
        f'ZONE T="Frame 0", I={N_COLUMNS}, J={N_ROWS}, F=POINT',
        "STRANDID=1, SOLUTIONTIME=1.5",
    ]
    return _text(head + _rows(" ", position, displacement, valid, form="{:g}"), "\r\n")


def davis_csv() -> bytes:
    """Latin-1 for the degree sign."""
    position, displacement = grid()
    names = ["x [mm]", "y [mm]", "z [mm]"]
    names += [f"{axis}-displacement [mm]" for axis in "XYZ"] + ["Exx [S]", "Angle [°]"]
    strain = np.full(len(position), 0.01)
    rows = _rows(";", position, displacement, strain, strain)
    return _text([";".join(names), *rows], encoding="latin-1")


def davis_csv_decimal_comma() -> bytes:
    """The same as a German computer writes it."""
    head, _, body = davis_csv().partition(b"\n")
    return head + b"\n" + body.replace(b".", b",")


def matchid_2023() -> bytes:
    """Positions of the deformed state."""
    position, displacement = grid()
    pixels = np.round(position[:, :2] * 100)
    rows = _rows(",", pixels, position + displacement, displacement, form="{:.5E}")
    return _text(["x_pic,y_pic,x,y,z,u,v,w", *rows])


def matchid_2024() -> bytes:
    """With the force column that repeats the volts."""
    position, displacement = grid()
    pixels = np.round(position[:, :2] * 100)
    extra = np.tile([7, 6.99997, 0.2818], (len(position), 1))
    names = [
        "Coordinates.Image X [Pixel]", "Coordinates.Image Y [Pixel]",
        "coor.X [mm]", "coor.Y [mm]", "coor.Z [mm]",
        "disp.Horizontal Displacement U [mm]", "disp.Vertical Displacement V [mm]",
        "disp.Out-Of-Plane: W [mm]", "ext.Current Image [#]", "ext.Time [s]", "ext.Force [N]",
    ]  # fmt: skip
    rows = _rows(",", pixels, position + displacement, displacement, extra, form="{:.5E}")
    return _text([",".join(names), *rows])


def dice() -> bytes:
    """Pixels of 0.01 mm with rows downwards; the last subset failed."""
    position, displacement = grid()
    down = np.array([1, -1])
    sigma = np.full(len(position), 0.02)
    match = np.zeros(len(position))
    pixels, moved = position[:, :2] * down / MM_PER_PX, displacement[:, :2] * down / MM_PER_PX
    sigma[-1], match[-1], moved[-1] = -1, -1, 0
    names = "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,GAMMA,MATCH"
    head = ["***", "*** Digital Image Correlation Engine (DICe)", "*** DIC method : local ", "***"]
    number = np.arange(len(position))
    rows = _rows(",", number, pixels, moved, sigma, sigma, match, form="{:.8E}")
    return _text([*head, names, *rows])


def dice_subset() -> bytes:
    """One subset through three frames, blanks between."""
    rows = [f"{n} 1.25E+02 3.5E+01 {n * 0.4:.4E} {n * 0.2:.4E} 1.36E-02 1.0E+00" for n in range(3)]
    names = "FRAME COORDINATE_X COORDINATE_Y DISPLACEMENT_X DISPLACEMENT_Y SIGMA STATUS_FLAG"
    return _text(["***", "*** DICe", "***", names, *rows])


def vic3d() -> bytes:
    """Quoted names, blanks after commas, a failed point with sigma -1 and zeros."""
    position, displacement = grid()
    sigma = np.full((len(position), 1), 0.01)
    values = np.hstack([position, displacement, sigma, position[:, :2] * 100])
    values[3] = [0, 0, 0, 0, 0, 0, -1, 200, 30]
    names = ["X", "Y", "Z", "U", "V", "W", "sigma", "x", "y"]
    return _text([", ".join(f'"{name}"' for name in names), *_rows(", ", values)])


def ncorr_fields() -> dict[str, object]:
    """Two frames on a grid of every third pixel, 0.01 mm a pixel; the first row is outside."""
    _, displacement = grid()
    frames = []
    for share in (0.5, 1.0):
        u = share * displacement[:, 0].reshape(N_ROWS, N_COLUMNS)
        v = -share * displacement[:, 1].reshape(N_ROWS, N_COLUMNS)
        u[0], v[0] = 0.0, 0.0
        frames.append({"plot_u_ref_formatted": u, "plot_v_ref_formatted": v})
    info = {"pixtounits": MM_PER_PX, "units": "mm", "spacing": 2.0, "radius": 20.0}
    names = list(frames[0])
    array = np.empty((1, len(frames)), dtype=[(name, object) for name in names])
    for index, frame in enumerate(frames):
        for name in names:
            array[0, index][name] = frame[name]
    return {"displacements": array, "dispinfo": info}


def ncorr(do_compression: bool = True) -> bytes:
    """MATLAB 5 as `save` writes it, compressed, with another variable before."""
    file = io.BytesIO()
    variables = {"reference_save": np.zeros((4, 4)), "data_dic_save": ncorr_fields()}
    scipy.io.savemat(file, variables, do_compression=do_compression)
    return _fixed_date(file.getvalue())


def _fixed_date(data: bytes) -> bytes:
    """The same bytes on every day: the head of a MATLAB file tells when it was made."""
    head = b"MATLAB 5.0 MAT-file Platform: posix"
    return head.ljust(116) + data[116:]


def ncorr_hdf5() -> bytes:
    """The same in version 7.3: cells are references, matrices are transposed."""
    fields = ncorr_fields()
    file = io.BytesIO()
    with h5py.File(file, "w", userblock_size=512) as data:
        group = data.create_group("data_dic_save/displacements")
        for name in ("plot_u_ref_formatted", "plot_v_ref_formatted"):
            frames = [frame[name] for frame in fields["displacements"].ravel()]
            _cell(data, group, name, frames)
        info = data.create_group("data_dic_save/dispinfo")
        info["pixtounits"] = np.array([[MM_PER_PX]])
        info["spacing"] = np.array([[2.0]])
        _char(info, "units", "mm")
    return _with_block(file.getvalue())


def duodic_pair() -> bytes:
    """Two cameras, three images, six points in pixels; the last is lost in the last image."""
    position, displacement = grid()
    images = []
    for camera in range(2):
        for image in range(3):
            pixels = (position[:6] + image * displacement[:6])[:, :2] / MM_PER_PX
            pixels[:, 1] *= -1
            if image == 2:
                pixels[-1] = np.nan
            images.append(pixels + 5 * camera)
    file = io.BytesIO()
    with h5py.File(file, "w", userblock_size=512) as data:
        group = data.create_group("DIC2DpairResults")
        _cell(data, group, "Points", images)
        group["nImages"] = np.array([[3.0]])
    return _with_block(file.getvalue())


def duodic_stereo() -> bytes:
    """Reconstructed points of three images in mm."""
    position, displacement = grid()
    cells = np.empty((3, 1), dtype=object)
    for image in range(3):
        cells[image, 0] = position + image * displacement
    file = io.BytesIO()
    scipy.io.savemat(file, {"DIC3DPPresults": {"Points3D": cells, "Faces": np.ones((2, 3))}})
    return _fixed_date(file.getvalue())


def _cell(data: h5py.File, group: h5py.Group, name: str, matrices: list[np.ndarray]) -> None:
    references = np.empty((1, len(matrices)), dtype=h5py.ref_dtype)
    for index, matrix in enumerate(matrices):
        node = data.create_dataset(f"#refs#/{name}{index}", data=matrix.T)
        node.attrs["MATLAB_class"] = np.bytes_("double")
        references[0, index] = node.ref
    node = group.create_dataset(name, data=references)
    node.attrs["MATLAB_class"] = np.bytes_("cell")


def _char(group: h5py.Group, name: str, text: str) -> None:
    codes = np.array([[ord(letter)] for letter in text], dtype=np.uint16)
    node = group.create_dataset(name, data=codes)
    node.attrs["MATLAB_class"] = np.bytes_("char")


def _with_block(data: bytes) -> bytes:
    return b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + data[512:]


def points_csv() -> bytes:
    """Our own: all there may be."""
    position, displacement = grid()
    valid = np.arange(len(position)) != 2
    displacement[2] = np.nan
    sigma = np.full(position.shape, 0.001)
    shape = (N_ROWS, N_COLUMNS)
    frame = PointFrame("B0007", position, displacement, valid, sigma, 3.25, shape)
    return _written(lambda path: write_points(path, frame))


def machine_csv() -> bytes:
    """Our own: all there may be."""
    time = np.arange(8) * 0.5
    frame = np.where(np.arange(8) % 2, np.nan, np.arange(8))
    channels, metadata = {"force": "Load [N]"}, {"Diameter": "50 mm"}
    record = MachineRecord(
        "x", time, 0.3 * time, 0.1 * time, "compression", channels, metadata, frame
    )
    return _written(lambda path: write_machine(path, record))


def _written(write: Callable[[Path], None]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "file.csv"
        write(path)
        return path.read_bytes()


def bluehill_raw() -> bytes:
    """Quoted numbers with commas between the thousands."""
    head = ["Specimen number (included),1", 'Length,"26.00000",mm', "Specimen ID", ""]
    names = ["Time,Extension,Load,Tensile strain (Strain 1)", "(s),(mm),(N),(%)"]
    rows = [f'"{t:.5f}","{0.01 * t:.5f}","{900 + 50 * t:,.5f}","{t:.4f}"' for t in range(12)]
    return _text([*head, *names, *rows], "\r\n")


def bluehill_compression() -> bytes:
    """Names and units on two lines; extension and load are negative in compression."""
    rows = [f"{t * 0.1:.3f},{-0.02 * t:.4f},{-0.05 * t * t:.4f}" for t in range(12)]
    return _text(["Time,Extension,Load", "(sec),(mm),(N)", *rows])


def wavematrix() -> bytes:
    """Byte order mark, quoted names, a comma behind the last, kN."""
    names = '"Total Time (s)","Cycle Elapsed Time (s)","Position (mm)","Force (kN)",'
    rows = [f"{t * 0.1:.2f},{t * 0.1:.2f},{0.01 * t:.4f},{-0.0004 * t:.5f}" for t in range(12)]
    return _text([names, *rows], encoding="utf-8-sig")


def cylinder() -> bytes:
    """Lines of head that end in a semicolon, then commas."""
    head = [
        "EF30_sample_1", "Compression test;", "Cylinder Diameter: 50mm;", "Cylinder Height: 30mm;",
        "Speed (mm/min): 10;", "Time (s),Compression (mm),Load (N),Engineering Strain [-]",
    ]  # fmt: skip
    rows = [f"{t:.1f},{0.1 * t:.4f},{0.5 * t * t:.4f},{-0.1 * t / 30:.6f}" for t in range(12)]
    return _text(head + rows)


def davis_load() -> bytes:
    """Empty fields where no image was taken."""
    names = "Time;Image index (Image index);Change in distance;kilo Newton ADC channel 1"
    rows = [
        f"{500 * t}.5;{t // 3 if t % 3 == 0 else ''};{0.1 if t % 3 == 0 else ''};{0.01 * t:.6f}"
        for t in range(12)
    ]
    return _text([names, "ms;;mm;kN", *rows])


def matchid_load() -> bytes:
    """Windows paths, volts and newtons."""
    rows = [
        f"C:\\Grabber\\Image_{n:04d}_0.tiff;{789.47 + n};{0.28 + 0.01 * n};{70 + 2.5 * n}"
        for n in range(12)
    ]
    return _text(["File;TimeStamp;Force [V]; Force [N]", *rows])


DIC_SAMPLES: dict[str, tuple[tuple[str, Callable[[], bytes]], ...]] = {
    "DaVis Tecplot": (("B0003.dat", davis_tecplot),),
    "DaVis csv": (("B0003.csv", davis_csv), ("B0004.csv", davis_csv_decimal_comma)),
    "MatchID 2023 csv": (("B0010_0.tif.csv", matchid_2023),),
    "MatchID 2024 csv": (("Image_0007_0.tiff.csv", matchid_2024),),
    "DICe text": (("DICe_solution_1.txt", dice), ("DICe_solution_2.txt", dice_subset)),
    "VIC-3D csv": (("frame.csv", vic3d),),
    "Ncorr mat": (
        ("ncorr.mat", ncorr),
        ("ncorr6.mat", partial(ncorr, do_compression=False)),
        ("ncorr73.mat", ncorr_hdf5),
    ),
    "DuoDIC mat": (("pair.mat", duodic_pair), ("stereo.mat", duodic_stereo)),
    "softcal points csv": (("points.csv", points_csv),),
}
"""name and content of the files of each DIC format"""
MACHINE_SAMPLES: dict[str, tuple[tuple[str, Callable[[], bytes]], ...]] = {
    "Instron Bluehill csv": (
        ("Specimen_RawData_1.csv", bluehill_raw),
        ("compression.csv", bluehill_compression),
        ("wavematrix.csv", wavematrix),
    ),
    "phantom cylinder csv": (("EF30.csv", cylinder),),
    "DaVis load csv": (("load.csv", davis_load),),
    "MatchID load csv": (("Image.csv", matchid_load),),
    "softcal machine csv": (("machine.csv", machine_csv),),
}
"""name and content of the files of each test-machine format"""
