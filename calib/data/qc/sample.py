"""One sample from its files to forces and a field at the nominal travels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from calib.data.qc.experiment_file import Box, Experiment, Mapping, RigidBody, Specimen
from calib.data.qc.hold_frames import frames_of_holds
from calib.data.qc.lab_files import SampleFiles, frames_in_time
from calib.data.qc.lattice import Lattice, lattice_of
from calib.data.qc.machine_test import MachineTest, NotAsPlanned, at_travel, machine_test
from calib.data.qc.mapping import map_coarsely, map_field
from calib.data.qc.masks import inside, within
from calib.data.qc.outliers import Cleaned, without_outliers
from calib.data.qc.registration import Placement, place
from calib.data.qc.rigid_motion import folded, without_rigid_motion
from calib.data.qc.synchronise import Synchronised, synchronise
from calib.data.readers import PointFrame, WrongFile, read_dic, read_machine
from calib.data.readers.frames import BoolArray
from fe.response import Array

STEREO = (
    "stereo results with z and its displacement, which the angle of the face and its bulge towards "
    "the camera need"
)
REACH = 0.6
"""of an increment that a hold may lie from the nominal travel"""
WIDER = 0.05
"""than the specimen is said to be: points that far apart are not of such a one"""
FALLING = 0.97
"""of the displacement of the frame before, below which it has fallen, whatever noise there is"""
LEAST_SIZE = 0.005
"""root mean square of displacements less rigid motion, over the travel: below it nothing moves"""
ODD_SIZE = 5.0
"""times the usual displacement over the travel, or its inverse, that no frame has"""
HOLDS_OF_FORCE = 5
"""whose polynomial brings the force to the nominal travel: with three a stiffening block's force
errs by more than the mean of sixteen samples does"""


@dataclass(frozen=True)
class FaceField:
    """The front face of one sample under load."""

    lattice: Lattice
    """frames: the reference, then one a hold used"""
    travel: Array
    """(n_hold,) mm, of the frames after the reference"""
    placement: Placement
    cleaned: Cleaned
    """of the frames after the reference"""
    stated_std: Array | None = None
    """(3,) mm, root mean square of the SDs that the DIC program states for points under load; None
    where it states none"""
    scale_sd: float = 0.0
    """relative SD of all lengths by the calibration as the DIC program states it; 0 where it states
    none"""
    stated_length: float | None = None
    """mm, correlation length of the noise by the DIC program; None where it states none"""
    pin_travel: Array | None = None
    """(n_hold,) median u_y of the points on the pin, mm; None where none are named"""

    def mapped(
        self, points: Array, method: Mapping, rigid: RigidBody, *, coarsely: bool = False
    ) -> tuple[Array, Array]:
        """(n_hold, n, 3) field of half the face at points (n, 2), both in our frame, mm.

        Both halves are mapped, rigid motion is taken off, and one is folded onto the other; with
        the motion (n_hold, 3) that was taken off.
        """
        halves = []
        for sign in (1.0, -1.0):
            at = self.lattice.coordinates(self.placement.points(points * np.array([sign, 1.0])))
            values = self.cleaned.displacement
            moved = map_coarsely(values, at) if coarsely else map_field(values, at, method)
            halves.append(moved @ self.placement.rotation.T)
        right, left, motion = without_rigid_motion(halves[0], halves[1], points, rigid)
        return folded(right, left), motion


@dataclass(frozen=True)
class Sample:
    """All that was found of one sample; `machine` and `face` are None where a test went wrong."""

    name: str
    machine: MachineTest | None = None
    synchronised: Synchronised | None = None
    force: Array | None = None
    """(n_step,) N at the nominal travels; NaN where no hold is near"""
    face: FaceField | None = None
    failure: NotAsPlanned | None = None


def read_sample(files: SampleFiles, experiment: Experiment) -> Sample:
    """Read and analyse one sample.

    Raises WrongFile for a file that cannot be read; a test that did not go as planned is a result.
    """
    protocol = experiment.protocol
    record = read_machine(files.machine)
    series = read_dic(files.dic)
    frames, times = frames_in_time(files.frames, series)
    for frame in frames:
        if frame.is_planar:
            raise WrongFile(files.dic, None, STEREO, f"frames of one camera (planar), {frame.name}")
    if record.travel is None:
        raise WrongFile(files.machine, None, "the travel with the force", "a force alone")
    if len(frames) < 2:
        raise WrongFile(files.dic, None, "the reference and one frame or more", "one frame")
    machine = None
    try:
        machine = machine_test(record, protocol, experiment.machine)
        camera = experiment.camera
        together = synchronise(
            times, list(machine.holds), camera.max_clock_offset_s, camera.margin_s
        )
        numbers, travel, forces = machine.loaded()
        reach = REACH * protocol.increment_mm
        force = at_travel(travel, forces, protocol.travel, reach, HOLDS_OF_FORCE)
        face = _face(list(frames), together, numbers, travel, experiment)
    except NotAsPlanned as failure:
        return Sample(files.name, machine, failure=failure)
    except ValueError as error:  # of readings or points that show no such test
        expected, _, found = str(error).partition(", found ")
        planned = NotAsPlanned("analysis", found, expected.removeprefix("expected "))
        return Sample(files.name, machine, failure=planned)
    return Sample(files.name, machine, together, force, face)


def _face(
    frames: list[PointFrame],
    together: Synchronised,
    numbers: Array,
    travel: Array,
    experiment: Experiment,
) -> FaceField:
    """The field of the frames taken in a hold near an increment used, and their neighbours."""
    chosen, places = frames_of_holds(together, numbers, travel, experiment)
    picked = [frames[0], *(frames[index] for index in chosen)]
    axes, quality = experiment.axes.matrix, experiment.quality
    keep = partial(inside, experiment.mask)
    lattice = lattice_of(picked, axes, keep)
    cleaned = without_outliers(
        lattice.displacement[1:], quality.outlier_mad, quality.outlier_floor_mm
    )
    clean = lattice._replace(
        displacement=np.concatenate([lattice.displacement[:1], cleaned.displacement])
    )
    loaded = [*range(1, len(picked))][-2:]
    names = [frames[index].name for index in chosen]
    _check_growth(cleaned.displacement, places, names, experiment.specimen)
    options, width = experiment.field, experiment.specimen.width_mm
    placement = place(clean, loaded, width, options.edge_mm, options.base_mm)
    if placement.width > (1.0 + WIDER) * width:
        seen = float(f"{placement.width:.4g}")
        raise NotAsPlanned("mm between points", seen, f"specimen.width_mm, {width:g}, at most")
    pin = experiment.mask.pin_rectangle_mm
    on_pin = None if pin is None else np.array([_pin_travel(f, axes, pin) for f in picked[1:]])
    scale = max((f.scale_sd or 0.0 for f in picked), default=0.0)
    length = max((f.correlation_length or 0.0 for f in picked[1:]), default=0.0) or None
    stated = _stated(picked[1:], axes, keep)
    return FaceField(lattice, places, placement, cleaned, stated, scale, length, on_pin)


def _check_growth(displacement: Array, travel: Array, names: list[str], specimen: Specimen) -> None:
    """Raise NotAsPlanned for a frame whose field is not what its travel lets expect.

    Its size, the root mean square over its points on the lattice (n_frame, n_v, n_h, 3) [mm] less
    rigid motion, grows with the travel (n_frame,) [mm]; exchanged frames and one in another unit do
    not.
    """
    for k, one in enumerate(displacement):
        for name, other in zip(names[:k], displacement[:k], strict=True):
            if np.isfinite(one).any() and np.array_equal(one, other, equal_nan=True) and one.any():
                raise NotAsPlanned(f"frame {names[k]}", f"the displacements of {name}", "its own")
    size = np.array([_deformed(frame) for frame in displacement])
    if not np.all(travel > 0.0) or np.isnan(usual := float(np.median(size / travel))):
        return
    # A side that is squeezed out goes as far as half the width over the height times the travel.
    most = 0.5 * (1.0 + specimen.width_mm / specimen.height_mm)
    if not LEAST_SIZE < usual < most:
        what = "mm of displacement a mm of travel (root mean square, less rigid motion)"
        possible = f"{LEAST_SIZE:g} to {most:g} (are the frames in another unit?)"
        raise NotAsPlanned(what, float(f"{usual:.3g}"), possible)
    for k, name in enumerate(names):
        falls = k > 0 and size[k] < FALLING * size[k - 1]
        if falls or not 1.0 / ODD_SIZE < size[k] / (usual * travel[k]) < ODD_SIZE:
            least = f"more than {size[k - 1]:.3g}" if falls else f"about {usual * travel[k]:.3g}"
            what = f"mm of displacement (root mean square, less rigid motion) in frame {name}"
            raise NotAsPlanned(what, float(f"{size[k]:.3g}"), f"{least}, by the frames beside it")


def _deformed(displacement: Array) -> float:
    """Root mean square, mm, of a lattice's displacements (n_v, n_h, 3) less a small rigid motion.

    NaN where no point is known.
    """
    v, h = (axis.ravel() for axis in np.indices(displacement.shape[:2]).astype(np.float64))
    flat = displacement.reshape(-1, 3)
    known = np.isfinite(flat).all(axis=1)
    if not known.any():
        return float("nan")
    v, h, flat = v[known] - v[known].mean(), h[known] - h[known].mean(), flat[known]
    in_plane = flat[:, :2] - flat[:, :2].mean(axis=0)
    arm = h @ h + v @ v
    if arm > 0.0:
        angle = (h @ in_plane[:, 1] - v @ in_plane[:, 0]) / arm
        in_plane = in_plane - angle * np.column_stack([-v, h])
    plane = np.column_stack([np.ones_like(h), h, v])
    out = flat[:, 2] - plane @ np.linalg.lstsq(plane, flat[:, 2], rcond=None)[0]
    return float(np.sqrt((np.sum(in_plane**2) + out @ out) / (3 * len(out))))


def _stated(
    frames: list[PointFrame], axes: Array, keep: Callable[[Array], BoolArray]
) -> Array | None:
    """Root mean square (3,) of the SDs that the frames' program states, in our axes, mm.

    `keep` says which points (n, 2) [mm] are the sample's: what is beside it may be blurred.
    """
    known = [
        f.sigma[f.valid & keep((f.position @ axes.T)[:, :2])] for f in frames if f.sigma is not None
    ]
    squares = np.concatenate(known) ** 2 if known else np.zeros((0, 3))
    squares = squares[np.isfinite(squares).all(axis=1)]
    if not squares.size:
        return None
    stated: Array = np.sqrt(squares.mean(axis=0) @ (axes.T**2))
    return stated


def _pin_travel(frame: PointFrame, axes: Array, pin: Box) -> float:
    """Median u_y of the valid points on the pin in one frame, mm."""
    chosen = frame.valid & within(pin, (frame.position @ axes.T)[:, :2])
    if not chosen.any():
        raise NotAsPlanned("points on the pin", 0, 1)
    return float(np.median((frame.displacement[chosen] @ axes.T)[:, 1]))
