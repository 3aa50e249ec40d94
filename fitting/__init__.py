"""Fit reflection models to pictures: `fit` returns a `Solution`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import brdf  # noqa: F401  (chooses libLLVM before Mitsuba starts Dr.Jit)

if TYPE_CHECKING:
    from .run import fit
    from .solution import Solution

__all__ = ["Solution", "fit"]


def __getattr__(name: str) -> Any:
    # Deferred, so that the command line answers before Mitsuba is loaded.
    if name == "fit":
        from .run import fit

        return fit
    if name == "Solution":
        from .solution import Solution

        return Solution
    raise AttributeError(name)
