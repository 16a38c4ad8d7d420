"""Ctrl-C is not lost where Python has to ignore what is raised."""

from __future__ import annotations

import _thread
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

LATER = 0.005
"""s after which a lost Ctrl-C comes again"""


@contextmanager
def interrupts_kept() -> Iterator[None]:
    """Send a Ctrl-C again that came where exceptions are ignored, as in callbacks of compiled code.

    SciPy's Sobol sequences, for one, go on without their direction numbers.
    """
    former, coming = sys.unraisablehook, list[threading.Timer]()

    def again(ignored: sys.UnraisableHookArgs) -> None:
        """Interrupt the main thread a moment later; leave all else to the hook before."""
        if not issubclass(ignored.exc_type, KeyboardInterrupt):
            former(ignored)
            return
        # By another thread: raised here it would be ignored, too.
        coming.append(threading.Timer(LATER, _thread.interrupt_main))
        coming[-1].start()

    sys.unraisablehook = again
    try:
        yield
    finally:
        sys.unraisablehook = former
        with suppress(KeyboardInterrupt):  # one is enough, and one that ended is not stopped
            for timer in coming:
                timer.cancel()
                timer.join()
