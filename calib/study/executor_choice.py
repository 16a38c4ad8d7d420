"""Where the simulations of a study run: in this process, in worker processes, or on a cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from fe.dask_executor import dask_workers
from fe.executors import MapFn, process_map, serial_map

EXECUTORS = ("processes", "serial", "dask")


@contextmanager
def chosen_map(executor: str, workers: int, scheduler: str | None) -> Iterator[MapFn]:
    """The map of an executor; what it started ends with the context. Results do not depend on it.

    "processes": `workers` processes of one thread (0: one a core). "serial": one run after another,
    here. "dask": the cluster of `scheduler` (an address or file), without it one of `workers`
    processes on this machine. Raises ValueError for another executor, a scheduler without dask,
    and what `fe.dask_workers` refuses.
    """
    if executor not in EXECUTORS:
        raise ValueError(f"executor: found {executor!r}, expected one of {', '.join(EXECUTORS)}")
    if scheduler is not None and executor != "dask":
        raise ValueError(f"scheduler: found {scheduler!r}, expected none without executor dask")
    if executor == "dask":
        with dask_workers(scheduler, workers) as map_fn:
            yield map_fn
    else:
        yield serial_map if executor == "serial" else process_map(workers)
