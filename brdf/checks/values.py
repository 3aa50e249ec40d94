"""From Dr.Jit to NumPy."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt


def channels(value: Any) -> npt.NDArray[np.float64]:
    """A Dr.Jit number, colour or vector as a float64 array of shape (channels, n)."""
    array = np.asarray(value, dtype=np.float64)
    return array.reshape(dr.size_v(value) if dr.depth_v(value) > 1 else 1, -1)


def opaque(vector: Any, numbers: npt.ArrayLike) -> Any:
    """One Dr.Jit vector from plain numbers, stored: another one does not compile another kernel."""
    made = vector(*np.asarray(numbers, dtype=float).tolist())
    dr.make_opaque(made)
    return made
