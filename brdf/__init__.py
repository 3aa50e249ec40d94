"""Reflection models as declarations on Dr.Jit arrays.

This layer knows nothing of Mitsuba. Importing it chooses the libLLVM that Dr.Jit will use, which must happen before
Dr.Jit starts.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from . import llvm

llvm.choose()

if TYPE_CHECKING:
    from .errors import BrdfError, DataError, NoBackend, UsageError
    from .model import Ideal, Lobe, Model, Values, defaults, evaluate
    from .models import builtin
    from .param import Param, choice, colour, number

__all__ = [
    "BrdfError",
    "DataError",
    "Ideal",
    "Lobe",
    "Model",
    "NoBackend",
    "Param",
    "UsageError",
    "Values",
    "builtin",
    "choice",
    "colour",
    "defaults",
    "evaluate",
    "number",
]

_HOMES = {
    "errors": ("BrdfError", "DataError", "NoBackend", "UsageError"),
    "model": ("Ideal", "Lobe", "Model", "Values", "defaults", "evaluate"),
    "models": ("builtin",),
    "param": ("Param", "choice", "colour", "number"),
}


def __getattr__(name: str) -> Any:
    # Deferred, so that the command line answers, to an interruption as well, before Dr.Jit is loaded.
    for module, names in _HOMES.items():
        if name in names:
            globals()[name] = getattr(import_module(f"{__name__}.{module}"), name)
            return globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
