"""What a virtual laboratory does and how well: protocol, test machine, cameras, placement."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Literal, cast, get_args

PointFormat = Literal[
    "davis-csv", "davis-tecplot", "matchid-2023", "matchid-2024", "vic-3d", "dice", "softcal"
]
MachineFormat = Literal["bluehill-raw", "bluehill-export", "softcal"]
POINT_FORMATS: tuple[PointFormat, ...] = get_args(PointFormat)
MACHINE_FORMATS: tuple[MachineFormat, ...] = get_args(MachineFormat)


@dataclass(frozen=True)
class Protocol:
    """The crosshead's programme: preconditioning, approach, steps with holds, return (T 4.1.2)."""

    increment_mm: float = 0.2
    increments: int = 9
    hold_s: float = 20.0
    preconditioning_cycles: int = 5
    preconditioning_travel_mm: float = 1.0
    speed_mm_per_s: float = 0.5
    slack_mm: float = 0.5
    """from where the record begins to where the pin is meant to touch"""
    contact_s: float = 3.0
    """between the approach and the first step"""
    rest_s: float = 10.0
    """before the first cycle, before the approach and at the end"""

    def __post_init__(self) -> None:
        _above_zero(self, "increment_mm", "increments", "hold_s", "speed_mm_per_s", "slack_mm")
        _above_zero(self, "preconditioning_travel_mm")
        for name in ("increments", "preconditioning_cycles"):
            if not isinstance(getattr(self, name), int):
                found = getattr(self, name)
                raise ValueError(f"{name}: expected a whole number, found {found}")
        _not_negative(self, "preconditioning_cycles", "rest_s", "contact_s")


@dataclass(frozen=True)
class Rubber:
    """What the material does beside its equilibrium: relaxation and softening.

    A hold at constant travel loses 2.5 to 2.8 % of its force (T Table 3.6), and the force of the
    cycles settles after five or six (T Figure 5.1).
    """

    relaxing_shares: tuple[float, ...] = (0.05, 0.04)
    """of a step's force above equilibrium, one a time"""
    relaxing_s: tuple[float, ...] = (0.8, 4.0)
    first_cycle_excess: float = 0.15
    """share by which the first cycle is stiffer than the last"""
    settling_cycles: float = 1.0
    """over which that share falls to 1/e"""

    def __post_init__(self) -> None:
        if len(self.relaxing_shares) != len(self.relaxing_s):
            raise ValueError(
                f"relaxing_s: expected {len(self.relaxing_shares)} times, one a share, "
                f"found {len(self.relaxing_s)}"
            )
        if not all(0.0 <= share < 1.0 for share in self.relaxing_shares):
            raise ValueError(
                f"relaxing_shares: expected shares in [0, 1), found {self.relaxing_shares}"
            )
        if not all(time > 0 for time in self.relaxing_s):
            raise ValueError(f"relaxing_s: expected times above 0 s, found {self.relaxing_s}")
        _above_zero(self, "settling_cycles")
        _not_negative(self, "first_cycle_excess")


@dataclass(frozen=True)
class TestMachine:
    """Errors of the test machine; the force's noise is that of T 5.1, read as peak to peak."""

    __test__ = False  # no class of tests

    rate_hz: float = 20.0
    force_noise_N: float = 0.07
    """SD of one reading"""
    force_step_N: float = 0.005
    """the record is rounded to whole steps"""
    force_zero_N: float = 0.05
    """SD of the load cell's offset between samples"""
    force_drift_N: float = 0.01
    """SD of what the offset gains from begin to end"""
    travel_noise_mm: float = 0.0003
    travel_step_mm: float = 0.0005
    compliance_mm_per_N: float = 0.002
    contact_sd_mm: float = 0.005
    """SD of the place where the steps begin about that of contact"""

    def __post_init__(self) -> None:
        _above_zero(self, "rate_hz", "force_step_N", "travel_step_mm")
        rest = (f.name for f in fields(self) if f.name not in ("rate_hz",))
        _not_negative(self, *rest)


@dataclass(frozen=True)
class Cameras:
    """Stereo DIC of the front face: its points, what it misses, its noise and its clock."""

    format: PointFormat = "davis-csv"
    grid: tuple[int, int] = (200, 50)
    """points along width and height, those beside the face with them"""
    margin_mm: float = 0.2
    """the rectangle of points goes this far beyond the face"""
    hidden_mm: float = 0.12
    """points closer than this to the pin's edge are lost: half a subset"""
    edge_mm: float = 0.0
    """points closer than this to the sample's edges are lost: programs that fit subsets cut by an
    edge lose none"""
    least_seen: float = 0.25
    """share of a surface's area that must face the cameras for a subset to be found"""
    noise_mm: tuple[float, float, float] = (0.005, 0.005, 0.01)
    """SD of a displacement along x, y, z"""
    correlation_mm: float = 0.3
    """length of its exponential correlation over the points: about one subset"""
    reference_share: float = 0.5
    """share of its variance that comes from the reference image, common to all frames"""
    lost_share: float = 0.004
    """share of points lost to glare, of one frame at a time"""
    outlier_share: float = 0.001
    """share of points matched to a wrong place"""
    outlier_mm: float = 0.3
    static_frames: int = 6
    clock_s: float = 1.0
    """the camera's clock is this far from the machine's, at most"""
    trigger_s: float = 12.0
    """pressed by hand this long after a step has ended"""
    trigger_sd_s: float = 0.3

    def __post_init__(self) -> None:
        if self.format not in POINT_FORMATS:
            raise ValueError(
                f"format: expected one of {', '.join(POINT_FORMATS)}, found {self.format!r}"
            )
        if min(self.grid) < 4 or not all(isinstance(n, int) for n in self.grid):
            raise ValueError(f"grid: expected 4 points or more each way, found {self.grid}")
        if len(self.noise_mm) != 3 or not all(0.0 <= sd < math.inf for sd in self.noise_mm):
            raise ValueError(f"noise_mm: expected three SDs of 0 or more, found {self.noise_mm}")
        if not 0.0 <= self.reference_share < 1.0:
            raise ValueError(f"reference_share: expected in [0, 1), found {self.reference_share}")
        shares = (self.lost_share, self.outlier_share, self.least_seen)
        if not all(0.0 <= share <= 1.0 for share in shares):
            raise ValueError(
                f"lost_share, outlier_share, least_seen: expected shares in [0, 1], found {shares}"
            )
        if not (isinstance(self.static_frames, int) and self.static_frames >= 2):
            raise ValueError(f"static_frames: expected 2 or more, found {self.static_frames}")
        _above_zero(self, "correlation_mm")
        _not_negative(
            self, "margin_mm", "hidden_mm", "edge_mm", "outlier_mm", "clock_s", "trigger_sd_s"
        )


@dataclass(frozen=True)
class Placing:
    """How well samples are placed; `misplaced` of them beyond a limit, the others within it.

    Within: normal, cut off at `safe_share` of the limits. Beyond: past a limit by `clear_share` of
    it or more, so that what is right and wrong is not a matter of noise.
    """

    max_angle_deg: float = 1.0
    max_x_shift_mm: float = 0.25
    misplaced: int = 8
    angle_sd_deg: float = 0.4
    """about the height, the angle that is limited"""
    x_shift_sd_mm: float = 0.08
    camera_roll_deg: float = 0.3
    """SD of the turn of the cameras' frame about their line of sight"""
    camera_tilt_deg: float = 0.2
    """SD of the turn of the cameras' frame about the width"""
    safe_share: float = 0.85
    clear_share: float = 0.15
    stiffness_sd: float = 0.08
    """SD of the logarithm of the samples' stiffness (T Table 5.1: 7 to 11 % with the load cell)"""

    def __post_init__(self) -> None:
        _above_zero(self, "max_angle_deg", "max_x_shift_mm")
        if not 0.0 < self.safe_share <= 1.0:
            raise ValueError(f"safe_share: expected a share in (0, 1], found {self.safe_share}")
        _not_negative(
            self, "misplaced", "clear_share", "stiffness_sd", "angle_sd_deg", "x_shift_sd_mm",
            "camera_roll_deg", "camera_tilt_deg",
        )  # fmt: skip


@dataclass(frozen=True)
class LaboratorySettings:
    """One laboratory. Raises ValueError when a value is impossible."""

    samples: int = 24
    machine_format: MachineFormat = "bluehill-raw"
    use: tuple[int, ...] = (3, 4, 5, 6, 7)
    """increments that are to be used"""
    protocol: Protocol = field(default_factory=Protocol)
    rubber: Rubber = field(default_factory=Rubber)
    machine: TestMachine = field(default_factory=TestMachine)
    cameras: Cameras = field(default_factory=Cameras)
    placing: Placing = field(default_factory=Placing)

    def __post_init__(self) -> None:
        if not (isinstance(self.samples, int) and self.samples >= 1):
            raise ValueError(f"samples: expected a whole number of 1 or more, found {self.samples}")
        if not 0 <= self.placing.misplaced <= self.samples:
            raise ValueError(
                f"misplaced: expected at most the {self.samples} samples, "
                f"found {self.placing.misplaced}"
            )
        if self.machine_format not in MACHINE_FORMATS:
            raise ValueError(
                f"machine_format: expected one of {', '.join(MACHINE_FORMATS)}, "
                f"found {self.machine_format!r}"
            )
        self._check_triggers()
        known = range(1, self.protocol.increments + 1)
        if len(self.use) < 2 or list(self.use) != [n for n in known if n in self.use]:
            raise ValueError(
                f"use: expected two or more increments of 1 to {self.protocol.increments}, "
                f"ascending, found {self.use}"
            )

    def _check_triggers(self) -> None:
        """A frame is of the hold, or the rest, that its time says."""
        cameras, protocol = self.cameras, self.protocol
        late = SURE * cameras.trigger_sd_s
        if not late < cameras.trigger_s < protocol.hold_s - late:
            raise ValueError(
                f"trigger_s: expected between {late:g} and hold_s less that "
                f"({protocol.hold_s - late:g} s), {SURE:g} trigger_sd_s from both ends of a hold, "
                f"found {cameras.trigger_s:g}"
            )
        least = BEFORE_APPROACH + late
        if not protocol.rest_s > least:
            raise ValueError(
                f"rest_s: expected more than {least:g} s, since the reference is taken "
                f"{BEFORE_APPROACH:g} s before the approach, found {protocol.rest_s:g}"
            )


BEFORE_APPROACH = 2.0
"""s: when the reference image is taken"""
SURE = 4.0
"""SDs of the hand that presses the trigger"""
MISPLACED_SHARE = 1 / 3
"""of samples, where the number of the misplaced is not asked for"""


def chosen(samples: int, points: str, machine: str) -> LaboratorySettings:
    """A laboratory of so many samples whose files are of these formats.

    Raises ValueError for a format that cannot be written.
    """
    return LaboratorySettings(
        samples=samples,
        machine_format=cast("MachineFormat", machine),
        cameras=Cameras(format=cast("PointFormat", points)),
        placing=Placing(misplaced=round(MISPLACED_SHARE * samples)),
    )


def _above_zero(settings: object, *names: str) -> None:
    for name in names:
        value = getattr(settings, name)
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name}: expected a number above 0, found {value}")


def _not_negative(settings: object, *names: str) -> None:
    for name in names:
        value = getattr(settings, name)
        if not 0.0 <= value < math.inf:
            raise ValueError(f"{name}: expected 0 or more, found {value}")
