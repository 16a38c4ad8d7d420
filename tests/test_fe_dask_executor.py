"""A campaign on a Dask cluster gives what it gives in worker processes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from toy_simulation import FINGERPRINT, RATIOS, Raises, Toy

from fe import dask_map, process_map, run_campaign

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as connected,
    ):
        yield connected


def _wait(x: float) -> float:
    time.sleep(x)
    return -x


def test_a_campaign_has_the_bits_of_one_in_worker_processes(client: Any, tmp_path: Path) -> None:
    found = [
        run_campaign(Toy(), RATIOS, tmp_path / name, fingerprint=FINGERPRINT, map_fn=map_fn)
        for name, map_fn in (("dask", dask_map(client)), ("processes", process_map(1)))
    ]
    assert found[0].force.tobytes() == found[1].force.tobytes()
    assert found[0].displacement.tobytes() == found[1].displacement.tobytes()


def test_results_come_as_they_are_ready(client: Any) -> None:
    assert list(dask_map(client)(_wait, [1.0, 0.0])) == [(1, -0.0), (0, -1.0)]
    assert list(dask_map(client)(_wait, [])) == []


def test_closing_the_map_cancels_what_has_not_begun(client: Any) -> None:
    results = dask_map(client)(_wait, [0.0] + 50 * [1.0])
    assert next(results) == (0, -0.0)
    results.close()  # type: ignore[attr-defined]
    begin = time.monotonic()
    assert list(dask_map(client)(_wait, [0.1])) == [(0, -0.1)]
    assert time.monotonic() - begin < 12.0  # 25 s if the other runs were waited for


def test_an_exception_of_the_simulation_reaches_the_caller(client: Any, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="r must be below 1"):
        run_campaign(
            Raises(), np.ones((1, 2)), tmp_path, fingerprint=FINGERPRINT, map_fn=dask_map(client)
        )
