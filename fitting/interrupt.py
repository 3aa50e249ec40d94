"""What is not to happen while Dr.Jit records a kernel: an interruption, and a collection of garbage."""

from __future__ import annotations

import gc
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import drjit as dr


@contextmanager
def collector_paused() -> Iterator[None]:
    """Keeps the cyclic garbage collector from freeing a scene while Dr.Jit traces a BSDF written in Python.

    That would end in a segmentation fault (Mitsuba 3.9.1). What is free by then, as the samples of an earlier fit, goes
    back to the system: Dr.Jit keeps it, and one fit does not find use for all that another has left.
    """
    was = gc.isenabled()
    gc.collect()
    dr.flush_malloc_cache()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Notes a Ctrl-C instead of raising in the middle of a kernel's recording, which would spoil Dr.Jit's state.

    Gives a function that tells whether it was pressed. A second one is raised at once. Outside the main thread signals
    are left alone.
    """
    seen = [False]

    def note(number: int, frame: object) -> None:
        if seen[0]:
            raise KeyboardInterrupt
        seen[0] = True

    if threading.current_thread() is not threading.main_thread():
        yield lambda: seen[0]
        return
    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: seen[0]
    finally:
        signal.signal(signal.SIGINT, before)
