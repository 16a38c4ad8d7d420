"""A virtual laboratory's DIC files made from photographs: rendered, correlated, triangulated.

The laboratory is written first, with its test machine and clocks; here the DIC frames of its
samples and of its static series are made again from what two virtual cameras see.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from calib.data.readers import PointFrame, read_dic, write_points
from calib.data.readers.point_csv import NAME as SOFTCAL
from calib.dic.camera import Camera, project
from calib.dic.settings import CorrelationSettings
from calib.dic.stereo import StereoSettings, Tracked, follow_pair, place_reference
from calib.stereo_points import point_frame, reference_frame
from calib.virtual.cameras import CameraPair
from calib.virtual.laboratory import TRUTH_FILE, SampleTruth
from calib.virtual.placement import Placement
from calib.virtual.render import Pin, render
from calib.virtual.sensor import Glare, Sensor, expose
from calib.virtual.speckle import Speckle, SpeckleSettings, make_speckle
from calib.virtual.surface import Surface, make_surface
from calib.virtual.truth import TruthResponse
from fe.atomic_file import write_text
from fe.response import Array

KEPT = ("clock_s", "trigger_s", "trigger_sd_s")
"""settings of a laboratory's cameras that hold for photographs, too: when frames are taken"""
PIN_BEYOND = 0.3
"""mm by which the pin stands out beyond the farthest point of the face"""
STRAIGHT = Placement(0.0, 0.0, 0.0, 0.0, (0.4, -1.1, 2.0), 1.0, "")


@dataclass(frozen=True)
class Studio:
    """Cameras, light, paint and correlation of a laboratory. Raises ValueError if impossible."""

    cameras: CameraPair = field(default_factory=CameraPair)
    sensor: Sensor = field(default_factory=Sensor)
    speckle: SpeckleSettings = field(default_factory=SpeckleSettings)
    stereo: StereoSettings = field(
        default_factory=lambda: StereoSettings(CorrelationSettings(order=2, min_zncc=0.9))
    )
    spacing_mm: float = 0.15
    """of the points on the face"""
    edge_mm: float = 0.3
    """of the outermost points from the edges of the face: half a subset or more"""
    static_frames: int = 5
    material_step_mm: float = 0.05
    """of the grid through which a deformed face is a smooth surface"""
    glare: Glare = field(default_factory=Glare)

    def __post_init__(self) -> None:
        if not (self.spacing_mm > 0 and self.edge_mm >= 0 and self.material_step_mm > 0):
            raise ValueError(
                f"spacing_mm, edge_mm, material_step_mm: expected lengths above 0, found "
                f"{self.spacing_mm}, {self.edge_mm}, {self.material_step_mm}"
            )
        if self.static_frames < 2:
            raise ValueError(f"static_frames: expected 2 or more, found {self.static_frames}")


def photograph(
    folder: Path,
    truth: TruthResponse,
    samples: Sequence[SampleTruth],
    studio: Studio,
    seed: int,
    say: Callable[[str], None] = lambda _: None,
) -> None:
    """Replace the DIC files of a laboratory written as `softcal` by those of photographs.

    `truth.json` states the studio then, and of the cameras before only when they took frames.
    Raises ValueError when its files are of another format.
    """
    for place in (folder / "static", *(folder / sample.name / "dic" for sample in samples)):
        if (found := read_dic(place).format) != SOFTCAL:
            raise ValueError(f"{place}: expected frames of {SOFTCAL}, found {found}")
    static_seed, *seeds = np.random.SeedSequence(seed).spawn(len(samples) + 1)
    at_rest = np.zeros(studio.static_frames + 1)
    rng = np.random.default_rng(static_seed)
    # files are replaced when all are there: a stop leaves the laboratory that truth.json tells of
    taken = [(folder / "static", dic_series(truth, STRAIGHT, at_rest, at_rest, studio, rng))]
    say("static frames photographed")
    for sample, own in zip(samples, seeds, strict=True):
        place = folder / sample.name / "dic"
        time = np.array([frame.time for frame in read_dic(place).frames], dtype=np.float64)
        travel = np.append(0.0, sample.travel)
        rng = np.random.default_rng(own)
        taken.append((place, dic_series(truth, sample.placement, travel, time, studio, rng)))
        say(f"{sample.name} photographed")
    for place, frames in taken:
        _replace(place, frames)
    _tell_truth(folder, studio, seed)


def _tell_truth(folder: Path, studio: Studio, seed: int) -> None:
    """State the cameras that took the photographs in place of those whose files they replace."""
    content = json.loads((folder / TRUTH_FILE).read_text(encoding="utf-8"))
    before = content["settings"]["cameras"]
    content["settings"]["cameras"] = {name: before[name] for name in KEPT}
    content["photographs"] = {"seed": seed, "studio": asdict(studio)}
    write_text(folder / TRUTH_FILE, json.dumps(content, indent=1) + "\n")


def _replace(folder: Path, frames: Sequence[PointFrame]) -> None:
    for path in sorted(folder.iterdir()):
        path.unlink()
    for frame in frames:
        write_points(folder / f"{frame.name}.csv", frame)


def dic_series(
    truth: TruthResponse,
    placement: Placement,
    travel: Array,
    time: Array,
    studio: Studio,
    rng: np.random.Generator,
) -> tuple[PointFrame, ...]:
    """What stereo correlation finds at travels (n,) mm, the first of which is the reference."""
    specimen = truth.truth.specimen
    half, height = specimen.width / 2.0, specimen.height
    speckle = make_speckle((-half, 0.0), (half, height), studio.speckle, rng)
    faces = deformed_faces(truth, placement, travel, studio.material_step_mm)
    grid, points = face_points(faces[0], studio)
    rig = studio.cameras.rig
    reference = None
    before: Tracked | None = None
    frames = []
    for number, (face, depth, at) in enumerate(zip(faces, travel, time, strict=True), start=1):
        pin = None
        if depth > 0.0:
            pin = _pin(truth, placement, float(depth), face)
        images = [
            _image(face, speckle, studio, camera, pin, rng) for camera in (rig.left, rig.right)
        ]
        name = f"B{number:04d}"
        if reference is None:
            reference = place_reference(rig, images[0], images[1], points, studio.stereo)
            frames.append(reference_frame(reference, name, float(at), grid))
            continue
        found, before = follow_pair(reference, images[0], images[1], studio.stereo, before)
        frames.append(point_frame(found, name, float(at), grid))
    return tuple(frames)


def deformed_faces(
    truth: TruthResponse, placement: Placement, travel: Array, step: float
) -> tuple[Surface, ...]:
    """The face of a placed sample at travels (n,), in the cameras' frame."""
    specimen = truth.truth.specimen
    half, height = specimen.width / 2.0, specimen.height
    n_x, n_y = (round(length / step) + 1 for length in (specimen.width, height))
    x, y = np.linspace(-half, half, n_x), np.linspace(0.0, height, n_y)
    material = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    flat = np.column_stack([material, np.zeros(len(material))])
    moved = flat + truth.field_at(material, travel, placement.x_shift)
    places = moved @ placement.rotation.T + np.array(placement.origin)
    return tuple(
        make_surface((-half, 0.0), (half, height), one.reshape(n_x, n_y, 3)) for one in places
    )


def face_points(face: Surface, studio: Studio) -> tuple[tuple[int, int], Array]:
    """Rows and columns of the points, and their pixels (n, 2) in the left reference image."""
    (left, bottom), (right, top) = face.low, face.high
    edge, spacing = studio.edge_mm, studio.spacing_mm
    n_x = max(round((right - left - 2.0 * edge) / spacing) + 1, 4)
    n_y = max(round((top - bottom - 2.0 * edge) / spacing) + 1, 4)
    x, y = np.linspace(left + edge, right - edge, n_x), np.linspace(top - edge, bottom + edge, n_y)
    material = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return (n_y, n_x), project(studio.cameras.rig.left, face.at(material))[0]


def _image(
    face: Surface,
    speckle: Speckle,
    studio: Studio,
    camera: Camera,
    pin: Pin | None,
    rng: np.random.Generator,
) -> Array:
    picture = render(face, speckle, studio.cameras, camera, pin)
    return expose(picture.brightness, studio.sensor, rng, studio.glare).astype(np.float64)


def _pin(truth: TruthResponse, placement: Placement, travel: float, face: Surface) -> Pin:
    """The pin in the cameras' frame, upright: it goes with the machine, not with the sample."""
    specimen = truth.truth.specimen
    middle = placement.rotation @ np.array([placement.x_shift, specimen.height, 0.0])
    centre = middle + np.array(placement.origin)
    half = specimen.pin_width / 2.0
    return Pin(
        float(centre[0] - half), float(centre[0] + half), float(centre[1] - travel),
        float(face.places[..., 2].max()) + PIN_BEYOND,
    )  # fmt: skip
