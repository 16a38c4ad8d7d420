"""One small file of each format the readers know, written by hand as the programs write them.

They are the seeds that `reader_mutants` damages, and what the tests read without the real files.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.matlab_samples import duodic_pair, duodic_stereo, ncorr, ncorr_hdf5
from benchmarks.sample_field import MM_PER_PX, N_COLUMNS, N_ROWS, grid
from calib.data.readers import MachineRecord, PointFrame, write_machine, write_points


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
