"""Map over the workers of a Dask cluster; needs the extra `dask`."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from typing import TYPE_CHECKING, TypeVar

from fe.executors import MapFn

if TYPE_CHECKING:
    from distributed import Client

T = TypeVar("T")
R = TypeVar("R")


def dask_map(client: Client) -> MapFn:
    """Map over the workers of the cluster that `client` is connected to.

    Results are yielded as they come. When the caller closes the iterator or is interrupted, what
    has not begun is cancelled. An exception of `f` is raised here, and
    `distributed.KilledWorker` when workers vanish. Start the workers with one thread each
    (`threads_per_worker=1`, OMP_NUM_THREADS=1) to get the results of `fe.executors.process_map`.
    Raises ImportError when the extra `dask` is not installed.
    """
    from distributed import as_completed

    def mapped(f: Callable[[T], R], items: Sequence[T], /) -> Iterator[tuple[int, R]]:
        return results(f, items)

    def results(f: Callable[[T], R], items: Sequence[T]) -> Generator[tuple[int, R], None, None]:
        # Not pure: Dask would otherwise keep results of calls that it takes for equal.
        futures = client.map(f, list(items), pure=False)
        index = {future.key: i for i, future in enumerate(futures)}
        try:
            for future in as_completed(futures):
                yield index[future.key], future.result()
        finally:
            client.cancel(futures)

    return mapped
