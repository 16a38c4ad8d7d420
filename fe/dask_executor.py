"""Map over the workers of a Dask cluster; needs the extra `dask`."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from fe.executors import SINGLE_THREAD, MapFn, WorkerDied, usable_cores

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")
R = TypeVar("R")

CONNECT_SECONDS = 10.0
"""how long a scheduler has to answer"""


def dask_map(client: Client) -> MapFn:
    """Map over the workers of the cluster that `client` is connected to.

    Results are yielded as they come. An item whose worker vanishes is repeated by another; with no
    worker left, the map waits for new ones. When the caller closes the iterator or is interrupted,
    what has not begun is cancelled. An exception of `f` is raised here, and `WorkerDied` when an
    item has ended several workers, or the cluster is closed; results that others had by then are
    yielded before. Start the workers with one thread each
    (`threads_per_worker=1`, OMP_NUM_THREADS=1) to get the results of `fe.executors.process_map`.
    Raises ImportError when the extra `dask` is not installed.
    """
    from concurrent.futures import CancelledError

    from distributed import KilledWorker, as_completed

    def mapped(f: Callable[[T], R], items: Sequence[T], /) -> Iterator[tuple[int, R]]:
        return results(f, items)

    def results(f: Callable[[T], R], items: Sequence[T]) -> Generator[tuple[int, R], None, None]:
        # Not pure: Dask would otherwise keep results of calls that it takes for equal.
        futures = client.map(f, list(items), pure=False)
        index = {future.key: i for i, future in enumerate(futures)}
        try:
            with client.as_current():  # which need not be the default one
                completed = as_completed(futures)
            for future in completed:
                try:
                    result = future.result()
                except Exception:
                    yield from _others_ready(futures, index)
                    raise
                yield index.pop(future.key), result
                # Dask would repeat a run that it keeps when the worker that has the result ends.
                future.release()
            if index:
                raise WorkerDied(f"the Dask cluster ended with {len(index)} items to go")
        except KilledWorker as error:
            raise WorkerDied(
                f"workers of the Dask cluster ended in the same item, one after another ({error}); "
                "it may need more memory than they have",
                index.get(error.task),
            ) from error
        except CancelledError as error:
            raise WorkerDied(f"the Dask cluster ended with {len(index)} items to go") from error
        finally:
            if client.status == "running":
                client.cancel(futures)

    return mapped


def _others_ready(
    futures: Sequence[Future[Any]], index: dict[Any, int]
) -> Generator[tuple[int, Any], None, None]:
    """Results that were there when another item failed, taken out of `index` (items by key)."""
    for future in futures:
        if future.key in index and future.status == "finished":
            try:
                result = future.result()
            except Exception:  # lost since: its worker or the cluster ended
                continue
            yield index.pop(future.key), result


@contextlib.contextmanager
def dask_workers(scheduler: str | None = None, n_workers: int = 0) -> Iterator[MapFn]:
    """The map of a running cluster, or of one started here that ends with the context.

    `scheduler` is an address such as "tcp://node7:8786" or the file that the scheduler wrote;
    without it, `n_workers` processes of one thread are started on this machine (0: one a core).
    Raises ValueError when the extra `dask` is not installed or no scheduler answers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise ValueError(
            "executor: found no package `distributed`, expected the extra dask: "
            "in softcal's folder, .venv/bin/pip install -e '.[dask]'"
        ) from error
    with contextlib.ExitStack() as stack:
        if scheduler is None:
            cluster = stack.enter_context(_local_cluster(n_workers or usable_cores()))
            client = Client(cluster, set_as_default=False)  # others' Dask is none of our business
        else:
            client = _connected(Client, scheduler)
        yield dask_map(stack.enter_context(client))


def _local_cluster(n_workers: int) -> Any:
    import dask
    from distributed import LocalCluster

    # Workers are spawned: libraries read these when they are first imported there.
    environment = "distributed.nanny.pre-spawn-environ"
    with dask.config.set({f"{environment}.{k}": v for k, v in SINGLE_THREAD.items()}):
        return LocalCluster(
            n_workers=n_workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",
        )


def _connected(connect: Callable[..., Client], scheduler: str) -> Client:
    address = _address(scheduler)
    try:
        return connect(address=address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        raise ValueError(
            f"scheduler: found none that answers at {scheduler!r}, expected its address "
            "(tcp://HOST:PORT) or scheduler file"
        ) from error


def _address(scheduler: str) -> str:
    """The address itself, or that in a scheduler's file; Dask would wait for one that is none."""
    path = Path(scheduler)
    if "://" in scheduler or (not path.is_file() and ":" in scheduler):
        return scheduler
    try:
        return str(json.loads(path.read_text(encoding="utf-8"))["address"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ValueError(
            f"scheduler: found {scheduler!r}, expected an address (tcp://HOST:PORT) or the file "
            "that a scheduler wrote"
        ) from error
