"""Between NumPy and Dr.Jit, for the tests of this folder."""

from __future__ import annotations

from typing import Any

import drjit as dr
import drjit.llvm.ad as wide
import drjit.scalar as scalar
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: 3-vector types by test id: precision, and one direction or millions.
VECTORS = {
    "float32": wide.Array3f,
    "float64": wide.Array3f64,
    "float32-scalar": scalar.Array3f,
    "float64-scalar": scalar.Array3f64,
}
EPS = {"float32": 2.0**-23, "float64": 2.0**-52}


def precision(name: str) -> str:
    return name.split("-")[0]


def call(function: Any, vector: Any, *arguments: Array) -> Array:
    """`function` of vectors (arguments of shape (n, 3)) and numbers (shape (n,)), in the arithmetic of `vector`."""
    if dr.is_jit_v(vector):
        number = dr.value_t(vector)
        made = [vector(*a.T) if a.ndim == 2 else number(a) for a in arguments]
        return to_numpy(function(*made))
    rows = zip(*(a.tolist() for a in arguments), strict=True)
    return np.array([to_numpy(function(*(vector(a) if isinstance(a, list) else a for a in row))) for row in rows])


def to_numpy(value: Any) -> Array:
    return np.asarray(value, dtype=np.float64)


def single(a: npt.ArrayLike) -> Array:
    """Rounded to float32, which float64 represents as well: one input for both."""
    return np.asarray(a, dtype=np.float32).astype(np.float64)


def error(got: Array, want: Array, scale: Array | float) -> Array:
    """Relative error, of values below 1e-6 of `scale` relative to that."""
    return np.abs(got - want) / np.maximum(np.abs(want), 1e-6 * np.asarray(scale))
