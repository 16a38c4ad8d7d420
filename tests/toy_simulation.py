"""A simulation that is exact and quick, slow or failing when asked, and campaigns of it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fe.campaign import run_campaign
from fe.campaign_result import Campaign
from fe.response import Response, Status

TRAVEL = np.array([0.6, 1.0, 1.4])
FINGERPRINT: dict[str, object] = {"mesh": [4, 2, 4], "bulk_ratio": 200.0}
RATIOS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.5], [1.0, 0.5], [0.3, 0.2], [0.7, 0.1]])
MANY = np.random.default_rng(5).random((80, 2))


@dataclass(frozen=True)
class Toy:
    """Stands in for the finite-element model: exact, quick, and slow or failing when asked."""

    seconds: float = 0.0
    fails_above: float = np.inf
    log: str = ""
    factor: float = 1.0

    def __call__(self, ratios: np.ndarray) -> Response:
        if self.log:
            with open(self.log, "a") as stream:
                stream.write(f"{ratios.tolist()}\n")
        time.sleep(self.seconds)
        matrix = np.outer(np.sin(np.arange(40.0)), np.cos(ratios[0] + np.arange(40.0)))
        field = (matrix @ matrix.T)[:30, :3] * (1.0 + ratios[1])
        failed = bool(ratios[0] > self.fails_above)
        force = self.factor * TRAVEL * (1.0 + ratios[0] + ratios[1] ** 2)
        return Response(
            travel=TRAVEL,
            force=np.where([False, failed, failed], np.nan, force),
            displacement=np.broadcast_to(field, (3, 30, 3)).copy(),
            force_gradient=np.stack([TRAVEL, 2.0 * ratios[1] * TRAVEL], axis=1),
            displacement_gradient=np.zeros((3, 30, 3, 2)),
            reached=0.8 if failed else 1.4,
            status=Status.STOPPED if failed else Status.CONVERGED,
            message="step below its limit" if failed else "reached 1.4 mm",
            negative_pivots=np.zeros(3, dtype=np.int64),
            n_factorisations=10,
            seconds=0.0,
        )


@dataclass(frozen=True)
class Raises:
    """A simulation that refuses its input."""

    def __call__(self, ratios: np.ndarray) -> Response:
        raise ValueError(f"ratios: r must be below 1, got {ratios[0]}")


def run(store: Path, simulate: Any = Toy(), theta: np.ndarray = RATIOS, **kw: Any) -> Campaign:
    return run_campaign(simulate, theta, store, fingerprint=FINGERPRINT, **kw)


def files(store: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(store.glob("run_*.npz"))}


def assert_same(a: Campaign, b: Campaign) -> None:
    assert a.theta.tobytes() == b.theta.tobytes()
    assert a.force.tobytes() == b.force.tobytes()
    assert a.displacement.tobytes() == b.displacement.tobytes()
    assert [r.status for r in a.responses] == [r.status for r in b.responses]
