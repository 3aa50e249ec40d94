"""Where the command ``brdf`` starts: an interruption while its modules load ends it in one line, as later ones do."""

from __future__ import annotations

import os
import signal
import sys
from typing import Any


def main() -> int:
    """Load the command line and run it; returns the exit code."""
    watched = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # it is not behind nohup
    if watched:
        signal.signal(signal.SIGINT, end)
    import drjit  # noqa: F401  (after fitting, which has chosen the libLLVM; it turns an interruption into an error)

    from .app import main as run

    if watched:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return run()


def end(*_: Any) -> None:
    """Leave at once: modules that are half loaded may make another exception of one."""
    print("brdf: interrupted", file=sys.stderr, flush=True)
    os._exit(128 + signal.SIGINT)
