"""Maps over many simulations: in this process, or in single-threaded worker processes."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from multiprocessing import connection, resource_tracker
from multiprocessing.context import SpawnProcess
from numbers import Integral
from typing import Any, Protocol, TypeVar

T = TypeVar("T")
R = TypeVar("R")
Pipe = connection.Connection

SINGLE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}
"""Environment of a worker: libraries read it once, when they are first imported."""


class MapFn(Protocol):
    """Applies a function to every item and yields (index of the item, result) in any order."""

    def __call__(self, f: Callable[[T], R], items: Sequence[T], /) -> Iterator[tuple[int, R]]:
        """Yield (index, f(items[index])) for every index once."""
        ...


class WorkerDied(RuntimeError):  # noqa: N818 - says what happened
    """A worker process ended without an answer (killed, out of memory, crash in native code)."""

    def __init__(self, message: str, index: int | None = None) -> None:
        super().__init__(message)
        self.index = index
        """of the item that it was at, where that is known"""


def serial_map(f: Callable[[T], R], items: Sequence[T], /) -> Iterator[tuple[int, R]]:
    """Apply `f` in this process, in order, with the threads this process has.

    Libraries here may use several threads and so round differently from a worker of
    `process_map`; a result meant to be the same for any number of workers needs `process_map(1)`.
    """
    for index, item in enumerate(items):
        yield index, f(item)


def process_map(n_workers: int = 0) -> MapFn:
    """Map over `n_workers` spawned processes of one thread each; 0 means every usable core.

    Items and results are pickled. The workers are ended at once when the caller closes the
    iterator or is interrupted; results that were already yielded are the caller's. An exception
    of `f` is raised here with the worker's traceback as a note, `WorkerDied` when a worker
    vanishes; results that others had by then are yielded before. Raises ValueError for an
    `n_workers` that is no number of processes.
    """
    if not (isinstance(n_workers, Integral) and n_workers >= 0):
        raise ValueError(f"n_workers: must be 0 (all cores) or a whole number, got {n_workers!r}")
    count = n_workers or usable_cores()

    def mapped(f: Callable[[T], R], items: Sequence[T], /) -> Iterator[tuple[int, R]]:
        return _map_over_workers(f, items, count)

    return mapped


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _map_over_workers(
    f: Callable[[T], R], items: Sequence[T], n_workers: int
) -> Generator[tuple[int, R], None, None]:
    _check_picklable(f)
    waiting = iter(range(len(items)))
    workers: dict[Pipe, SpawnProcess] = {}
    running: dict[Pipe, int] = {}
    try:
        _start_workers(f, min(n_workers, len(items)), workers)
        for pipe in workers:
            _hand_out(pipe, waiting, items, running)
        failure: Exception | None = None
        while running:
            answered = connection.wait(list(running), timeout=None if failure is None else 0.0)
            if failure is not None and not answered:
                raise failure
            for ready in answered:
                assert isinstance(ready, connection.Connection)
                try:
                    result = _receive(ready, workers[ready], running.pop(ready), len(items))
                except Exception as error:  # of `f`, or of a worker that is gone
                    failure = failure or error
                    continue
                if failure is None:
                    _hand_out(ready, waiting, items, running)
                yield result
        if failure is not None:
            raise failure
    finally:
        _end(workers)


def _check_picklable(f: Callable[[Any], Any]) -> None:
    try:
        pickle.dumps(f)
    except Exception as error:  # PicklingError, AttributeError or TypeError, by what is inside
        raise ValueError(
            f"simulate: must be picklable to run in worker processes, got {f!r} ({error}); "
            "use a function or a frozen dataclass defined at module level"
        ) from error


def _start_workers(f: Callable[[Any], Any], count: int, workers: dict[Pipe, SpawnProcess]) -> None:
    """Start processes into `workers`, which is filled as they start so that all can be ended."""
    context = multiprocessing.get_context("spawn")
    # Started by the first spawn otherwise, where it would unblock the interrupts again.
    resource_tracker.ensure_running()
    with _single_thread_environment(), _interrupts_blocked():
        for _ in range(count):
            here, there = context.Pipe()
            process = context.Process(target=_work, args=(f, there), daemon=True)
            process.start()
            workers[here] = process
            there.close()


@contextlib.contextmanager
def _single_thread_environment() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in SINGLE_THREAD}
    os.environ.update(SINGLE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C while workers start: they inherit the mask, this process gets it afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _hand_out(
    pipe: Pipe, waiting: Iterator[int], items: Sequence[Any], running: dict[Pipe, int]
) -> None:
    index = next(waiting, None)
    if index is None:
        return
    running[pipe] = index
    # A worker that is already gone is reported by the read that follows.
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        pipe.send(items[index])


def _receive(pipe: Pipe, process: SpawnProcess, index: int, n_items: int) -> tuple[int, Any]:
    try:
        done, value, trace = pipe.recv()
    except (EOFError, OSError) as error:  # OSError: in the middle of its answer
        process.join(timeout=5.0)
        raise WorkerDied(
            f"a worker process ended (exit code {process.exitcode}) in item {index + 1} of "
            f"{n_items}; a negative code is a signal (-9: out of memory or killed), 1 an error "
            "while it started, as in a script without `if __name__ == '__main__':`",
            index,
        ) from error
    if done:
        return index, value
    value.add_note(f"in item {index + 1} of {n_items}, in a worker process:\n{trace}")
    raise value


def _end(workers: dict[Pipe, SpawnProcess]) -> None:
    """End all processes now: idle ones lose nothing, and busy ones were given up by the caller."""
    for process in workers.values():
        process.terminate()
    for pipe, process in workers.items():
        process.join(timeout=2.0)
        if process.is_alive():
            process.kill()
            process.join()
        process.close()
        pipe.close()


def _work(f: Callable[[Any], Any], pipe: Pipe) -> None:
    """Answer items until the pipe closes; runs in the worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            pipe.send_bytes(_answer(f, pipe.recv()))


def _answer(f: Callable[[Any], Any], item: object) -> bytes:
    """Pickled (True, result, "") or (False, exception, traceback)."""
    try:
        return pickle.dumps((True, f(item), ""))
    except Exception as error:
        trace = traceback.format_exc()
        try:
            answer = pickle.dumps((False, error, trace))
            pickle.loads(answer)  # an exception with its own arguments may fail only here
        except Exception:
            answer = pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}"), trace))
        return answer


def _leave_with_parent() -> None:
    """End this worker when its parent is gone, even by SIGKILL and in the middle of a run."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
