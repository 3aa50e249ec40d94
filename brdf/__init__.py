"""Reflection models as declarations on Dr.Jit arrays.

This layer knows nothing of Mitsuba. Importing it chooses the libLLVM that Dr.Jit will use, which must happen before
Dr.Jit starts.
"""

from . import llvm

llvm.choose()

from .errors import BrdfError, DataError, NoBackend, UsageError  # noqa: E402  (libLLVM first)
from .model import Ideal, Lobe, Model, Values, defaults, evaluate  # noqa: E402
from .models import builtin  # noqa: E402
from .param import Param, choice, colour, number  # noqa: E402

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
