"""Small MATLAB files of Ncorr and DuoDIC, in versions 5 and 7.3."""

from __future__ import annotations

import io

import h5py
import numpy as np
import scipy.io

from benchmarks.sample_field import MM_PER_PX, N_COLUMNS, N_ROWS, grid


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
